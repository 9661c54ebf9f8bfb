"""Where an error of 14.5 % on Baxter comes from: a plain script, without the library's processing, in its variants.

    python examples/baxter_reference.py

Zero-phase Butterworth filter of fourth order at 5 Hz, central differences, least squares with rotor inertia, viscous
and dry friction and offset, trained on trajectories 1 to 5; the error of 6 and 7 over all samples, those at which a
joint stands included. `docs/real-data.md` says where the logs come from; SGPR_DATA names their folder. Needs SciPy.
"""

import sys
from collections.abc import Callable

import numpy as np
import sgpr
from numpy.typing import NDArray
from real_robots import find_dataset, robot_and_logs
from scipy.signal import butter, filtfilt

Array = NDArray[np.float64]
RATE_HZ = 100.0
CUTOFF_HZ = 5.0
DRY_FRICTION: dict[str, Callable[[Array], Array]] = {
    "sign of the speed": np.sign,
    "tanh(50 s/rad speed)": lambda speed: np.tanh(50.0 * speed),
}


def equations(robot: sgpr.Robot, log: sgpr.Recording, dry: Callable[[Array], Array], cut: int) -> tuple[Array, Array]:
    """Observation matrix [samples, n, parameters] and torque [samples, n] without the first and last `cut` samples."""
    b, a = butter(4, CUTOFF_HZ / (0.5 * RATE_HZ))
    assert log.tau is not None
    q, tau = (filtfilt(b, a, values, axis=0) for values in (log.q, log.tau))
    dq = np.gradient(q, 1.0 / RATE_HZ, axis=0)
    ddq = np.gradient(dq, 1.0 / RATE_HZ, axis=0)
    q, dq, ddq, tau = (np.ascontiguousarray(values[cut : len(q) - cut]) for values in (q, dq, ddq, tau))
    samples, n = q.shape
    own = np.stack([ddq, dq, dry(dq), np.ones_like(q)], axis=2)
    effects = np.zeros((samples, n, n, 4))
    joints = np.arange(n)
    effects[:, joints, joints] = own
    rigid = robot.regressor(q, dq, ddq).reshape(samples, n, -1)
    return np.concatenate([rigid, effects.reshape(samples, n, -1)], axis=2), tau


def solution(rows: Array, tau: Array, deviations: Array) -> Array:
    """Least squares with the rows of each joint in units of its deviation."""
    whole = np.concatenate([rows, tau[:, :, None]], axis=2) / deviations[:, None]
    triangle = np.linalg.qr(whole.reshape(-1, whole.shape[2]), mode="r")
    size = np.maximum(np.linalg.norm(triangle[:, :-1], axis=0), 1e-12)
    return np.linalg.lstsq(triangle[:, :-1] / size, triangle[:, -1], rcond=1e-8)[0] / size


def main() -> int:
    """Print the table of `docs/real-data.md`."""
    robot, train, test = robot_and_logs(*find_dataset("baxter"))
    print("| dry friction | cut off at both ends, s | all rows alike, % | joints weighted, % | RMSE, weighted, N·m |")
    print("|---|---:|---:|---:|---|")
    for name, dry in DRY_FRICTION.items():
        for cut in (0, 50, 100):
            parts = [equations(robot, log, dry, cut) for log in train]
            rows, tau = (np.concatenate(values) for values in zip(*parts, strict=True))
            parts = [equations(robot, log, dry, cut) for log in test]
            other_rows, other_tau = (np.concatenate(values) for values in zip(*parts, strict=True))
            deviations, errors = np.ones(robot.dof), []
            for _ in range(2):
                x = solution(rows, tau, deviations)
                deviations = np.sqrt(np.mean((tau - rows @ x) ** 2, axis=0))
                residual = other_tau - other_rows @ x
                errors.append(100.0 * np.linalg.norm(residual) / np.linalg.norm(other_tau))
            rmse = " ".join(f"{value:.3f}" for value in np.sqrt(np.mean(residual**2, axis=0)))
            print(f"| {name} | {cut / RATE_HZ} | {errors[0]:.2f} | {errors[1]:.2f} | {rmse} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
