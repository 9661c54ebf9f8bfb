"""The models that the experiments compare, all identified from the same logs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sgpr import Model, Recording, Robot, SemiParametricModel, Simulation, identify

Array = NDArray[np.float64]

FRICTION = ("viscous_friction", "coulomb_friction")

# With what the thesis calls unmodelled: rotors, and Coulomb friction that differs between directions (an offset).
ALL_EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")

# Below 0.05 rad/s a joint sticks, creeps or is on the Stribeck slope, which none of the parameters describes; a series
# up to 5 Hz is there all the time. At a turn friction jumps between two samples, and the filters spread that error over
# a period of the cut-off. What still is no friction of that form gets the weight of an outlier.
OPTIONS: dict[str, Any] = {"method": "irls:0.7", "standstill_speed": 0.05, "turn_margin": 1.0}


@dataclass(frozen=True)
class Process:
    """How large the processes may be."""

    points: int
    evaluations: int
    n_jobs: int


def mean_period(run: Simulation, period: float, name: str) -> Recording:
    """The periods of a run after the first, averaged (the thesis's eq. 4-7 needs such periods).

    Ten repetitions of a motion are one motion: a part that is left out of them is still there nine times, and a process
    judged by such parts learns the motion by heart.
    """
    time = run.t
    rows = round(period / (time[1] - time[0]))
    periods = len(run) // rows
    first = 1 if periods > 1 else 0
    kept = slice(first * rows, periods * rows)

    def mean(values: Array) -> Array:
        average: Array = values[kept].reshape(-1, rows, values.shape[1]).mean(axis=0)
        return average

    stamps = np.round(1e9 * time[:rows]).astype(np.int64)
    q, dq, tau = mean(run.q_measured), mean(run.dq_measured), mean(run.tau_measured)
    return Recording(stamps, q, dq, tau, joint_names=run.joint_names, source=name)


def parametric(robot: Robot, logs: Sequence[Recording], effects: Sequence[str]) -> Model:
    """Base parameters and effects (section 4-2), outliers weighted down."""
    return identify(robot, logs, effects=list(effects), **OPTIONS)


def semi_parametric(
    robot: Robot, logs: Sequence[Recording], effects: Sequence[str], process: Process, **choices: Any
) -> SemiParametricModel:
    """The same, and a process per joint of what it leaves over (section 4-3)."""
    choices = {"ard": False, **choices}
    return SemiParametricModel(
        robot,
        effects=list(effects),
        points=process.points,
        max_evaluations=process.evaluations,
        n_jobs=process.n_jobs,
        options=OPTIONS,
        **choices,
    ).fit(logs)
