"""`sgpr excite`: a motion that reveals the parameters of a robot within its limits."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import Excitation, Robot
from .. import excite as excite_robot
from ..report.motion import MotionPage, kind_of_parameters
from ..report.numbers import counted, significant
from .console import Output, to_json
from .effects import checked_effects, effects_option
from .errors import check_seed, one_of, wrong_use
from .inputs import load_model
from .options import Gravity, OutFolder
from .output_folder import OutputFolder
from .results import headed
from .robots import is_urdf, load_robot
from .screening import how_much_to_record

DEFAULT_EFFECTS = ("viscous_friction", "coulomb_friction")
CRITERIA = (
    "condition",
    "frobenius_condition",
    "sum_of_conditions",
    "static_conditions",
    "dynamic_conditions",
    "d_optimality",
    "hadamard",
)
BASES = ("fourier", "b_spline", "point_to_point")


def excite(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="URDF, DH table (.toml, .json), puma560 or two_link.")
    ],
    max_acceleration: Annotated[
        list[float],
        typer.Option("--max-acceleration", metavar="A...", help="Per joint, or one for all, rad/s² (m/s²)."),
    ],
    out: OutFolder,
    output: Output,
    effects: Annotated[
        list[str] | None,
        effects_option(
            "Effects whose parameters shall be revealed too, or `none`; nonlinear ones about nominal values.",
            usual=DEFAULT_EFFECTS,
        ),
    ] = None,
    criterion: Annotated[
        str, typer.Option("--criterion", help=f"What is made small: {', '.join(CRITERIA)}.")
    ] = "condition",
    basis: Annotated[str, typer.Option("--basis", help="fourier, b_spline or point_to_point.")] = "fourier",
    fundamental: Annotated[float, typer.Option("--fundamental", metavar="HZ", help="One over the period.")] = 0.1,
    terms: Annotated[int, typer.Option("--terms", help="Harmonics of the series.")] = 4,
    harmonics: Annotated[
        list[int] | None,
        typer.Option(
            "--harmonics",
            metavar="FIRST LAST",
            help="Instead: these, as of a high-frequency series.",
            show_default=False,
        ),
    ] = None,
    duration: Annotated[float, typer.Option("--duration", metavar="S", help="Of splines and points.")] = 10.0,
    points: Annotated[int, typer.Option("--points", help="Control points of a spline, or points.")] = 12,
    position_range: Annotated[
        list[float] | None,
        typer.Option(
            "--position-range",
            metavar="LOW HIGH...",
            help="Per joint, or one pair for all, rad (m).",
            show_default="robot file",
        ),
    ] = None,
    max_velocity: Annotated[
        list[float] | None,
        typer.Option("--max-velocity", metavar="V...", help="Per joint, or one for all.", show_default="robot file"),
    ] = None,
    max_torque: Annotated[
        list[float] | None,
        typer.Option("--max-torque", metavar="TAU...", help="Per joint, or one for all.", show_default="robot file"),
    ] = None,
    floor: Annotated[
        float | None, typer.Option("--floor", metavar="Z", help="Height that links stay above, m.")
    ] = None,
    box: Annotated[
        list[float] | None,
        typer.Option(
            "--box",
            metavar="X Y Z X Y Z...",
            help="Lowest and highest corner of every box that links stay out of, base axes, m.",
            show_default=False,
        ),
    ] = None,
    self_collision: Annotated[
        bool, typer.Option("--self-collision", help="Keep links that are no neighbours apart.")
    ] = False,
    link_radius: Annotated[
        float | None,
        typer.Option(
            "--link-radius", metavar="R", help="Of the links, m.", show_default="collision shapes of a URDF, else 0.05"
        ),
    ] = None,
    clearance: Annotated[float, typer.Option("--clearance", metavar="D", help="Distance that is kept, m.")] = 0.0,
    max_tip_speed: Annotated[
        float | None, typer.Option("--max-tip-speed", metavar="V", help="Of the tool, m/s.")
    ] = None,
    start: Annotated[
        list[float] | None,
        typer.Option("--start", metavar="Q...", help="Position at both ends.", show_default="zero or mid-range"),
    ] = None,
    noise: Annotated[
        list[float] | None,
        typer.Option(
            "--torque-noise",
            metavar="S...",
            help="Standard deviations of the torque, which weigh the joints, N·m (N).",
            show_default="all alike",
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="MODEL",
            help="Saved model that torque limits are checked with, friction included; its effects are excited.",
            show_default="rigid body of the robot file",
        ),
    ] = None,
    starts: Annotated[int, typer.Option("--starts", help="Searches from different random motions.")] = 6,
    evaluations: Annotated[int, typer.Option("--evaluations", help="Evaluations per search.")] = 1500,
    seed: Annotated[int, typer.Option("--seed", help="Of the random motions.")] = 0,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="Samples in the files.")] = 100.0,
    joints: Annotated[
        list[str] | None,
        typer.Option("--joints", metavar="JOINT...", help="Joints of the URDF to move; the others are locked."),
    ] = None,
    gravity: Gravity = None,
) -> None:
    """Finds a motion that reveals the parameters of a robot and stays within its limits.

    Writes to DIR: trajectory.csv, trajectory.mcap (JointTrajectory), excitation.json and report.html. Ctrl-C ends the
    search and keeps the best motion so far.
    """
    for value, option in ((starts, "--starts"), (evaluations, "--evaluations")):
        if value < 1:
            raise wrong_use("must be at least 1", option)
    if not rate > 0.0:
        raise wrong_use("must be greater than zero", "--rate")
    check_seed(seed)
    known = None if model is None else load_model(model, joints)
    usual = DEFAULT_EFFECTS if known is None else known.effects
    chosen = checked_effects(usual if effects is None else effects)
    one_of(criterion, CRITERIA, "--criterion", "criterion")
    one_of(basis, BASES, "--basis", "basis")
    folder = OutputFolder(out)
    loaded = load_robot(robot, joints, gravity)
    options: dict[str, Any] = {
        "criterion": criterion,
        "basis": basis,
        "fundamental_hz": fundamental,
        "terms": terms,
        "harmonics": first_and_last(harmonics),
        "duration": duration,
        "points": points,
        "max_acceleration": per_joint(max_acceleration, loaded, "--max-acceleration"),
        "position_range": pair_per_joint(position_range, loaded, "--position-range"),
        "max_velocity": per_joint(max_velocity, loaded, "--max-velocity"),
        "max_torque": per_joint(max_torque, loaded, "--max-torque"),
        "floor": floor,
        "boxes": corners(box),
        "self_collision": self_collision,
        "link_radius": link_radius,
        # Only where something must be kept clear of.
        "link_shapes": robot
        if link_radius is None and (floor is not None or box or self_collision) and is_urdf(robot)
        else None,
        "clearance": clearance,
        "max_tip_speed": max_tip_speed,
        "start": per_joint(start, loaded, "--start"),
        "noise": per_joint(noise, loaded, "--torque-noise"),
        "starts": starts,
        "max_evaluations": evaluations,
        "random_state": seed,
    }
    with output.progress() as progress:
        found = excite_robot(loaded, chosen, model=known, progress=progress, **options)
    data = to_dict(found, loaded, {"robot": robot, "model": model, "effects": chosen, "rate_hz": rate, **options})
    with folder:
        found.trajectory.save_csv(folder.file("trajectory.csv"), rate)
        found.trajectory.save_mcap(folder.file("trajectory.mcap"), rate)
        folder.write("report.html", MotionPage(loaded, found, data).html())
        folder.write("excitation.json", to_json(data))
    show(found, loaded, data, output)
    output.line(f"results: {Path(out)}")
    output.next(
        "sgpr", "identify", "--robot", robot, "--train", "LOG.csv", "--out", "result", why="the log of this motion"
    )
    output.result(data)


def per_joint(values: list[float] | None, robot: Robot, option: str) -> list[float] | None:
    """One number per joint; a single one counts for all."""
    if values is None:
        return None
    if len(values) == 1:
        return values * robot.dof
    if len(values) != robot.dof:
        raise wrong_use(
            f"got {counted(len(values), 'number')} for {counted(robot.dof, 'joint')}: give one, or one for each", option
        )
    return values


def pair_per_joint(values: list[float] | None, robot: Robot, option: str) -> list[list[float]] | None:
    """Two numbers per joint; a single pair counts for all."""
    if values is None:
        return None
    pairs = [values[k : k + 2] for k in range(0, len(values), 2)]
    if len(values) == 2:
        return pairs * robot.dof
    if len(values) != 2 * robot.dof:
        raise wrong_use(
            f"got {counted(len(values), 'number')} for {counted(robot.dof, 'joint')}: give two, or two for each", option
        )
    return pairs


def first_and_last(values: list[int] | None) -> tuple[int, int] | None:
    """The harmonics of a series."""
    if values is None:
        return None
    if len(values) != 2:
        raise wrong_use(
            f"got {counted(len(values), 'number')}, expected the first and the last harmonic", "--harmonics"
        )
    return values[0], values[1]


def corners(values: list[float] | None) -> list[tuple[list[float], list[float]]] | None:
    """Lowest and highest corner of each box."""
    if values is None:
        return None
    if len(values) % 6 != 0:
        raise wrong_use(
            f"got {counted(len(values), 'number')}, a box has six: its lowest and its highest corner", "--box"
        )
    return [(values[k : k + 3], values[k + 3 : k + 6]) for k in range(0, len(values), 6)]


def to_dict(found: Excitation, robot: Robot, settings: dict[str, Any]) -> dict[str, Any]:
    """All figures."""
    trajectory = found.trajectory
    return headed(
        "excite",
        robot,
        settings=settings,
        status=found.status,
        criterion=found.criterion,
        value=found.value,
        values=found.values,
        how_much_data=how_much_to_record(robot, found.forecast),
        report=found.report,
        peaks=found.peaks,
        utilisation=found.utilisation,
        tightest=found.tightest,
        joints=trajectory.joint_names,
        duration_s=trajectory.duration,
        start=trajectory.start,
        coefficients=trajectory.coefficients,
    )


def show(found: Excitation, robot: Robot, data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    report, peaks = found.report, found.peaks
    if found.status == "interrupted":
        output.warning("stopped: this is the best motion so far")
    criterion = "" if data["criterion"] == "condition" else f"{data['criterion']} {significant(found.value)}; "
    output.heading(
        f"{criterion}condition number {significant(report['condition'])}, "
        f"{report['rank']} of {report['base_parameters']} {kind_of_parameters(report)}s excited"
    )
    rows = [
        [
            name,
            *map(significant, (*peaks["position"][k], peaks["velocity"][k], peaks["acceleration"][k])),
            f"{unit}, {unit}/s, {unit}/s²",
        ]
        for k, (name, unit) in enumerate(zip(robot.joint_names, robot.position_units, strict=True))
    ]
    output.table(["joint", "lowest", "highest", "speed", "acceleration", "units"], rows, text_columns=(0, 5))
    if hidden := report.get("hidden"):
        output.warning(f"no motion tells these from other parameters: {', '.join(hidden)}")
    output.line(data["how_much_data"]["answer"])
    tightest = found.tightest.replace("`", "")
    output.line(f"largest share of a limit, between samples too: {100 * found.utilisation:.4g} % ({tightest})")
