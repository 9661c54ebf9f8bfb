"""`sgpr payload`: what hangs on an arm, or what its drives give per ampere, from logs with and without a payload."""

from typing import Annotated, Any

import typer

from .. import identify_drive_gains, identify_payload
from ..report.numbers import percent, significant, with_deviation
from .console import Output, to_json
from .errors import one_of, wrong_use
from .findings import as_data, of_logs
from .findings import show as show_ranked
from .fit_options import BodyOptions, EquationOptions
from .options import Gravity, Joints
from .output_folder import OutputFolder
from .project import joints_of
from .reading import ReadingOptions, read_logs, stretches, tell_layouts
from .results import headed
from .robots import load_robot
from .screening import doubts


def payload(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="URDF, DH table (.toml, .json), puma560 or two_link.")
    ],
    unloaded: Annotated[list[str], typer.Option("--unloaded", metavar="FILE...", help="Logs without the payload.")],
    loaded: Annotated[list[str], typer.Option("--loaded", metavar="FILE...", help="Logs with the payload.")],
    bodies: BodyOptions,
    equations: EquationOptions,
    reading: ReadingOptions,
    output: Output,
    link: Annotated[
        str | None,
        typer.Option("--link", metavar="JOINT", help="Joint whose link holds it.", show_default="the last joint"),
    ] = None,
    friction_may_change: Annotated[
        bool, typer.Option("--friction-may-change", help="Friction may differ with and without the payload.")
    ] = False,
    known: Annotated[
        list[str] | None,
        typer.Option(
            "--known",
            metavar="PARAMETER=VALUE...",
            help="The payload is known, as m=2.805 in kg, and the gains of the drives are looked for: what to multiply "
            "the currents or torques of the logs by.",
        ),
    ] = None,
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            metavar="maximum_likelihood|total_least_squares|least_squares",
            help="With --known: noise in the currents, which is what there is (total least squares with each drive's "
            "errors in its own current, so two names of one estimator); or least squares of torques, which noise draws "
            "to zero. With --consistent links and payload are bodies in either.",
            show_default="maximum_likelihood",
        ),
    ] = None,
    lowest_gains: Annotated[
        list[float] | None,
        typer.Option(
            "--lowest-gains",
            metavar="GAIN...",
            help="With --known: lower bounds of the gains, for least_squares or with --consistent.",
        ),
    ] = None,
    joints: Joints = None,
    gravity: Gravity = None,
    out: Annotated[str | None, typer.Option("--out", metavar="DIR", help="Folder for payload.json.")] = None,
) -> None:
    """Identifies a payload from logs with it and without it; or, with --known, the gains of the drives.

    A payload is held to a body unless --no-consistent is given; with --known and --consistent the links are bodies too.
    """
    options = equations.arguments()
    if known:
        options.update(bodies.arguments())
        options["estimator"] = one_of(
            estimator or "maximum_likelihood",
            ("maximum_likelihood", "total_least_squares", "least_squares"),
            "--estimator",
            "estimator",
        )
        options["lowest"] = lowest_gains
    else:
        given = [("--estimator", estimator), ("--lowest-gains", lowest_gains), *bodies.given()]
        for option, value in given:
            if value is not None:
                raise wrong_use("belongs to --known", option)
        options["consistent"] = bodies.arguments(default=True)["consistent"]
    both = sorted(set(unloaded) & set(loaded))
    if both:
        raise wrong_use(f"{', '.join(both)}: a log is with the payload or without it", "--loaded")
    payload_of = _known(known or [])
    joints = joints_of(robot, joints, unloaded)
    arm = load_robot(robot, joints, gravity)
    if link is not None and link not in arm.joint_names:
        raise wrong_use(f"`{link}`: the joints are {', '.join(arm.joint_names)}", "--link")
    folder = OutputFolder(out) if out else None
    unloaded_logs = read_logs(unloaded, reading, arm.joint_names, output)
    loaded_logs = read_logs(loaded, reading, arm.joint_names, output)
    without, with_it = stretches(unloaded_logs), stretches(loaded_logs)
    data: dict[str, Any] = headed(
        "payload",
        arm,
        unloaded=unloaded,
        loaded=loaded,
        link=link or arm.joint_names[-1],
        settings={**options, "reading": reading.to_dict(), "friction_may_change": friction_may_change},
    )
    told = of_logs([*unloaded_logs, *loaded_logs])
    with output.progress() as progress:
        if payload_of:
            gains = identify_drive_gains(
                arm, without, with_it, payload=payload_of, link=link, progress=progress, **options
            )
            data["known"] = payload_of
            data["gains"] = gains.gains
            data["standard_deviations"] = gains.standard_deviations
        else:
            found = identify_payload(
                arm,
                without,
                with_it,
                link=link,
                friction_may_change=friction_may_change,
                progress=progress,
                **options,
            )
            processing = {key: value for key, value in options.items() if key != "consistent"}
            told = [*doubts(arm, unloaded_logs, processing, progress), *of_logs(loaded_logs)]
            data["mass"] = found.mass
            data["mass_standard_deviation"] = found.mass_deviation
            data["centre"] = found.centre
            data["parameters"] = found.to_dict()
    data["messages"] = as_data(told)
    if folder:
        with folder:
            folder.write("payload.json", to_json(data))
    tell_layouts([*unloaded_logs, *loaded_logs], output, of_all=joints is None)
    if payload_of:
        show_gains(data, output)
    else:
        show_payload(data, output)
    show_ranked(told, output, "see sgpr info")
    if folder:
        output.line(f"results: {folder.path}")
    output.result(data)


def _known(pairs: list[str]) -> dict[str, float]:
    given = {}
    for pair in pairs:
        name, _, text = pair.partition("=")
        try:
            given[name] = float(text)
        except ValueError:
            raise wrong_use(f"`{pair}`: expected PARAMETER=VALUE, as m=2.805", "--known") from None
    return given


def show_payload(data: dict[str, Any], output: Output) -> None:
    """The payload for people."""
    mass, deviation = with_deviation(data["mass"], data["mass_standard_deviation"])
    centre = ", ".join(significant(float(value), 3) for value in data["centre"])
    output.heading(f"payload of {mass} ± {deviation} kg on {data['link']}, centre of mass at ({centre}) m in its frame")
    rows = []
    for parameter in data["parameters"]:
        value, spread = with_deviation(parameter["value"], parameter["standard_deviation"])
        rows.append([parameter["name"], value, spread, parameter["unit"]])
    output.table(["parameter", "value", "std. deviation", "unit"], rows, text_columns=(0, 3))


def show_gains(data: dict[str, Any], output: Output) -> None:
    """The gains for people."""
    output.heading("gains of the drives: multiply the logged currents or torques by them")
    rows = []
    for joint, gain, deviation in zip(data["robot"]["joints"], data["gains"], data["standard_deviations"], strict=True):
        value, spread = with_deviation(float(gain), float(deviation))
        rows.append([joint, value, spread, percent(100.0 * float(deviation) / float(gain))])
    output.table(["joint", "gain", "std. deviation", "%"], rows)
