"""What the tests of the command line share: running it, and small logs of a two-link arm."""

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sgpr
from numpy.typing import NDArray
from sgpr.cli import main

Array = NDArray[np.float64]

DEMO = Path(__file__).parents[3] / "data" / "demo"
RECORDINGS = DEMO.parent / "recording"
DEMO_TRAIN = [str(DEMO / f"train_{number}.csv.gz") for number in (1, 2, 3)]
DEMO_TEST = str(DEMO / "test.csv.gz")
DEMO_ROBOT = str(DEMO / "robot.urdf")

JOINTS = 2
RATE_HZ = 100.0
SECONDS = 20.0
VISCOUS, COULOMB = (0.3, 0.2), (0.5, 0.4)


@dataclass(frozen=True)
class Finished:
    """How a command ended."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Finished:
    """The command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
    return Finished(code, out.getvalue(), err.getvalue())


def motion(seed: int) -> tuple[Array, Array, Array, Array]:
    """Time, position and its derivatives of a motion that excites both joints."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    q, dq, ddq = (np.zeros((len(t), JOINTS)) for _ in range(3))
    for joint in range(JOINTS):
        for harmonic in (1, 2, 3, 5):
            w = 2.0 * np.pi * harmonic / 10.0
            phase, size = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.2, 0.6) / harmonic
            q[:, joint] += size * np.sin(w * t + phase)
            dq[:, joint] += size * w * np.cos(w * t + phase)
            ddq[:, joint] -= size * w * w * np.sin(w * t + phase)
    return t, q, dq, ddq


def torque(seed: int) -> tuple[Array, Array, Array]:
    """Time, position and noisy torque with friction."""
    t, q, dq, ddq = motion(seed)
    tau = sgpr.robots.two_link().inverse_dynamics(q, dq, ddq) + VISCOUS * dq + COULOMB * np.sign(dq)
    return t, q, tau + 0.01 * np.random.default_rng(seed).standard_normal(tau.shape)


def write_log(path: Path, seed: int, change: Callable[[Array], Array] = lambda table: table) -> str:
    """A log of the two-link arm with the columns t q_1 q_2 tau_1 tau_2, changed before it is written."""
    t, q, tau = torque(seed)
    table = change(np.column_stack([t, q, tau]))
    np.savetxt(path, table, delimiter=",", header="t,q_1,q_2,tau_1,tau_2", comments="", fmt="%.12g")
    return str(path)
