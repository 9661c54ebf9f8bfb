"""`sgpr diagnose`: which physical effect the model lacks, and the model with it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Annotated, Any

import typer

from .. import Comparison, Diagnosis, LogSet, Model, Robot
from .. import compare as compare_with
from .. import diagnose as diagnose_model
from .. import effects as registry
from .. import identify as identify_from
from ..report.diagnosis import DiagnosisPage
from ..report.experiment import separation
from ..report.numbers import counted, percent, significant, with_deviation
from ..report.steps import steps_at_once
from .console import Output, to_json
from .effects import checked_effects, effects_option, fitted_effects
from .error_table import show_errors
from .errors import LIMITS_NOT_MET, wrong_use
from .findings import Found, as_data, of_result
from .findings import show as show_ranked
from .inputs import kind_of, load_model
from .options import (
    Gravity,
    Joints,
    NoReport,
    Open,
    OutFolder,
    Strict,
    open_page,
)
from .output_folder import OutputFolder
from .predictions import AFTER, BEFORE, left_out, predictions, residuals_by_log, write_before_and_after
from .project import ModelAndLogs, joints_of
from .reading import Log, ReadingOptions, read_logs, stretches, tell_layouts
from .results import judged
from .robots import load_robot, tell_locked
from .screening import repeated

NEXT_EXPERIMENT = "next_experiment.csv"

VERDICTS = {
    "effects_found": "Effects are missing from the model.",
    "nothing_missing": "Nothing is missing: what is left is noise as far as these logs can tell.",
    "unexplained_structure": "Something is missing, and no known effect is likely to be it.",
}


def diagnose(
    project: ModelAndLogs,
    out: OutFolder,
    reading: ReadingOptions,
    output: Output,
    effects: Annotated[
        list[str] | None,
        effects_option("Effects that the model has already, or `none`."),
    ] = None,
    look_for: Annotated[
        list[str] | None,
        typer.Option("--look-for", metavar="EFFECT...", help="Effects to test.", show_default="all of the library"),
    ] = None,
    add: Annotated[
        list[str] | None,
        typer.Option(
            "--add",
            metavar="EFFECT@JOINT...",
            help="Add these by hand, without a search, and see the same before and after.",
        ),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option(
            "--apply/--no-apply", help="Put the findings into the model that is written (the report shows both)."
        ),
    ] = True,
    joints: Joints = None,
    gravity: Gravity = None,
    no_report: NoReport = False,
    open_report: Open = False,
    strict: Strict = False,
) -> None:
    """Finds out which physical effects a model lacks, adds them, and shows the error before and after.

    Writes to DIR: diagnosis.json, report.html, model.sgpr, with test logs predictions.csv and, if effects could be
    mistaken for each other, next_experiment.csv and .mcap: the motion that tells them apart.
    """
    robot, train, test, usual = project.project()
    wanted = checked_effects(look_for, "--look-for") if look_for else None
    add = checked_effects(add, "--add") if add else None
    joints = joints_of(robot, joints, train)
    given: Model | None = load_model(robot, joints, gravity) if kind_of(robot) == "model" else None
    if given is not None and effects is not None:
        raise wrong_use("a model has its effects already", "--effects")
    known = given.effects if given else fitted_effects(effects, usual)
    folder = OutputFolder(out)
    arm = given.robot if given else load_robot(robot, joints, gravity)
    if not given:
        tell_locked(robot, arm, output)
    like = given.reading if given else None
    train_logs = read_logs(train, reading, arm.joint_names, output, like)
    test_logs = read_logs(test, reading, arm.joint_names, output, like)
    result = run(given or arm, train_logs, test_logs, known, wanted, output, add)
    data = result.to_dict()
    data["settings"] = {
        "robot": robot,
        "joints": joints,
        "gravity": arm.gravity,
        "effects": known,
        "look_for": wanted,
        "add": add,
        "reading": reading.to_dict(),
    }
    with folder:
        written = result.after if apply else result.before
        written.with_reading(like or reading.lasting(train)).save(folder.file("model.sgpr"))
        if test_logs:
            comparisons = {BEFORE: result.errors_before, AFTER: result.errors_after}
            rows = predictions(test_logs, comparisons, arm.joint_names)
            data["left_out_of_predictions"] = left_out(rows)
            write_before_and_after(folder.file("predictions.csv"), rows, arm.joint_names)
        if data["next_experiment"]:
            data["next_experiment_file"] = NEXT_EXPERIMENT
            result.diagnosis.save_next_motion(folder.file(NEXT_EXPERIMENT))
            result.diagnosis.save_next_motion(folder.file(PurePath(NEXT_EXPERIMENT).with_suffix(".mcap").name))
        if not no_report:
            folder.write("report.html", result.page(data).html())
        folder.write("diagnosis.json", to_json(data))
    tell_layouts([*train_logs, *test_logs], output, of_all=joints is None and not given)
    show(result, data, output)
    show_ranked(result.ranked(), output, "see the report, or sgpr info")
    for text in result.errors_after.notes:
        output.warning(text)
    output.line(f"results: {folder.path}")
    output.result(data)
    if not no_report and open_report:
        open_page(folder.path / "report.html")
    model_file = str(folder.path / "model.sgpr")
    if data["findings"] and apply:
        another = (test or ["ANOTHER_LOG"])[0]
        output.next("sgpr", "compare", model_file, another, "--out", "comparison", why="or a log of another motion")
    elif data["verdict"] == "unexplained_structure":
        output.next(
            "sgpr", "learn", "--robot", model_file, "--train", *train, *(["--test", *test] if test else []),
            "--out", "learned", why="Gaussian processes for what no known effect explains",
        )  # fmt: skip
    else:
        output.next("sgpr", "predict", model_file, (test or train)[0], "--out", "torque.csv")
    if result.is_worse():
        output.bad("The model with the findings is worse on the test logs than the one before: do not use it.")
        if strict:
            raise typer.Exit(LIMITS_NOT_MET)


@dataclass(frozen=True)
class Result:
    """A diagnosis with the models before and after it, compared with the same logs."""

    diagnosis: Diagnosis
    before: Model
    after: Model
    train: list[Log]
    test: list[Log]
    errors_before: Comparison
    errors_after: Comparison
    repeated: list[str]

    @property
    def judged(self) -> list[Log]:
        """The logs of the comparisons."""
        return self.test or self.train

    def is_worse(self) -> bool:
        """Whether the findings make unseen torque worse."""
        before, after = self.errors_before.relative_error_percent, self.errors_after.relative_error_percent
        return bool(self.test) and after > before

    def to_dict(self) -> dict[str, Any]:
        """All figures: those of the diagnosis, and what they are for."""
        own: dict[str, Any] = {
            **self.diagnosis.to_dict(),
            "history": self.after.history,
            "messages": as_data(self.ranked()),
            "repeated_motions": self.repeated,
        }
        return judged("diagnose", self.after.robot, self.errors_before, self.errors_after, self.train, self.test, **own)

    def ranked(self) -> list[Found]:
        """Findings in the logs, and of the identification if that went before, in one list."""
        identified = self.before.report
        texts = [*(identified.warnings if identified else []), *self.repeated]
        return of_result(texts, [*self.train, *self.test])

    def page(self, data: dict[str, Any]) -> DiagnosisPage:
        """The report."""
        about = {effect["name"]: effect for effect in registry()}
        return DiagnosisPage(
            before=self.before,
            after=self.after,
            errors_before=self.errors_before,
            errors_after=self.errors_after,
            residuals_before=residuals_by_log(self.judged, self.errors_before),
            residuals_after=residuals_by_log(self.judged, self.errors_after),
            summaries={name: effect["summary"] for name, effect in about.items()},
            next_motion=self.diagnosis.next_motion,
            data=data,
        )


def run(
    start: Model | Robot,
    train: Sequence[Log],
    test: Sequence[Log],
    known: Sequence[str],
    look_for: Sequence[str] | None,
    output: Output,
    add: Sequence[str] | None = None,
) -> Result:
    """Identifies if need be, and diagnoses."""
    training, unseen = LogSet(stretches(train), whole=True), LogSet(stretches(test), whole=True)
    with output.progress() as progress:
        model = start
        if not isinstance(model, Model):
            model = identify_from(model, training, effects=known, progress=progress)
        diagnosis = diagnose_model(model, training, unseen, effects=look_for, add=add, progress=progress)
    judged = LogSet(unseen or training)
    for text in judged.notes if unseen else []:
        output.warning(text)
    after = diagnosis.model
    return Result(
        diagnosis=diagnosis,
        before=model,
        after=after,
        train=list(train),
        test=list(test),
        errors_before=compare_with(model, judged, processing=after),
        errors_after=compare_with(after, judged),
        repeated=repeated(train, test),
    )


def show(result: Result, data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    output.heading(VERDICTS[data["verdict"]])
    output.line(
        f"probability that nothing is missing {data['probability_nothing_missing']:.2f}, that something unknown is "
        f"{data['probability_unexplained']:.2f}"
    )
    if data["structure"]:
        output.line("what the error on the training logs depends on:")
    for joint in data["structure"]:
        output.line(f"  {joint['summary']}")
    for number, finding in enumerate(data["findings"], start=1):
        at = ", ".join(finding["joints"]) or "whole arm"
        output.heading(f"{number}. {finding['effect']} ({at}), probability {finding['probability']:.2f}")
        output.line(f"   {finding['evidence']}")
        for parameter in finding["parameters"]:
            value, deviation = with_deviation(parameter["value"], parameter["standard_deviation"])
            output.line(f"   {parameter['name']} = {value} ± {deviation} {parameter['unit']}")
        if finding["confusable_with"]:
            output.line(f"   could also be {', '.join(finding['confusable_with'])}; {finding['separating_experiment']}")
    for text in data["unexplained"]:
        output.line(f"left over: {text}")
    for formula in data["formulas"]:
        output.line(
            f"a formula for it (a suggestion): {formula['text']}, explains {percent(100 * formula['explained'])} % "
            "of what is left"
        )
    for one in data["next_experiment"]:
        output.line(
            f"next experiment, to tell {' from '.join(one['about'])}: {one['experiment']}; log Bayes factor "
            f"{separation(one)}"
        )
    steps = steps_at_once(data["steps"])
    if len(steps) > 1 and data["findings"]:
        units = dict(zip(result.before.robot.joint_names, result.before.robot.torque_units, strict=True))
        rows = [[name, unit, *(significant(errors[name]) for _, errors in steps)] for name, unit in units.items()]
        output.table(["held-out error of", "unit", *(label for label, _ in steps)], rows, text_columns=(0, 1))
    show_errors({BEFORE: result.errors_before, AFTER: result.errors_after}, output)
    where = f"On {counted(len(result.test), 'unseen log')}" if result.test else "On the training logs"
    before, after = (c.relative_error_percent for c in (result.errors_before, result.errors_after))
    output.heading(f"{where} the error is {percent(after)} % of the torque; before it was {percent(before)} %.")
    for line in data["history"]:
        output.line(f"history: {line}")
    if data["not_testable"]:
        output.told(f"not testable with these logs: {', '.join(entry['effect'] for entry in data['not_testable'])}")
