"""What a period of an online model costs from Python: the table of docs/online.md, CPU time of the thread.

    python benches/online_cost.py

Sines as in benches/fixture.rs move a PUMA 560, and the torques are those of its robot file, so that nothing is to be
learned: the time does not depend on that. Every sample is new (`novelty=0`): one point goes and one comes each period.
"""

import time
from typing import Any

import numpy as np
import sgpr
from sgpr.robots import puma560

PERIOD, SAMPLES, WARM_UP = 1e-3, 5500, 500
CASES = (
    ("payload", {"process": False}),
    ("payload and process, 100 points, every sample new", {"points": 100, "novelty": 0.0}),
    ("the same, 200 points", {"points": 200, "novelty": 0.0}),
)


def motion(robot: sgpr.Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sines of each joint's own frequency, phase and size."""
    joint = np.arange(robot.dof)
    t = PERIOD * np.arange(WARM_UP + SAMPLES)[:, None]
    w, phase, size = 1.1 + 0.37 * joint, 0.3 * joint, 0.4 + 0.05 * joint
    return size * np.sin(w * t + phase), size * w * np.cos(w * t + phase), -size * w**2 * np.sin(w * t + phase)


def microseconds(options: dict[str, Any]) -> np.ndarray:
    """Of an update and the torque after it, once the budget of points is used."""
    robot = puma560()
    q, dq, ddq = motion(robot)
    tau = robot.inverse_dynamics(q, dq, ddq)
    model = sgpr.OnlineModel(robot, period=PERIOD, noise=np.ones(robot.dof), **options)
    found = np.empty(len(q))
    for k in range(len(q)):
        start = time.thread_time_ns()
        model.update(q[k], tau[k])
        model.torque(q[k], dq[k], ddq[k])
        found[k] = 1e-3 * (time.thread_time_ns() - start)
    return found[WARM_UP:]


if __name__ == "__main__":
    print("| followed | median | 99 of 100 below | longest |\n|---|---|---|---|")
    for name, options in CASES:
        found = microseconds(options)
        print(f"| {name} | {np.median(found):.0f} | {np.quantile(found, 0.99):.0f} | {found.max():.0f} |")
