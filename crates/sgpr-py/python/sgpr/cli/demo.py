"""`sgpr demo`: the whole loop on small logs that it makes, from the installed package alone."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from .. import Model, Recording, Robot, compare, diagnose, identify
from ..report.numbers import percent, significant
from ..robots import two_link
from .console import Output
from .error_table import show_errors
from .errors import one_of
from .options import Open, open_page
from .output_folder import OutputFolder
from .predictions import AFTER, BEFORE

Array = NDArray[np.float64]

RATE_HZ, SECONDS, SAMPLES_OF_NOISE = 250.0, 20.0, 0.02
"""Of each log; standard deviation of the noise of its torque, N·m."""

FRICTION = {"viscous": (0.3, 0.2), "coulomb": (0.5, 0.4)}
"""N·m·s/rad, N·m"""

HEAVIER = 1.15
"""What the arm weighs, of what its robot file says."""

HIDDEN = {
    "none": lambda q, dq: np.zeros_like(q),
    "cable_stiffness": lambda q, dq: 1.5 * (q - 0.2),
    "quadratic_viscous_friction": lambda q, dq: 0.25 * dq * np.abs(dq),
    "torque_ripple": lambda q, dq: 0.4 * np.sin(12.0 * q + 0.3),
}
"""Effect -> torque that it adds at the second joint, N·m."""


def demo(
    output: Output,
    effect: Annotated[
        str,
        typer.Option("--effect", metavar="NAME", help=f"What the arm hides at its second joint: {', '.join(HIDDEN)}."),
    ] = "cable_stiffness",
    out: Annotated[str, typer.Option("--out", metavar="DIR", help="Folder for the logs and results.")] = "sgpr_demo",
    open_report: Open = False,
) -> None:
    """Makes logs of a two-link arm that hides an effect, identifies it, and finds the effect.

    The arm is 15 % heavier than its robot file says, and has friction. Writes to DIR: train_1.csv, train_2.csv,
    test.csv, model.sgpr and report.html. No other file is needed.
    """
    one_of(effect, HIDDEN, "--effect", "effect of the demo")
    robot = two_link()
    folder = OutputFolder(out)
    logs = {
        name: record(robot, effect, seed, name) for seed, name in enumerate(("train_1.csv", "train_2.csv", "test.csv"))
    }
    train, test = list(logs.values())[:2], list(logs.values())[2:]
    with output.progress() as progress:
        model = identify(robot, train, effects=["viscous_friction", "coulomb_friction"], progress=progress)
        diagnosis = diagnose(model, train, test, progress=progress)
    better = diagnosis.model
    with folder:
        for name, log in logs.items():
            # The suffix decides the format, so the file beside keeps it.
            log.save(folder.file(name))
        better.save(folder.file("model.sgpr"))
        diagnosis.report(folder.file("report.html"))
    before, after = compare(robot, test, processing=better), compare(better, test)
    show_errors({BEFORE: before, AFTER: after}, output)
    output.heading(
        f"On an unseen log the error is {percent(after.relative_error_percent)} % of the torque; with the robot file "
        f"it was {percent(before.relative_error_percent)} %."
    )
    output.line(f"hidden at joint_2: {effect}")
    for finding in diagnosis.findings:
        at = ", ".join(finding.joints) or "the whole arm"
        output.line(f"found: {finding.effect} at {at}, probability {significant(finding.probability, 2)}")
    if not diagnosis.findings:
        output.line(f"found: nothing ({diagnosis.verdict})")
    place = Path(out)
    output.line(f"results: {place}")
    data: dict[str, Any] = {
        "command": "demo",
        "hidden": effect,
        "verdict": diagnosis.verdict,
        "findings": [
            {"effect": f.effect, "joints": f.joints, "probability": f.probability} for f in diagnosis.findings
        ],
        "error_before_percent": before.relative_error_percent,
        "error_after_percent": after.relative_error_percent,
    }
    output.result(data)
    if open_report:
        open_page(place / "report.html")
    logs_of = [str(place / name) for name in ("train_1.csv", "train_2.csv")]
    output.next(
        "sgpr", "identify", "--robot", "two_link", "--train", *logs_of, "--test", str(place / "test.csv"), "--out",
        str(place / "result"), why="the same step by step; then with your robot and your logs",
    )  # fmt: skip


def record(robot: Robot, effect: str, seed: int, source: str) -> Recording:
    """A log of the arm: sums of sines, and the torque that they need."""
    t, q, dq, ddq = motion(seed)
    arm = robot.with_standard_parameters(HEAVIER * robot.standard_parameters)
    tau = Model.nominal(arm).predict(q, dq, ddq)
    tau = tau + FRICTION["viscous"] * dq + FRICTION["coulomb"] * np.sign(dq)
    tau[:, 1] += HIDDEN[effect](q[:, 1], dq[:, 1])
    noise = SAMPLES_OF_NOISE * np.random.default_rng(seed).standard_normal(tau.shape)
    return Recording(t, q, tau=tau + noise, joint_names=robot.joint_names, source=source)


def motion(seed: int) -> tuple[Array, Array, Array, Array]:
    """Time, position, velocity, acceleration: both joints swing with five harmonics of a tenth of a hertz."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    q, dq, ddq = (np.zeros((len(t), 2)) for _ in range(3))
    for joint in range(2):
        for harmonic in (1, 2, 3, 5, 7):
            w = 0.2 * np.pi * harmonic
            phase, size = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.4, 0.9) / harmonic
            q[:, joint] += size * np.sin(w * t + phase)
            dq[:, joint] += size * w * np.cos(w * t + phase)
            ddq[:, joint] -= size * w * w * np.sin(w * t + phase)
    return t, q, dq, ddq
