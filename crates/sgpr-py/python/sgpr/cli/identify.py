"""`sgpr identify`: the main job, from a robot and logs to a torque model and a report on it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import Comparison, CutoffInfluence, Model, Recording, Robot, __version__, cutoff_influence
from .. import compare as compare_with
from .. import identify as identify_from
from .. import screen as screen_with
from ..report.identification import IdentificationPage
from ..report.numbers import counted, percent
from ..report.versions import versions
from . import describe
from .console import Output, to_json
from .effects import DEFAULT_EFFECTS, checked_effects
from .error_table import show_errors
from .errors import BadData, one_of, wrong_use
from .info import show_certificate, show_parameters, show_terms
from .options import Gravity, Joints, NoReport, OutFolder, check_unseen
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
from .reading import Log, ReadingOptions, read_logs, stretches
from .robots import load_robot
from .screening import excitation, outside, saturated

FIT = "Identification"
WRONG_POSITION = ("position_in_degrees", "position_jump", "velocity_mismatch")
"""Kinds of findings after which no result can be believed."""


@dataclass(frozen=True)
class IdentificationOptions:
    """How to identify."""

    effects: Annotated[
        list[str] | None,
        typer.Option(
            "--effects",
            metavar="EFFECT...",
            help="Effects beside the rigid body, at all joints or as EFFECT@JOINT at one, or `none`.",
            show_default=" ".join(DEFAULT_EFFECTS),
            rich_help_panel=FIT,
        ),
    ] = None
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="METHOD",
            help="Ordinary or weighted least squares (ols, wls), against outliers (irls, irls:THRESHOLD), drawn to the "
            "robot file (ridge, ridge:DEVIATION), total (tls, tls:NOISE), recursive (rls, rls:FORGETTING).",
            rich_help_panel=FIT,
        ),
    ] = "wls"
    consistent: Annotated[
        bool,
        typer.Option(
            "--consistent",
            help="Every link a body, friction and rotors not negative; also writes robot.urdf and robot.xml (MJCF).",
            rich_help_panel=FIT,
        ),
    ] = False
    prior: Annotated[
        str | None,
        typer.Option(
            "--prior",
            metavar="entropic|euclidean",
            help="With --consistent: how the distance to the robot file is measured where the data are silent.",
            show_default="entropic",
            rich_help_panel=FIT,
        ),
    ] = None
    prior_deviation: Annotated[
        str | None,
        typer.Option(
            "--prior-deviation",
            metavar="SHARE|auto",
            help="With --consistent: relative standard deviation of the robot file's values; auto: the data choose.",
            show_default="30",
            rich_help_panel=FIT,
        ),
    ] = None
    bounds: Annotated[
        str | None,
        typer.Option(
            "--bounds",
            metavar="FILE",
            help='With --consistent: limits in JSON, {"joint_2": {"mass": [1, 5], "box": [[...], [...]]}, '
            '"total_mass": [20, 30], "joint_2.Fv": [0, null]}.',
            rich_help_panel=FIT,
        ),
    ] = None
    essential: Annotated[
        bool,
        typer.Option("--essential", help="Leave out what the data do not support.", rich_help_panel=FIT),
    ] = False
    uncertainty: Annotated[
        str,
        typer.Option(
            "--uncertainty",
            metavar="memory|hac|bootstrap",
            help="Where standard deviations come from: the memory of each joint's residual, residuals correlated over "
            "time and joints, or blocks of the logs drawn again (bootstrap:REPLICATES).",
            rich_help_panel=FIT,
        ),
    ] = "memory"
    start: Annotated[
        str,
        typer.Option(
            "--start",
            metavar="robot_file|zero",
            help="What parameters that the motion does not excite keep: the robot file's values; or zero, if the "
            "torque in the logs is what an internal model leaves over.",
            rich_help_panel=FIT,
        ),
    ] = "robot_file"
    cutoff: Annotated[
        float | None,
        typer.Option(
            "--cutoff",
            metavar="HZ",
            help="Low-pass of the positions.",
            show_default="from spectra",
            rich_help_panel=FIT,
        ),
    ] = None
    order: Annotated[int, typer.Option("--order", help="Order of the low-pass.", rich_help_panel=FIT)] = 4
    differentiation: Annotated[
        str,
        typer.Option(
            "--differentiation",
            help="central, central:4, savitzky_golay:WINDOW:DEGREE.",
            rich_help_panel=FIT,
        ),
    ] = "central"
    torque_band: Annotated[
        str,
        typer.Option(
            "--torque-band",
            metavar="HZ|position|full",
            help="Low-pass of both sides of the equation: as the positions, none (full), or a cut-off.",
            rich_help_panel=FIT,
        ),
    ] = "position"
    decimation: Annotated[
        int | None,
        typer.Option(
            "--decimation", help="Take every so many rows.", show_default="from the cut-off", rich_help_panel=FIT
        ),
    ] = None
    standstill_speed: Annotated[
        float | None,
        typer.Option(
            "--standstill-speed",
            metavar="SPEED",
            help="Slower joints count as standing, rad/s.",
            show_default="from the noise",
            rich_help_panel=FIT,
        ),
    ] = None
    turn_margin: Annotated[
        float,
        typer.Option(
            "--turn-margin",
            metavar="PERIODS",
            help="Periods of the cut-off about each turn of a joint in which its rows do not count.",
            rich_help_panel=FIT,
        ),
    ] = 0.0

    def arguments(self) -> dict[str, Any]:
        """What `sgpr.identify` takes."""
        for value, option in ((self.cutoff, "--cutoff"), (self.standstill_speed, "--standstill-speed")):
            if value is not None and not value > 0.0:
                raise wrong_use("must be greater than zero", option)
        for count, option in ((self.order, "--order"), (self.decimation, "--decimation")):
            if count is not None and count < 1:
                raise wrong_use("must be at least 1", option)
        if not 0.0 <= self.turn_margin < float("inf"):
            raise wrong_use("must be zero or more", "--turn-margin")
        return {
            "effects": checked_effects(DEFAULT_EFFECTS if self.effects is None else self.effects),
            "method": self._method(),
            **self._consistency(),
            "essential": self.essential,
            "uncertainty": self._uncertainty(),
            "start": one_of(self.start, ("robot_file", "zero"), "--start", "start"),
            "cutoff_hz": self.cutoff,
            "filter_order": self.order,
            "differentiation": self.differentiation,
            "torque_band": self._band(),
            "decimation": self.decimation,
            "standstill_speed": self.standstill_speed,
            "turn_margin": self.turn_margin,
        }

    def _method(self) -> str:
        name, _, setting = self.method.partition(":")
        one_of(name, ("ols", "wls", "irls", "ridge", "tls", "rls"), "--method", "method")
        if setting and (name in ("ols", "wls") or not _is_number(setting)):
            raise wrong_use(f"`{self.method}`: expected ols, wls, or irls, ridge, tls, rls with a number", "--method")
        return self.method

    def _uncertainty(self) -> str:
        name, _, count = self.uncertainty.partition(":")
        one_of(name, ("memory", "hac", "bootstrap"), "--uncertainty", "source of standard deviations")
        if count and not (name == "bootstrap" and count.isdigit() and 2 <= int(count) <= MOST_REPLICATES):
            raise wrong_use(f"`{self.uncertainty}`: only bootstrap has a number, from 2 on", "--uncertainty")
        return self.uncertainty

    def _consistency(self) -> dict[str, Any]:
        given = (("--prior", self.prior), ("--prior-deviation", self.prior_deviation), ("--bounds", self.bounds))
        for option, value in given:
            if value is not None and not self.consistent:
                raise wrong_use("belongs to --consistent", option)
        if self.consistent and self.essential:
            raise wrong_use("parameters that are left out make no body: choose one of the two", "--consistent")
        if self.prior is not None:
            one_of(self.prior, ("entropic", "euclidean"), "--prior", "distance")
        return {
            "consistent": self.consistent,
            "prior": self.prior,
            "prior_deviation": self._prior_deviation(),
            "bounds": None if self.bounds is None else _read_bounds(self.bounds),
        }

    def _prior_deviation(self) -> float | str | None:
        if self.prior_deviation is None or self.prior_deviation == "auto":
            return self.prior_deviation
        if not _is_number(self.prior_deviation) or not float(self.prior_deviation) > 0.0:
            raise wrong_use(f"`{self.prior_deviation}`: expected a number above zero, or auto", "--prior-deviation")
        return float(self.prior_deviation)

    def _band(self) -> float | str:
        if self.torque_band in ("position", "full"):
            return self.torque_band
        try:
            hz = float(self.torque_band)
        except ValueError:
            hz = 0.0
        if not hz > 0.0:
            raise wrong_use(
                f"`{self.torque_band}` is neither a cut-off in Hz nor `position` or `full`", "--torque-band"
            )
        return hz


MOST_REPLICATES = 100_000


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_bounds(path: str) -> dict[str, Any]:
    try:
        bounds = json.loads(Path(path).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{path}: no JSON: {error}") from error
    if not isinstance(bounds, dict):
        raise BadData(f"{path}: expected an object of limits by joint or parameter")
    return bounds


def identify(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="URDF, DH table (.toml, .json), puma560 or two_link.")
    ],
    train: Annotated[list[str], typer.Option("--train", metavar="FILE...", help="Logs to identify from.")],
    out: OutFolder,
    fit: IdentificationOptions,
    reading: ReadingOptions,
    output: Output,
    test: Annotated[
        list[str] | None, typer.Option("--test", metavar="FILE...", help="Logs to judge by, not used to identify.")
    ] = None,
    joints: Joints = None,
    gravity: Gravity = None,
    no_report: NoReport = False,
    mcap: Annotated[
        str | None,
        typer.Option(
            "--mcap", metavar="FILE", help="Also write measured, predicted and residual torque of the test logs."
        ),
    ] = None,
) -> None:
    """Identifies a torque model from logs, and says how good it is on logs it has not seen.

    Writes to DIR: model.sgpr, report.html, identification.json and, with test logs, predictions.csv; with --consistent
    also the robot with the inertias found, robot.xml (MJCF) and, from a URDF, robot.urdf.
    """
    options = fit.arguments()
    if mcap is not None and not test:
        raise wrong_use("is written for test logs: name them with --test", "--mcap")
    check_unseen(train, test)
    folder = OutputFolder(out)
    loaded = load_robot(robot, joints, gravity)
    train_logs = read_logs(train, reading, loaded.joint_names, output)
    test_logs = read_logs(test or [], reading, loaded.joint_names, output)
    result = run(loaded, train_logs, test_logs, options, output)
    settings = {
        "robot": robot,
        "joints": joints,
        "gravity": loaded.gravity,
        **options,
        "reading": reading.to_dict(),
    }
    data = result.to_dict(settings)
    with folder:
        result.model.save(folder.file("model.sgpr"))
        if fit.consistent:
            folder.write("robot.xml", result.model.to_mjcf())
            if Path(robot).suffix.lower() == ".urdf":
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
    show(result, data, output)
    output.line(f"results: {folder.path}")
    output.result(data)


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

    @property
    def judged(self) -> list[Log]:
        """The logs of the comparisons."""
        return self.test or self.train

    def to_dict(self, settings: dict[str, Any]) -> dict[str, Any]:
        """All figures."""
        report = self.model.report
        assert report is not None, "just identified"
        return {
            "command": "identify",
            "robot": {"name": self.model.robot.name, "joints": self.model.robot.joint_names},
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
            "comparison": {
                "logs": "test" if self.test else "train",
                BEFORE: describe.comparison(self.before),
                AFTER: describe.comparison(self.after),
            },
            "certificate": self.model.certificate,
            "screening": self.screening(),
            "essential": report.essential,
            "warnings": [*report.warnings, *self.findings],
            "logs": [
                *(describe.repaired_log(log, "train") for log in self.train),
                *(describe.repaired_log(log, "test") for log in self.test),
            ],
            "left_out_of_predictions": {},
            "seeds": {},
            "versions": versions(),
            "library_version": __version__,
        }

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
    training = stretches(train)
    with output.progress() as progress:
        model = identify_from(robot, training, progress=progress, **options)
        influence = cutoff_influence(robot, training, model, progress=progress, **options)
    judged = stretches(test) or training
    nominal = Model.nominal(robot)
    return Result(
        model=model,
        train=list(train),
        test=list(test),
        before=compare_with(nominal, judged, processing=model),
        after=compare_with(model, judged),
        influence=influence,
        findings=_findings(model, training),
        influence_errors=[
            describe.comparison(compare_with(other.model, judged, processing=model)) for other in influence
        ],
    )


def _findings(model: Model, training: Sequence[Recording]) -> list[str]:
    """What is suspicious in the training logs and not said yet."""
    said = [] if model.report is None else model.report.warnings
    found = [text for text in screen_with(model, training) if text not in said]
    return [*found, *saturated(model.robot, training), *outside(model.robot, training)]


def show(result: Result, data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    show_parameters(data["parameters"], output)
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
    for text in data["warnings"]:
        output.warning(text)
    for path, count in data["left_out_of_predictions"].items():
        output.warning(
            f"{path}: {counted(count, 'sample')} without prediction (repairs, or stretches too short to filter)"
        )
    findings = [found for log in data["logs"] for found in log["issues"] if found["severity"] != "note"]
    # A wrong unit spoils all of the above, so it is said here, once for all logs.
    units = [found for found in findings if found["kind"] in WRONG_POSITION]
    for text in dict.fromkeys(found["message"] for found in units):
        output.warning(text)
    if len(findings) > len(units):
        more = counted(len(findings) - len(units), "finding")
        output.warning(f"the logs have {more}{' more' if units else ''}; see the report, or sgpr info")
