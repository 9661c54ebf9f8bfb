"""Gains of drives from a known payload, on simulated pairs of logs whose gains are known.

    python examples/simulated_gains.py [PAIRS]

Two arms follow a motion of 40 s without and with a payload of known mass; their currents, torque divided by gain, have
noise that remembers, of 4 % of the current. What the estimators make of the gains, as errors in percent: the mean over
all pairs (5 unless said otherwise) that gave any, joint by joint. The table is the one in `docs/estimators.md`.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import sgpr

ROBOTS = Path(__file__).parents[1] / "data" / "reference" / "urdf"
MASS = {"ur5e_like": 2.8, "panda_like": 2.0}
CENTRE = np.array([0.03, -0.02, 0.08])
GAINS = [11.7, 12.0, 9.8, 10.75, 10.2, 10.9, 9.5]
COULOMB = [15.0, 20.0, 10.0, 4.0, 3.0, 2.0, 1.5]
ROTORS = [2.0, 2.5, 1.5, 0.5, 0.4, 0.3, 0.2]
NOISE, MEMORY = 0.04, 0.95

ESTIMATORS: dict[str, dict[str, Any]] = {
    "default": {},
    "default, bodies": {"consistent": True},
    "least squares": {"estimator": "least_squares"},
    "least squares, bodies": {"estimator": "least_squares", "consistent": True},
}


def motion(joints: int, random: np.random.Generator) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Eight harmonics of 0.05 Hz at every joint, at 100 Hz for 40 s."""
    t = np.arange(4000) / 100.0
    q, dq, ddq = np.zeros((3, t.size, joints))
    for joint in range(joints):
        for harmonic in range(1, 9):
            w, a, phase = 0.1 * np.pi * harmonic, 0.7 * random.normal() / harmonic**0.7, random.uniform(0.0, 7.0)
            q[:, joint] += a * np.sin(w * t + phase)
            dq[:, joint] += a * w * np.cos(w * t + phase)
            ddq[:, joint] -= a * w * w * np.sin(w * t + phase)
    return 100.0, q, dq, ddq


def currents(robot: sgpr.Robot, wanted: Any, random: np.random.Generator) -> sgpr.Recording:
    """Log of an arm under computed torque, with noisy currents in the place of torques."""
    joints = range(robot.dof)
    run = sgpr.simulate(
        robot,
        wanted,
        controller="computed_torque",
        kp=400.0,
        kd=40.0,
        drives=[
            sgpr.Drive(rotor_inertia=ROTORS[j], viscous_friction=0.5 * COULOMB[j], coulomb_friction=COULOMB[j])
            for j in joints
        ],
        record_period=0.01,
        position_resolution=[1e-5] * robot.dof,
    )
    log = run.recording()
    current = log.tau / GAINS[: robot.dof]
    noise = random.normal(size=current.shape)
    for row in range(1, len(noise)):
        noise[row] = MEMORY * noise[row - 1] + np.sqrt(1.0 - MEMORY**2) * noise[row]
    current = current + NOISE * current.std(axis=0) * noise
    return sgpr.Recording(log.t, log.q, tau=current, joint_names=robot.joint_names)


def pair(name: str, seed: int) -> tuple[sgpr.Robot, sgpr.Recording, sgpr.Recording]:
    """The robot, a log without the payload and one with it on the same motion."""
    random = np.random.default_rng(seed)
    robot = sgpr.Robot.from_urdf(ROBOTS / f"{name}.urdf")
    wanted = motion(robot.dof, random)
    inertia = MASS[name] * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE)) + np.diag([0.01, 0.01, 0.008])
    # Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    load = np.array([MASS[name], *(MASS[name] * CENTRE), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    parameters = robot.standard_parameters.copy()
    parameters[-load.size :] += load
    loaded = robot.with_standard_parameters(parameters)
    return robot, currents(robot, wanted, random), currents(loaded, wanted, random)


def estimated(
    robot: sgpr.Robot, without: sgpr.Recording, loaded: sgpr.Recording, mass: float, options: dict[str, Any]
) -> np.ndarray | None:
    """The gains from a pair of logs; none if one of them comes out as no positive number."""
    try:
        return sgpr.identify_drive_gains(robot, [without], [loaded], payload={"m": mass}, **options).gains
    except sgpr.IdentificationError:
        return None


def main() -> int:
    """Print the table."""
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    print("| robot | estimator | mean error of the gains of joints 1 to n, % |\n|---|---|---|")
    for name, mass in MASS.items():
        logs = [pair(name, seed) for seed in range(pairs)]
        for words, options in ESTIMATORS.items():
            found = [gains for each in logs if (gains := estimated(*each, mass, options)) is not None]
            errors = 100.0 * (np.mean(found, axis=0) / GAINS[: logs[0][0].dof] - 1.0)
            words += f", {pairs - len(found)} of {pairs} pairs without" if len(found) < pairs else ""
            print(f"| {name} | {words} | {' '.join(f'{error:.1f}' for error in errors)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
