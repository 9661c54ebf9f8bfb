"""How often intervals of parameters hold the truth, with default settings: Monte Carlo of simulated logs.

    python examples/parameter_coverage.py --draws 60 --out out/parameter_coverage.md

Each draw is another arm, whose bodies are off the robot file by a third of themselves, with another friction, another
motion and other noise. The noise remembers: each sample is `memory` times the one before, and new noise. Intervals are
1.96 standard deviations to either side. Those of one draw hang together: the standard error is that of the draws.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import sgpr

ROBOTS = ("two_link", "puma560", "ur5e_like")
SECONDS = (3.0, 5.0, 10.0, 20.0)
MEMORY = (0.0, 0.5, 0.9, 0.97)
EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia")
URDF = Path(__file__).parent.parent / "data" / "reference" / "urdf"
PERIOD_S = 0.01
BODIES = 0.3  # standard deviation of the file's values, as a share of them
NOISE = 0.03  # of the torque's root mean square


def experiment(robot: sgpr.Robot, seconds: float, memory: float, seed: int) -> tuple[sgpr.Model, sgpr.Recording]:
    """An arm that is not quite that of the robot file, and a log of it."""
    rng = np.random.default_rng([seed, robot.dof])
    t = np.arange(0.0, seconds, PERIOD_S)
    lower, upper = robot.limits["lower"], robot.limits["upper"]
    start = np.where(np.isfinite(upper - lower), 0.5 * (lower + upper), 0.0)
    while True:
        motion = sgpr.Trajectory.random(
            robot, start=start, max_acceleration=np.full(robot.dof, 6.0), random_state=int(rng.integers(1 << 30))
        )
        q, dq, ddq = motion.at(t % motion.duration)
        if np.abs(dq).max(axis=0).min() > 0.1:
            break
    size = np.sqrt((sgpr.Model.nominal(robot).predict(q, dq, ddq) ** 2).mean(axis=0)) + 1e-3
    names = sgpr.Model.from_parameters(robot, np.zeros(13 * robot.dof), EFFECTS).all_parameter_names
    values = np.zeros(len(names))
    file = np.ravel(robot.standard_parameters)
    values[: file.size] = file * (1.0 + BODIES * rng.normal(size=file.size))
    top = np.abs(dq).max(axis=0)
    for joint, name in enumerate(robot.joint_names):
        values[names.index(f"{name}.Fv")] = rng.uniform(0.02, 0.2) * size[joint] / top[joint]
        values[names.index(f"{name}.Fc")] = rng.uniform(0.05, 0.3) * size[joint]
    truth = sgpr.Model.from_parameters(robot, values, EFFECTS)
    noise = rng.normal(size=q.shape)
    for k in range(1, len(noise)):
        noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory**2) * noise[k]
    tau = truth.predict(q, dq, ddq) + NOISE * size * noise
    return truth, sgpr.Recording(np.round(t * 1e9).astype(np.int64), q, dq, tau, joint_names=robot.joint_names)


def covered(robot: sgpr.Robot, seconds: float, memory: float, seed: int) -> tuple[bool, float]:
    """Whether a prior holds the model of one draw, and the share of its intervals that hold the truth."""
    truth, log = experiment(robot, seconds, memory, seed)
    model = sgpr.identify(robot, [log], effects=EFFECTS)
    expected = dict(zip(truth.parameters.names, truth.parameters.values, strict=True))
    known = [p for p in model.parameters if p.name in expected and 0.0 < p.standard_deviation < np.inf]
    held = [abs(p.value - expected[p.name]) < 1.96 * p.standard_deviation for p in known]
    return model.fit["prior_standard_deviation"] is not None, float(np.mean(held))


def row(name: str, seconds: float, draws: int) -> str:
    """A row of the table: how many draws a prior holds, and per memory of the noise the share of intervals."""
    robot = sgpr.Robot.from_urdf(URDF / f"{name}.urdf")
    held, cells = 0, []
    for memory in MEMORY:
        of_draws = [covered(robot, seconds, memory, seed) for seed in range(draws)]
        shares = [100.0 * share for _, share in of_draws]
        held += sum(is_held for is_held, _ in of_draws)
        cells.append(f"{np.mean(shares):.1f} ± {np.std(shares, ddof=1) / draws**0.5:.1f}")
    return f"| {name} | {seconds:.0f} | {100.0 * held / (draws * len(MEMORY)):.0f} | {' | '.join(cells)} |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--robots", nargs="*", default=ROBOTS)
    parser.add_argument("--seconds", nargs="*", type=float, default=SECONDS)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    lines = [
        f"| robot | seconds | held by the prior, % | {' | '.join(f'memory {memory:g}' for memory in MEMORY)} |",
        f"|---|---:|---:|{'---:|' * len(MEMORY)}",
    ]
    print("\n".join(lines))
    for name in options.robots:
        for seconds in options.seconds:
            lines.append(row(name, seconds, options.draws))
            print(lines[-1], flush=True)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    sys.exit(main())
