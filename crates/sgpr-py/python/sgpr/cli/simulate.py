"""`sgpr simulate`: an arm that follows a motion under a controller, as a log."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from .. import Model, Recording, Robot
from .. import simulate as simulate_arm
from ..report.numbers import counted, significant
from ..report.tracking import TrackingPage
from ..report.versions import versions
from ..robots import puma560_drives, two_link_drives
from .console import Output
from .errors import BadData, check_seed, one_of, wrong_use
from .excite import per_joint
from .inputs import kind_of, load_model
from .options import check_not_input
from .output_folder import OutputFolder
from .project import joints_of
from .reading import ReadingOptions, read_log, tell_layouts
from .results import headed
from .robots import READY_MADE, load_robot

CONTROLLERS = ("feed_forward", "computed_torque", "impedance", "pd")
DRIVES = {"puma560": puma560_drives, "two_link": two_link_drives}
FEWEST = 3
MOST_JITTER = 0.25
SUFFIXES = (".csv", ".csv.gz", ".mcap")


def simulate(
    arm: Annotated[
        str,
        typer.Argument(
            metavar="ARM",
            help="A robot, or a saved model (.sgpr) whose effects act; puma560 and two_link come with their drives.",
        ),
    ],
    motion: Annotated[str, typer.Argument(metavar="FILE", help="The motion to follow: positions over time.")],
    reading: ReadingOptions,
    output: Output,
    out: Annotated[str, typer.Option("--out", metavar="FILE", help="Log: .csv, .csv.gz or .mcap.")],
    controller: Annotated[
        str, typer.Option("--controller", help=f"Control law: {', '.join(CONTROLLERS)}.")
    ] = "feed_forward",
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="MODEL|ROBOT", help="What the controller knows.", show_default="rigid body"),
    ] = None,
    kp: Annotated[list[float] | None, typer.Option("--kp", metavar="KP...", help="Per joint, or one for all.")] = None,
    kd: Annotated[list[float] | None, typer.Option("--kd", metavar="KD...", help="Per joint, or one for all.")] = None,
    step: Annotated[float, typer.Option("--step", metavar="S", help="Of the simulation.")] = 2.5e-4,
    period: Annotated[float, typer.Option("--control-period", metavar="S", help="Of the controller.")] = 1e-3,
    delay: Annotated[float, typer.Option("--delay", metavar="S", help="From measurement to action.")] = 0.0,
    resolution: Annotated[
        list[float] | None, typer.Option("--resolution", metavar="R...", help="Encoder steps, rad (m).")
    ] = None,
    torque_noise: Annotated[
        list[float] | None,
        typer.Option("--torque-noise", metavar="S...", help="Standard deviation of the logged torque, N·m (N)."),
    ] = None,
    speed_limit: Annotated[
        float, typer.Option("--speed-limit", metavar="V", help="Above it a joint counts as run away, rad/s (m/s).")
    ] = 1000.0,
    seed: Annotated[int, typer.Option("--seed", help="Of the noise.")] = 0,
    joints: Annotated[
        list[str] | None,
        typer.Option("--joints", metavar="JOINT...", help="Joints of a URDF that move; the others are locked."),
    ] = None,
    report: Annotated[
        str | None, typer.Option("--report", metavar="FILE", help="Also draw tracking and torque (.html).")
    ] = None,
) -> None:
    """Simulates an arm that follows a motion, and writes what a logger would have written."""
    if report is not None and not report.endswith(".html"):
        raise wrong_use(f"`{report}`: the name must end in .html", "--report")
    if not out.endswith(SUFFIXES):
        raise wrong_use(f"`{out}`: the name must end in {', '.join(SUFFIXES)}", "--out")
    check_seed(seed)
    for value, option in ((step, "--step"), (period, "--control-period"), (speed_limit, "--speed-limit")):
        if not value > 0.0:
            raise wrong_use("must be greater than zero", option)
    one_of(controller, CONTROLLERS, "--controller", "controller")
    check_not_input(out, [arm, motion, *([model] if model else [])])
    joints = joints_of(arm, joints, [motion])
    truth: Model | Robot = load_model(arm, joints) if kind_of(arm) == "model" else load_robot(arm, joints)
    robot = truth.robot if isinstance(truth, Model) else truth
    drives = DRIVES[arm]() if arm in READY_MADE and not Path(arm).exists() else None
    known = None if model is None else load_model(model, joints)
    log = read_log(motion, reading, robot.joint_names)
    log.tell(output)
    parts = log.stretches
    if len(parts) != 1:
        raise BadData(f"{motion}: the log has gaps, {len(parts)} stretches; choose one (--trim, --rows)")
    reference = _reference(parts[0], motion)
    options: dict[str, Any] = {
        "controller": controller,
        "kp": per_joint(kp, robot, "--kp") or 75.0,
        "kd": per_joint(kd, robot, "--kd") or 5.0,
        "step": step,
        "control_period": period,
        "delay": delay,
        "position_resolution": per_joint(resolution, robot, "--resolution"),
        "torque_noise": per_joint(torque_noise, robot, "--torque-noise"),
        "speed_limit": speed_limit,
        "random_state": seed,
    }
    place = Path(out).absolute()
    if report is not None:
        # Made now, and not missed after the simulation.
        OutputFolder(str(Path(report).absolute().parent))
    with OutputFolder(str(place.parent)) as folder, output.progress() as progress:
        run = simulate_arm(truth, reference, model=known, drives=drives, progress=progress, **options)
        recording = run.recording(f"simulation of {robot.name}")
        written = folder.file(str(place))
        recording.save(written)
        rmse = run.tracking_rmse
        data: dict[str, Any] = headed(
            "simulate",
            arm=arm,
            motion=motion,
            model=model,
            out=out,
            joints=robot.joint_names,
            samples=len(run),
            tracking_rmse=rmse,
            **options,
        )
        if report is not None:
            folder.write(str(Path(report).absolute()), TrackingPage(robot, run, data, versions()).html())
    rows = [
        [name, significant(value), unit]
        for name, value, unit in zip(robot.joint_names, rmse, robot.position_units, strict=True)
    ]
    output.table(["joint", "tracking error (RMS)", "unit"], rows, text_columns=(0, 2))
    tell_layouts([log], output, of_all=joints is None and isinstance(truth, Robot))
    output.line(f"{len(run)} samples written to {out}")
    if report is not None:
        output.line(f"report: {report}")
    if not isinstance(truth, Robot):
        output.next("sgpr", "compare", arm, out, "--out", "comparison", why="how good is a model on this log?")
    else:
        output.next("sgpr", "identify", "--robot", arm, "--train", out, "--out", "result")
    output.result(data)


def _reference(log: Recording, path: str) -> tuple[float, Any, Any, Any]:
    """Samples at an even rate; what the log does not have is differentiated."""
    rate = log.sample_rate_hz
    if rate is None or len(log) < FEWEST:
        raise BadData(f"{path}: {counted(len(log), 'sample')}: a motion has {FEWEST} or more")
    if np.abs(log.t - np.arange(len(log)) / rate).max() > MOST_JITTER / rate:
        raise BadData(f"{path}: the samples are not evenly spaced in time; resample them (--resample HZ)")
    velocity = log.dq if log.dq is not None else np.gradient(log.q, 1.0 / rate, axis=0, edge_order=2)
    channels = log.channels
    names = [f"{name}_acceleration" for name in log.joint_names]
    if all(name in channels for name in names):
        acceleration = np.column_stack([channels[name] for name in names])
    else:
        acceleration = np.gradient(velocity, 1.0 / rate, axis=0, edge_order=2)
    return rate, log.q, velocity, acceleration
