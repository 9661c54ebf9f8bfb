"""`sgpr identify`: the main job, from a robot and logs to a torque model and a report on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import Comparison, CutoffInfluence, LogSet, Model, Robot, cutoff_influence
from .. import compare as compare_with
from .. import identify as identify_from
from ..report.identification import IdentificationPage
from ..report.numbers import counted, percent
from ..report.parameters import left_out as is_left_out
from . import describe
from .console import Output, to_json
from .error_table import show_errors
from .errors import LIMITS_NOT_MET, wrong_use
from .findings import Found, as_data, of_result
from .findings import show as show_ranked
from .fit_options import BodyOptions, EquationOptions, IdentificationOptions
from .info import show_certificate, show_parameters, show_terms
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
from .predictions import (
    AFTER,
    BEFORE,
    left_out,
    predictions,
    residuals_by_log,
    write_before_and_after,
    write_topics,
)
from .project import RobotAndLogs, joints_of
from .reading import Log, ReadingOptions, read_logs, stretches, tell_layouts
from .results import judged
from .robot_files import without_place
from .robots import load_robot, tell_locked
from .screening import excitation, repeated, unsaid
from .sessions import tell_sessions

ROBOT_FILES = {"robot.xml": "mjcf", "robot.urdf": "urdf"}
"""The formats of the robot files in the folder of results."""


def identify(
    project: RobotAndLogs,
    out: OutFolder,
    fit: IdentificationOptions,
    bodies: BodyOptions,
    equations: EquationOptions,
    reading: ReadingOptions,
    output: Output,
    joints: Joints = None,
    gravity: Gravity = None,
    no_report: NoReport = False,
    open_report: Open = False,
    strict: Strict = False,
    mcap: Annotated[
        str | None,
        typer.Option(
            "--mcap", metavar="FILE", help="Also write measured, predicted and residual torque of the test logs."
        ),
    ] = None,
) -> None:
    """Identifies a torque model from logs, and says how good it is on logs it has not seen.

    Writes to DIR: model.sgpr, report.html, identification.json and, with test logs, predictions.csv; with --consistent
    also the robot with the inertias and the friction found, robot.xml (MJCF) and, from a URDF, robot.urdf.
    """
    robot, train, test, usual = project.project()
    if equations.effects is None:
        equations = replace(equations, effects=usual)
    if fit.no_prior and (bodies.prior is not None or bodies.prior_deviation is not None):
        raise wrong_use("leaves nothing that --prior or --prior-deviation could say", "--no-prior")
    options = {**equations.arguments(), **fit.arguments(), **bodies.arguments(others=("--prior-deviation",))}
    if options["consistent"] and options["essential"]:
        raise wrong_use("parameters that are left out make no body: choose one of the two", "--consistent")
    if mcap is not None and not test:
        raise wrong_use("is written for test logs: name them with --test", "--mcap")
    folder = OutputFolder(out)
    joints = joints_of(robot, joints, train)
    loaded = load_robot(robot, joints, gravity)
    tell_locked(robot, loaded, output)
    train_logs = read_logs(train, reading, loaded.joint_names, output)
    test_logs = read_logs(test, reading, loaded.joint_names, output)
    instruments = stretches(read_logs(fit.instruments or [], reading, loaded.joint_names, output))
    result = run(loaded, train_logs, test_logs, {**options, "instruments": instruments}, output)
    settings = {
        "robot": robot,
        "joints": joints,
        "gravity": loaded.gravity,
        **options,
        **({"instruments": fit.instruments} if fit.instruments else {}),
        "reading": reading.to_dict(),
    }
    data = result.to_dict(settings)
    robot_files = []
    if options["consistent"]:
        robot_files = ["robot.xml", "robot.urdf"] if Path(robot).suffix.lower() == ".urdf" else ["robot.xml"]
    with folder:
        result.model.with_reading(reading.lasting(train)).save(folder.file("model.sgpr"))
        if "robot.xml" in robot_files:
            folder.write("robot.xml", result.model.to_mjcf())
        if "robot.urdf" in robot_files:
            result.model.write_urdf(robot, folder.file("robot.urdf"))
        if test_logs:
            rows = predictions(test_logs, {BEFORE: result.before, AFTER: result.after}, loaded.joint_names)
            data["left_out_of_predictions"] = left_out(rows)
            write_before_and_after(folder.file("predictions.csv"), rows, loaded.joint_names)
            if mcap:
                write_topics(folder.file(str(Path(mcap).absolute())), rows, loaded.joint_names, AFTER)
        if not no_report:
            folder.write("report.html", result.page(data).html())
        folder.write("identification.json", to_json(data))
    tell_layouts([*train_logs, *test_logs], output, of_all=joints is None)
    tell_sessions(robot, train_logs, output)
    show(result, data, output)
    for name in robot_files:
        if left := without_place(ROBOT_FILES[name], result.model):
            output.note(f"{name} has bodies and friction, but no place for {', '.join(left)}")
    output.line(f"results: {folder.path}")
    if not no_report and open_report:
        open_page(folder.path / "report.html")
    output.result(data)
    next_step(result, (robot, train, test), folder.path, reading, output)
    if result.is_worse() and strict:
        raise typer.Exit(LIMITS_NOT_MET)


def next_step(
    result: "Result",
    asked: tuple[str, Sequence[str], Sequence[str] | None],
    folder: Path,
    reading: ReadingOptions,
    output: Output,
) -> None:
    """A look at the logs of a model that nobody can use; else the search for what it lacks.

    - `asked`: robot, logs to train and to test, as the command names them
    """
    robot, train, test = asked
    if result.is_worse():
        output.next("sgpr", "info", robot, *train, *reading.words(), why="what is wrong with the logs?")
        return
    unseen = ["--test", *test] if test else []
    out = str(folder.with_name(f"{folder.name}_diagnosis"))
    command = ["sgpr", "diagnose", "--robot", str(folder / "model.sgpr"), "--train", *train, *unseen, "--out", out]
    output.next(*command, why="which effect is missing?")


@dataclass(frozen=True)
class Result:
    """A model with all that is known about it."""

    model: Model
    train: list[Log]
    test: list[Log]
    before: Comparison
    after: Comparison
    influence: list[CutoffInfluence]
    influence_errors: list[dict[str, Any]]
    findings: list[str]
    repeated: list[str]

    @property
    def judged(self) -> list[Log]:
        """The logs of the comparisons."""
        return self.test or self.train

    def to_dict(self, settings: dict[str, Any]) -> dict[str, Any]:
        """All figures."""
        report = self.model.report
        assert report is not None, "just identified"
        own: dict[str, Any] = {
            "settings": settings,
            "effects": self.model.effects,
            "processing": describe.processing(self.model),
            "fit": self.model.fit,
            "samples": report.samples,
            "singular_values": report.singular_values,
            "cutoff_choices": [
                {"log": stretch.source, "cutoff_hz": c.cutoff_hz, "joint_hz": c.joint_hz, "noise": c.noise}
                for stretch, c in zip(stretches(self.train), report.cutoff_choices, strict=False)
            ],
            "cutoff_influence": [
                {
                    "cutoff_hz": other.cutoff_hz,
                    "largest_change": other.largest_change,
                    "typical_change": other.typical_change,
                    "rmse": [joint["rmse"] for joint in found["joints"]],
                    "relative_error_percent": found["relative_error_percent"],
                }
                for other, found in zip(self.influence, self.influence_errors, strict=True)
            ],
            "parameters": describe.parameters(self.model),
            "terms": describe.terms(self.model),
            "certificate": self.model.certificate,
            "screening": self.screening(),
            "essential": report.essential,
            "warnings": [*self.repeated, *report.warnings, *self.findings],
            "messages": as_data(self.ranked()),
            "worse_than_before": self.is_worse(),
            "repeated_motions": self.repeated,
        }
        return judged("identify", self.model.robot, self.before, self.after, self.train, self.test, **own)

    def ranked(self) -> list[Found]:
        """Findings in the logs and of the fit, in one list."""
        report = self.model.report
        assert report is not None, "just identified"
        texts = [*self.repeated, *report.warnings, *self.findings]
        return of_result(texts, [*self.train, *self.test])

    def is_worse(self) -> bool:
        """Whether the model is worse on unseen logs than the robot file."""
        return bool(self.test) and self.after.relative_error_percent > self.before.relative_error_percent

    def screening(self) -> list[str]:
        """How well the motion excites the parameters, and what the physics finds suspicious in the training logs."""
        fit = self.model.fit
        assert fit is not None, "just identified"
        words = excitation(fit["scaled_condition"], len(self.model.parameters), fit["undetermined"])
        return [f"{words}.", *self.findings]

    def page(self, data: dict[str, Any]) -> IdentificationPage:
        """The report."""
        return IdentificationPage(
            model=self.model,
            before=self.before,
            after=self.after,
            residuals_before=residuals_by_log(self.judged, self.before),
            residuals_after=residuals_by_log(self.judged, self.after),
            data=data,
        )


def run(robot: Robot, train: Sequence[Log], test: Sequence[Log], options: dict[str, Any], output: Output) -> Result:
    """Identifies, and compares with the model of the robot file."""
    training = LogSet(stretches(train), whole=True)
    with output.progress() as progress:
        model = identify_from(robot, training, progress=progress, **options)
        influence = cutoff_influence(robot, training, model, progress=progress, **options)
    judged = LogSet(stretches(test) or training)
    for text in judged.notes if test else []:
        output.warning(text)
    nominal = Model.nominal(robot)
    return Result(
        model=model,
        train=list(train),
        test=list(test),
        before=compare_with(nominal, judged, processing=model),
        after=compare_with(model, judged),
        influence=influence,
        findings=unsaid(model, training),
        repeated=repeated(train, test),
        influence_errors=[
            describe.comparison(compare_with(other.model, judged, processing=model)) for other in influence
        ],
    )


FEW_PARAMETERS = 12
"""More are no table before the answer."""


def in_a_sentence(parameters: Sequence[dict[str, Any]]) -> str:
    """How many parameters are known, and where they stand."""
    dropped = sum(is_left_out(p) for p in parameters)
    known = [p["relative_standard_deviation_percent"] for p in parameters if p["determined"] and not is_left_out(p)]
    well = sum(percent is not None and percent <= 10.0 for percent in known)
    silent = sum(p["determined"] is False for p in parameters)
    held = f", {silent} not excited by the motion" if silent else ""
    held += f", {dropped} left out" if dropped else ""
    return (
        f"{len(parameters)} base parameters, {well} of them known to 10 % or better{held}: the report and "
        "`sgpr info MODEL` list them"
    )


def show(result: Result, data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    parameters = data["parameters"]
    if len(parameters) <= FEW_PARAMETERS:
        show_parameters(parameters, output)
    else:
        output.line(in_a_sentence(parameters))
    show_terms(data["terms"], output)
    if data["certificate"]:
        show_certificate(data["certificate"], output)
    show_errors({BEFORE: result.before, AFTER: result.after}, output)
    where = (
        f"On {counted(len(result.test), 'unseen log')}" if result.test else "On the training logs (no test logs given)"
    )
    output.heading(
        f"{where} the error is {percent(result.after.relative_error_percent)} % of the torque; before, with the robot "
        f"file, it was {percent(result.before.relative_error_percent)} %."
    )
    if result.is_worse():
        output.bad(
            "The model is worse on the test logs than the robot file: do not use it. Look at the findings below and at "
            "the report; train on more varied motions, or with --consistent."
        )
    for path, count in data["left_out_of_predictions"].items():
        output.warning(
            f"{path}: {counted(count, 'sample')} without prediction (repairs, or stretches too short to filter)"
        )
    show_ranked(result.ranked(), output, "see the report, or sgpr info")
