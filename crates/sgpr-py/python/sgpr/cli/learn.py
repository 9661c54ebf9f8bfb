"""`sgpr learn`: what the physics leaves over, learned by Gaussian processes."""

from dataclasses import dataclass
from typing import Annotated, Any

import typer

from .. import Comparison, LogSet, Model, SemiParametricModel
from .. import compare as compare_with
from ..report.numbers import counted, percent, significant
from ..report.rest import INPUTS, RestPage, fewer_rows_were_better, points_of, too_narrow
from .console import Output, to_json
from .effects import effects_option, fitted_effects
from .error_table import show_errors
from .errors import LIMITS_NOT_MET, one_of, wrong_use
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
from .predictions import (
    AFTER,
    BEFORE,
    INTERVAL,
    STD,
    Pieces,
    left_out,
    predictions,
    residuals_by_log,
    spread_of,
    write_table,
)
from .project import ModelAndLogs, joints_of
from .reading import Log, ReadingOptions, read_logs, stretches, tell_layouts
from .results import judged
from .robots import load_robot, tell_locked
from .screening import repeated

KERNELS = ("squared_exponential", "exponential", "matern32", "matern52", "rational_quadratic")
MEANS = ("physics", "joint")
MOST_POINTS = 20_000


def learn(
    project: ModelAndLogs,
    out: OutFolder,
    reading: ReadingOptions,
    output: Output,
    effects: Annotated[
        list[str] | None,
        effects_option("Effects of the physics if it is identified here, or `none`."),
    ] = None,
    points: Annotated[
        int,
        typer.Option("--points", metavar="N", min=2, max=MOST_POINTS, help="Budget of each joint's process."),
    ] = 500,
    sparse: Annotated[
        bool | None,
        typer.Option(
            "--sparse/--subset",
            help="Whether more rows than the budget are all seen, through inducing points, or the best kept.",
            show_default="what helps on parts of the logs that are left out, joint by joint",
        ),
    ] = None,
    kernel: Annotated[str, typer.Option("--kernel", metavar="NAME", help=", ".join(KERNELS))] = KERNELS[0],
    inputs: Annotated[
        str | None,
        typer.Option(
            "--inputs",
            metavar="NAME",
            help=f"What the processes look at: {', '.join(INPUTS)}.",
            show_default="what helps on parts of the logs that are left out, joint by joint",
        ),
    ] = None,
    mean: Annotated[
        str,
        typer.Option("--mean", metavar="NAME", help="`joint` estimates the physics again together with the processes."),
    ] = MEANS[0],
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", min=1, max=1024, help="Threads.")] = 2,
    joints: Joints = None,
    gravity: Gravity = None,
    no_report: NoReport = False,
    open_report: Open = False,
    strict: Strict = False,
) -> None:
    """Learns what the physics leaves over, joint by joint, and says how sure predictions are.

    Writes to DIR: model.sgpr (physics and processes, for `sgpr predict`), learned.json, report.html and, with test
    logs, predictions.csv with the columns NAME_measured, NAME_before, NAME_after, NAME_std and NAME_interval_95.
    Ctrl-C during the search keeps what was found so far.
    """
    robot, train, test, usual = project.project()
    one_of(kernel, KERNELS, "--kernel", "kernel")
    one_of(mean, MEANS, "--mean", "mean")
    if inputs is not None:
        one_of(inputs, INPUTS, "--inputs", "selection of inputs")
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
    settings: dict[str, Any] = {"points": points, "sparse": sparse, "kernel": kernel, "inputs": inputs, "mean": mean}
    with output.progress() as progress:
        model = SemiParametricModel(
            arm, effects=None if given else known, physics=given, n_jobs=jobs, progress=progress, **settings
        )
        training = LogSet(stretches(train_logs), whole=True)
        fit(model, training, output)
    judged = LogSet(stretches(test_logs) or training)
    result = Result.of(model, train_logs, test_logs, judged)
    for text in judged.notes if test_logs else []:
        output.warning(text)
    data = result.to_dict()
    data["settings"] = {
        "robot": robot,
        "joints": joints,
        "gravity": arm.gravity,
        "effects": known,
        **settings,
        "reading": reading.to_dict(),
    }
    with folder:
        model.save(folder.file("model.sgpr"))
        if test_logs:
            found: dict[str, Comparison | Pieces] = {BEFORE: result.errors_before, AFTER: result.errors_after}
            rows = predictions(test_logs, {**found, **spread_of(result.errors_after, result.spread)}, arm.joint_names)
            data["left_out_of_predictions"] = left_out(rows)
            columns = {name: name for name in (BEFORE, AFTER, STD, INTERVAL)}
            write_table(folder.file("predictions.csv"), rows, arm.joint_names, columns, with_file=True)
        if not no_report:
            folder.write("report.html", result.page(data).html())
        folder.write("learned.json", to_json(data))
    tell_layouts([*train_logs, *test_logs], output, of_all=joints is None and not given)
    show(result, data, output)
    show_ranked(result.ranked(), output, "see the report, or sgpr info")
    output.line(f"results: {folder.path}")
    output.result(data)
    if not no_report and open_report:
        open_page(folder.path / "report.html")
    example = (test or train)[0]
    output.next("sgpr", "predict", str(folder.path / "model.sgpr"), example, "--out", "torque.csv")
    if result.is_worse():
        output.bad("The processes make the torque of the test logs worse than the physics alone: do not use them.")
        if strict:
            raise typer.Exit(LIMITS_NOT_MET)


def fit(model: SemiParametricModel, training: LogSet, output: Output) -> None:
    """Fits; Ctrl-C after the physics is there keeps the processes so far."""
    try:
        model.fit(training)
    except KeyboardInterrupt:
        if not hasattr(model, "physics_"):
            raise
        output.warning("stopped: joints that the search had not reached have the physics alone")


@dataclass(frozen=True)
class Result:
    """A model, compared with the same logs before and after its processes."""

    model: SemiParametricModel
    train: list[Log]
    test: list[Log]
    errors_before: Comparison
    errors_after: Comparison
    spread: list[list[Any]]
    coverage: list[dict[str, Any]]
    repeated: list[str]

    @classmethod
    def of(
        cls, model: SemiParametricModel, train: list[Log], test: list[Log], judged: LogSet | None = None
    ) -> "Result":
        """Compares on `judged`, by default the test logs, or without them the training logs."""
        judged = judged or LogSet(stretches(test) or stretches(train))
        after, spread = model.compare_with_spread(judged)
        before = compare_with(model.physics_, judged)
        return cls(model, train, test, before, after, spread, model.coverage(judged), repeated(train, test))

    def is_worse(self) -> bool:
        """Whether the processes make unseen torque worse."""
        before, after = self.errors_before.relative_error_percent, self.errors_after.relative_error_percent
        return bool(self.test) and after > before

    @property
    def judged(self) -> list[Log]:
        """The logs of the comparisons."""
        return self.test or self.train

    def to_dict(self) -> dict[str, Any]:
        """All figures."""
        physics = self.model.physics_
        own: dict[str, Any] = {
            "stopped": self.model.stopped_,
            "joints": self.model.reports_,
            "coverage": self.coverage,
            "history": physics.history,
            "messages": as_data(self.ranked()),
            "repeated_motions": self.repeated,
        }
        return judged("learn", physics.robot, self.errors_before, self.errors_after, self.train, self.test, **own)

    def ranked(self) -> list[Found]:
        """Findings in the logs, of the identification if that went before, and of what was learned, in one list."""
        identified = self.model.physics_.report
        fewer = filter(None, map(fewer_rows_were_better, self.model.reports_))
        texts = [*(identified.warnings if identified else []), *fewer, *self.repeated, *too_narrow(self.coverage)]
        return of_result(texts, [*self.train, *self.test])

    def page(self, data: dict[str, Any]) -> RestPage:
        """The report."""
        intervals = residuals_by_log(self.judged, spread_of(self.errors_after, self.spread)[INTERVAL])
        return RestPage(
            model=self.model,
            errors_before=self.errors_before,
            errors_after=self.errors_after,
            residuals_before=residuals_by_log(self.judged, self.errors_before),
            residuals_after=residuals_by_log(self.judged, self.errors_after),
            intervals=[[piece.predicted for piece in pieces] for pieces in intervals],
            data=data,
        )


def show(result: Result, data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    rows = []
    for joint, coverage in zip(data["joints"], data["coverage"], strict=True):
        best = min((candidate["rmse"] for candidate in joint["candidates"]), default=None)
        rows.append(
            [
                joint["joint"],
                joint["inputs"] or "no process",
                points_of(joint),
                significant(joint["physics_rmse_left_out"]),
                significant(best),
                percent(coverage["percent_68"]),
                percent(coverage["percent_95"]),
            ]
        )
    columns = ["joint", "looks at", "points", "left out: physics", "best process", "within 68 %", "within 95 %"]
    output.table(columns, rows, text_columns=(0, 1, 2), spare=("within 68 %", "points", "looks at"))
    show_errors({BEFORE: result.errors_before, AFTER: result.errors_after}, output)
    where = f"On {counted(len(result.test), 'unseen log')}" if result.test else "On the training logs"
    before, after = (c.relative_error_percent for c in (result.errors_before, result.errors_after))
    output.heading(
        f"{where} the error is {percent(after)} % of the torque; the physics alone leaves {percent(before)} %."
    )
