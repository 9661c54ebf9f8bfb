"""`sgpr info`: what a robot, a log or a model holds."""

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from .. import Robot
from ..report.certificate import kept_out
from ..report.numbers import MISSING, counted, percent, readable, relative_deviation, significant, with_deviation
from ..report.parameters import left_out
from ..report.rest import points_of
from . import describe
from .console import Output
from .effects import checked_effects
from .errors import BAD_DATA, of_command_line
from .findings import STYLES, of_texts
from .inputs import kind_of, load_any_model
from .options import Gravity
from .project import remember
from .reading import ReadingOptions, expand_patterns, read_log
from .robots import load_robot
from .screening import screened


def info(
    files: Annotated[
        list[str], typer.Argument(metavar="FILE", help="Robots (URDF, DH table, puma560, two_link), logs, models.")
    ],
    reading: ReadingOptions,
    output: Output,
    effects: Annotated[
        list[str] | None,
        typer.Option(
            "--effects",
            metavar="EFFECT...",
            help="Count base parameters and screen logs with these effects.",
        ),
    ] = None,
    base_parameters: Annotated[
        bool,
        typer.Option("--base-parameters", help="Base parameters of robots as formulas: XX2R = XX2 - YY2 + 0.1865 M3."),
    ] = False,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="Robot of the logs: screens them against its physics (signs, units, delays, outliers, leverage, "
            "saturation, excitation).",
        ),
    ] = None,
    joints: Annotated[
        list[str] | None, typer.Option("--joints", metavar="JOINT...", help="Look at these joints only.")
    ] = None,
    gravity: Gravity = None,
) -> None:
    """Shows what robots, logs and saved models hold, and what is wrong with them.

    Exits with 1 if `sgpr identify` would refuse one of the logs.
    """
    chosen = checked_effects(effects or [])
    arm = None if robot is None else load_robot(robot, joints, gravity)
    results: list[dict[str, Any]] = []
    logs: list[str] = []
    robots = [robot] if robot else []
    paths = expand_patterns(files)
    for path in paths:
        match kind_of(path):
            case "robot":
                robots.append(path)
                data = describe.robot(load_robot(path, joints, gravity), path, chosen)
                show_robot(data, output, formulas=base_parameters, alone=len(paths) == 1)
            case "model":
                data = describe.any_model(load_any_model(path), path)
                show_model(data, output)
            case "log":
                logs.append(path)
                data = look_at_log(path, reading, arm, joints, effects)
                show_log(data, output)
        results.append(data)
    output.result(results)
    if any(data.get("refused") for data in results):
        raise typer.Exit(BAD_DATA)
    named = robots[0] if robots else "ROBOT"
    without = [data for data in results if data.get("has_torque") is False]
    if without:
        columns = f"torque={torque_columns(without[0]) or 'NAME{}'}"
        output.next("sgpr", "info", *paths, "--columns", columns, "--remember", why="if these hold the torques")
    elif logs:
        output.next("sgpr", "identify", "--robot", named, "--train", *logs, "--out", "result")


def look_at_log(
    path: str, reading: ReadingOptions, arm: Robot | None, joints: Sequence[str] | None, effects: list[str] | None
) -> dict[str, Any]:
    """A log after its repairs, with what would stop `sgpr identify`: `refused`."""
    log = read_log(path, reading, joints if arm is None else arm.joint_names)
    if reading.remember:
        remember(path, reading.to_dict())
    parts = log.stretches
    issues = [describe.issue(found) for part in parts for found in part.issues]
    data = {**describe.log(log.raw, path), "issues": issues, "actions": log.actions}
    data["refused"] = [found["message"] for found in issues if found["rank"] == "stop"]
    if arm is not None:
        data["screening"] = screened(arm, log, effects)
        data["refused"] += [text for text in [data["screening"]["refused"]] if text is not None]
    return data


def torque_columns(log: dict[str, Any]) -> str | None:
    """Columns that could be torques: one for each joint, that differ by the joint's number or name alone."""
    names = [joint["name"] for joint in log["joints"]]
    found: dict[tuple[str, ...], str] = {}
    for first in log["channels"]:
        for sign, each in (("{}", [str(number) for number in range(1, len(names) + 1)]), ("{name}", names)):
            pattern = first.replace(each[0], sign) if each[0] in first else None
            columns = tuple(pattern.replace(sign, one) for one in each) if pattern else ()
            if pattern and all(column in log["channels"] for column in columns):
                found.setdefault(columns, pattern)
    return next(iter(found.values())) if len(found) == 1 else None


def show_robot(data: dict[str, Any], output: Output, *, formulas: bool = False, alone: bool = True) -> None:
    """A robot for people; beside logs in short."""
    output.heading(f"{data['file']}: robot {data['name']}, {counted(data['dof'], 'joint')}")
    rows = [
        [
            joint["name"],
            joint["kind"],
            _interval(joint["lower"], joint["upper"], joint["position_unit"]),
            _limit(joint["velocity"], f"{joint['position_unit']}/s"),
            _limit(joint["effort"], joint["torque_unit"]),
        ]
        for joint in data["joints"]
    ]
    output.table(["joint", "kind", "position", "speed up to", "torque up to"], rows, text_columns=(0, 1))
    gravity = ", ".join(significant(float(g)) for g in data["gravity"])
    output.line(f"moving mass {significant(data['moving_mass_kg'], 4)} kg, gravity ({gravity}) m/s² in base axes")
    base = data["base_parameters"]
    beside = f" with {', '.join(data['effects'])}" if data["effects"] else ""
    if not (formulas or alone):
        output.line(f"{counted(len(base), 'base parameter')}{beside} (`sgpr info {data['file']}` lists them)")
        show_warnings(data, output)
        return
    output.line(f"{counted(len(base), 'base parameter')}{beside}:")
    if formulas:
        numbers = ", ".join(f"{number} {joint['name']}" for number, joint in enumerate(data["joints"], start=1))
        output.line(f"links and joints: {numbers}; SI units")
        for p in base:
            output.line(f"  {p['formula']}")
    else:
        output.table(
            ["base parameter", "unit", "stands for"],
            [[p["name"], p["unit"], readable(p["expression"])] for p in base],
            text_columns=(0, 1, 2),
        )
    meanings = {
        "identifiable": "motion tells them one by one",
        "combination": "motion tells only combinations of them",
        "invisible": "motion tells nothing of them",
    }
    classes = data["standard_parameter_classes"]
    for kind, meaning in meanings.items():
        names = [name for name, found in classes.items() if found == kind]
        output.line(f"{len(names)} parameters {kind} ({meaning}): {', '.join(names) or 'none'}")
    show_warnings(data, output)


def show_warnings(data: dict[str, Any], output: Output) -> None:
    """What is odd about a robot file."""
    for text in data["warnings"]:
        output.line(f"look: {text}", "yellow")
    output.line("")


def show_log(data: dict[str, Any], output: Output) -> None:
    """A log for people."""
    rate = "rate unknown" if data["rate_hz"] is None else f"{significant(data['rate_hz'], 4)} Hz"
    output.heading(
        f"{data['file']}: log of {counted(len(data['joints']), 'joint')}, {counted(data['samples'], 'sample')}, "
        f"{significant(data['duration_s'], 4)} s, {rate}"
    )
    rows = [
        [joint["name"], *(_bounds(joint[quantity]) for quantity in ("position", "velocity", "torque"))]
        for joint in data["joints"]
    ]
    output.table(["joint", "position [rad, m]", "speed [rad/s, m/s]", "torque [N·m, N]"], rows)
    if data["channels"]:
        output.table(["other channel", "range"], [[name, _bounds(found)] for name, found in data["channels"].items()])
    if data["columns"] is not None:
        output.line(f"columns: {data['columns']['text']}")
    if not data["has_torque"]:
        pattern = torque_columns(data)
        text = f"no torque in this log: name its columns, --columns torque={pattern or '...'}"
        text += " (motor currents: and --torque-constants); without it sgpr predict alone can use the log"
        output.line(f"look: {text}", "yellow")
    show_findings(data["issues"], [*data["notes"], *data["actions"]], output)
    if data["has_torque"] and not data["issues"]:
        output.line("nothing suspicious found")
    if "screening" in data:
        show_screening(data["screening"], output)
    output.line("")


def show_findings(issues: Sequence[dict[str, Any]], notes: Sequence[str], output: Output) -> None:
    """What was found in a log, worst first."""
    for found in issues:
        output.line(f"{found['rank']}: {of_command_line(found['message'])}", STYLES[found["rank"]])
    for text in notes:
        output.line(f"know: {of_command_line(text)}")


def show_screening(found: dict[str, Any], output: Output) -> None:
    """What the physics of the robot says of a log."""
    if found["refused"] is not None:
        output.line(f"stop: {of_command_line(found['refused'])}", STYLES["stop"])
        return
    output.line(found["excitation"])
    for one in of_texts(found["findings"]):
        output.line(one.line(), STYLES[one.rank])
    if not found["findings"]:
        output.line("the physics of the robot finds nothing suspicious")


def show_model(data: dict[str, Any], output: Output) -> None:
    """A model for people."""
    output.heading(
        f"{data['file']}: torque model of {data['robot']}, {counted(len(data['joints']), 'joint')}, written by sgpr "
        f"{data['library_version']}"
    )
    output.line(f"effects: {', '.join(data['effects']) or 'none'}")
    fit = data["fit"]
    if fit is None:
        output.line("not identified from logs: the parameters are those it was made with")
    else:
        output.line(
            f"identified by {fit['method']}, condition number {significant(fit['condition'])} (columns scaled: "
            f"{significant(fit['scaled_condition'])})"
        )
    chosen = data["processing"]
    if chosen is not None:
        band = chosen["torque_cutoff_hz"]
        output.line(
            f"positions filtered at {significant(chosen['cutoff_hz'])} Hz, torques "
            + (f"at {significant(band)} Hz" if band else "not filtered")
            + f", every {chosen['decimation']}. row taken"
        )
    for path in data["logs"]:
        output.line(f"log: {path}")
    for text in data["history"]:
        output.line(f"history: {text}")
    show_parameters(data["parameters"], output)
    show_terms(data["terms"], output)
    if data["certificate"]:
        show_certificate(data["certificate"], output)
    if "processes" in data:
        show_processes(data["processes"], output)
    output.line("")


def show_parameters(parameters: Sequence[dict[str, Any]], output: Output) -> None:
    """Parameters with their standard deviations."""
    rows = []
    for p in parameters:
        value, deviation = with_deviation(p["value"], p["standard_deviation"])
        if p["determined"] is False:
            deviation = "not excited"
        relative = relative_deviation(p["relative_standard_deviation_percent"]) if p["determined"] else MISSING
        if left_out(p):
            value, deviation, relative = "0", "left out", MISSING
        rows.append([p["name"], value, deviation, relative, significant(p["nominal"], 4), p["unit"]])
    columns = ["base parameter", "value", "std. deviation", "%", "nominal", "unit"]
    output.table(columns, rows, text_columns=(0, 5), spare=("nominal",))


def show_terms(terms: Sequence[dict[str, Any]], output: Output) -> None:
    """Constants and parameters of the effects at single sites."""
    rows = [[p["effect"], p["name"], *with_deviation(p["value"], p["standard_deviation"]), p["unit"]] for p in terms]
    if rows:
        output.table(["effect", "parameter", "value", "std. deviation", "unit"], rows, text_columns=(0, 1, 4))


def show_certificate(certificate: dict[str, Any], output: Output) -> None:
    """The proof that every link is a body."""
    rows = [
        [
            link["joint"],
            significant(link["mass"], 4),
            ", ".join(significant(value, 3) for value in link["centre"]),
            ", ".join(significant(value, 3) for value in link["principal_moments"]),
            significant(link["smallest_eigenvalue"], 3),
        ]
        for link in certificate["links"]
    ]
    columns = ["link of", "mass [kg]", "centre of mass [m]", "principal moments [kg·m²]", "smallest eigenvalue"]
    output.table(columns, rows, text_columns=(0, 2, 3), title="Links as bodies")
    for name in certificate["active"]:
        output.line(f"at its limit: {name}")
    for price in certificate["prices"]:
        output.line(
            f"{percent(100.0 * price['share'])} % of what consistency costs would be gone without: {price['limit']}"
        )
    if certificate["stages"]:
        whole = percent(certificate["residual_percent"])
        output.line(
            f"the weighted residual is {whole} % larger than without limits; limits left out one after the other:"
        )
    for stage in certificate["stages"]:
        output.line(f"{percent(stage['residual_percent'])} % with this one left out too: {stage['limit']}")
    if certificate["kept_out"]:
        output.line(kept_out(certificate["kept_out"]))


def show_processes(processes: Sequence[dict[str, Any]], output: Output) -> None:
    """What was learned of the rest."""
    rows = [[p["joint"], p["inputs"] or "no process", points_of(p)] for p in processes]
    output.table(
        ["joint", "process looks at", "points"], rows, text_columns=(0, 1, 2), title="What physics leaves over"
    )


def _bounds(found: list[float] | None) -> str:
    return MISSING if found is None else f"{significant(found[0])} … {significant(found[1])}"


def _interval(lower: float, upper: float, unit: str) -> str:
    if lower == float("-inf") and upper == float("inf"):
        return "no limit"
    return f"{significant(lower)} … {significant(upper)} {unit}"


def _limit(value: float, unit: str) -> str:
    return "no limit" if value == float("inf") else f"{significant(value)} {unit}"
