"""`sgpr info`: what a robot, a log or a model holds."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import typer

from .. import RecordingError, Robot, SgprError
from .._sgpr import quantity_of_array
from .._workbench.remedies import proposals
from ..report.certificate import kept_out
from ..report.numbers import MISSING, counted, percent, readable, relative_deviation, significant, with_deviation
from ..report.parameters import left_out
from ..report.rest import points_of
from . import describe
from .console import Output
from .effects import checked_effects
from .errors import BAD_DATA, of_command_line
from .findings import STYLES, Found, merged, of_texts
from .inputs import kind_of, load_any_model
from .options import Gravity
from .project import joints_of, remember
from .reading import ReadingOptions, expand_patterns, read_log
from .robots import is_urdf, load_robot, tell_locked
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
            "saturation, excitation). A single robot among the files is it, too.",
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
    results: list[dict[str, Any]] = []
    paths = expand_patterns(files)
    kinds = {path: kind_of(path) for path in paths}
    logs = [path for path in paths if kinds[path] == "log"]
    named = robot or robot_among(kinds)
    arm = load_robot(named, joints_of(named, joints, logs), gravity) if named and logs else None
    if arm is not None and named:
        tell_locked(named, arm, output)
    for path in paths:
        match kinds[path]:
            case "robot":
                data = describe.robot(load_robot(path, joints, gravity), path, chosen)
                show_robot(data, output, formulas=base_parameters, alone=len(paths) == 1)
            case "model":
                data = describe.any_model(load_any_model(path), path)
                show_model(data, output)
            case "log":
                data = look_at_log(path, reading, arm, joints, effects, output)
                show_log(data, output)
        results.append(data)
    output.result(results)
    refused = [data for data in results if data.get("refused")]
    asked = next((data for data in refused if columns_to_name(data) or has_currents(data)), None)
    of_arm = [*(["--joints", *joints] if joints else []), *(["--gravity", *map(str, gravity)] if gravity else [])]
    if asked is not None:
        beside = ["--robot", robot] if robot else []
        fewer = joints_in_log(asked, arm) if arm is not None and named and is_urdf(named) else []
        if fewer:
            why = "if the log holds these joints and the others stand"
            output.next("sgpr", "info", *paths, *beside, "--joints", *fewer, *reading.words(), why=why)
        else:
            next_look(asked, paths, [*beside, *of_arm], reading, output)
    elif repairs := named_repairs(refused):
        beside = [*(["--robot", robot] if robot else []), *of_arm]
        words = replace(reading, remember=False).words()
        output.next("sgpr", "info", *paths, *beside, *words, *repairs, "--remember", why="if that is right")
    elif logs and not refused:
        train = ["--train", *logs, *of_arm, *reading.words()]
        output.next("sgpr", "identify", "--robot", named or "ROBOT", *train, "--out", "result")
    if refused:
        raise typer.Exit(BAD_DATA)


LOOKS_LIKE = {"it looks like degrees": "position=deg", "it looks like milliradians": "position=mrad"}
"""What a message says of a unit -> how the command line says it."""


def named_repairs(refused: Sequence[dict[str, Any]]) -> list[str]:
    """The options that repair all that stops these logs; none where a message leaves something else to be decided."""
    settings: dict[str, Any] = {}
    units: dict[str, None] = {}
    for text in (text for log in refused for text in log["refused"]):
        if unit := next((unit for said, unit in LOOKS_LIKE.items() if said in text), None):
            if "other joints do not look so" in text:
                return []
            units[unit] = None
            continue
        proposed = [each["settings"] for each in proposals([text])]
        if not proposed or any("accept" in each for each in proposed):
            return []
        for each in proposed:
            settings |= {key: min(value, settings.get(key, value)) for key, value in each.items()}
    if len(units) > 1:
        return []
    words = [word for unit in units for word in ("--units", unit)]
    for key, value in settings.items():
        words += [f"--{key.replace('_', '-')}", *([f"{value:g}"] if key == "resample" else [])]
    return words


def next_look(
    log: dict[str, Any], paths: Sequence[str], beside: Sequence[str], reading: ReadingOptions, output: Output
) -> None:
    """The command that says which columns are meant, and where they are currents, what a drive makes of one ampere."""
    told = columns_to_name(log)
    words = replace(reading, columns=None, remember=False).words()
    names = ["--columns", *told] if told else []
    if has_currents(log):
        constants = ["--torque-constants", *(f"{joint['name']}=K" for joint in log["joints"])]
        why = "K: N·m at the joint per A, of each drive"
    else:
        constants = []
        why = "if these hold the torques" if log["unlike"] is None else "if these are they, in the order of the robot"
    output.next("sgpr", "info", *paths, *beside, *words, *names, *constants, "--remember", why=why)


def joints_in_log(log: dict[str, Any], arm: Robot) -> list[str]:
    """The joints of an arm that a log with fewer of them may hold: those of its names, or the first ones; else none."""
    names = [joint["name"] for joint in log["joints"]]
    if log["unlike"] is None or len(names) >= arm.dof:
        return []
    return names if set(names) <= set(arm.joint_names) else arm.joint_names[: len(names)]


def robot_among(kinds: Mapping[str, str]) -> str | None:
    """The robot of logs that stand beside it: the only one."""
    robots = [path for path, kind in kinds.items() if kind == "robot"]
    return robots[0] if len(robots) == 1 else None


def look_at_log(
    path: str,
    reading: ReadingOptions,
    arm: Robot | None,
    joints: Sequence[str] | None,
    effects: list[str] | None,
    output: Output,
) -> dict[str, Any]:
    """A log after its repairs, with what would stop `sgpr identify`: `refused`."""
    unlike = None
    try:
        log = read_log(path, reading, joints if arm is None else arm.joint_names)
    except RecordingError as error:
        if arm is None:
            raise
        # What the log holds says more than that the robot's joints are not in it.
        unlike = str(error)
        try:
            log = read_log(path, reading, None)
        except SgprError:
            raise error from None
    if reading.remember and unlike is None:
        remember(path, reading.to_dict())
    parts = log.stretches
    issues = [describe.issue(found) for part in parts for found in part.issues]
    data = {**describe.log(log.raw, path), "issues": issues, "actions": log.actions, "unlike": unlike}
    data["refused"] = [found["message"] for found in issues if found["rank"] == "stop"]
    data["refused"] += [text for text in (unlike, without_torque(data)) if text is not None]
    if arm is not None and not data["refused"]:
        with output.progress() as progress:
            data["screening"] = screened(arm, log, effects, progress)
        data["screening"]["findings"] = [text for text in data["screening"]["findings"] if text not in arm.warnings]
        data["refused"] += [text for text in [data["screening"]["refused"]] if text is not None]
    return data


def without_torque(log: dict[str, Any]) -> str | None:
    """What is said of a log without torque."""
    if log["has_torque"]:
        return None
    without = "without it sgpr predict alone can use the log"
    if has_currents(log):
        return f"no torque in this log, but motor currents: give --torque-constants, N·m per A; {without}"
    return (
        f"no torque in this log: name its columns, --columns torque={torque_columns(log) or '...'} (motor currents: "
        f"and --torque-constants); {without}"
    )


def has_currents(log: dict[str, Any]) -> bool:
    """Whether there is no torque, but a current for each joint."""
    pattern = None if log["has_torque"] else torque_columns(log)
    return pattern is not None and quantity_of_array(pattern.replace("{name}", "").replace("{}", "")) == "current"


def columns_to_name(log: dict[str, Any]) -> list[str]:
    """What `--columns` would say of a log without torque, or with other names for its joints than the robot has."""
    torque = torque_columns(log)
    told = [] if log["has_torque"] or torque is None or has_currents(log) else [f"torque={torque}"]
    if log["unlike"] is None:
        return told
    joints = (log["columns"] or {"joints": []})["joints"]
    for quantity in ("torque", "velocity", "position"):
        columns = [joint[quantity]["column"] for joint in joints if joint[quantity] is not None]
        pattern = pattern_of(columns)
        if pattern is not None:
            told.insert(0, f"{quantity}={pattern}")
    return told


def pattern_of(columns: Sequence[str]) -> str | None:
    """A pattern for columns in the order of their joints, or their list; None if there is no way to say it."""
    for place, letter in enumerate(columns[0] if columns else ""):
        if letter == "1":
            before, after = columns[0][:place], columns[0][place + 1 :]
            if list(columns) == [f"{before}{k + 1}{after}" for k in range(len(columns))]:
                return f"{before}{{}}{after}"
    return None if not columns or any("," in column for column in columns) else ",".join(columns)


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
    for one in of_texts(data["warnings"]):
        output.line(one.line(), STYLES[one.rank])
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
    for text in (data["unlike"], without_torque(data)):
        if text is not None:
            output.line(f"stop: {of_command_line(text)}", STYLES["stop"])
    show_findings(data["issues"], [*data["notes"], *data["actions"]], output)
    if not (data["issues"] or data["refused"] or "screening" in data):
        output.line("nothing suspicious found")
    if "screening" in data:
        show_screening(data["screening"], output)
    output.line("")


def show_findings(issues: Sequence[dict[str, Any]], notes: Sequence[str], output: Output) -> None:
    """What was found in a log, worst first."""
    for one in merged([Found(i["rank"], of_command_line(i["message"]), channel=i["channel"]) for i in issues]):
        output.line(one.line(), STYLES[one.rank])
    for text in notes:
        output.line(f"know: {of_command_line(text)}")


def show_screening(found: dict[str, Any], output: Output) -> None:
    """What the physics of the robot says of a log."""
    if found["refused"] is not None:
        output.line(f"stop: {of_command_line(found['refused'])}", STYLES["stop"])
        return
    output.line(found["excitation"])
    show_how_much_data(found["how_much_data"], output)
    for one in of_texts(found["findings"]):
        output.line(one.line(), STYLES[one.rank])
    if not found["findings"]:
        output.line("nothing suspicious found, by the physics of the robot neither")


def show_how_much_data(found: dict[str, Any], output: Output) -> None:
    """What uncertain parameters bring to the torque of other motion, and whether that is little enough."""
    output.line(of_command_line(found["answer"]))
    rows = [
        [joint["name"], *(significant(value, 2) for value in (joint["noise"], *joint["standard_deviations"]))]
        for joint in found["joints"]
    ]
    after = [f"{significant(seconds, 2)} s" for seconds in found["seconds"]]
    output.line("noise, and what uncertain parameters add to it after so many seconds, N·m (N):")
    output.table(["joint", "noise", *after], rows)


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
            + f", one row of {chosen['decimation']} taken"
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
