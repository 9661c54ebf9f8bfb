"""How often do healthy arms alarm, and how soon is a rise of friction found? Simulated, with exact intervals.

    python benches/fleet_alarms.py [--years 10] [--rises 24] [--robot two_link] [--seed 1]

Healthy arms of a year each: two sessions of 20 s a day, temperature by seasons and weather, friction that wears by a
few percent a year, and declared changes of the tool at every second arm. Then arms of thirty days with 8 % more Coulomb
friction in one joint from some session on. Motions are those planned, with their torque (`session_log(tracked=False)`).
"""

import argparse
import os
import warnings
from concurrent.futures import ProcessPoolExecutor
from itertools import cycle, islice
from multiprocessing import get_context

import numpy as np
import sgpr
from scipy.stats import beta, chi2
from sgpr.fleet.changes import NANOSECONDS_PER_DAY, histories
from sgpr.fleet.simulated import Arm, Fault, session_log

PER_DAY = 2
RISE = 0.08
YEAR, MONTH = 365, 30


def main() -> None:
    """Both measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--years", type=int, default=10, help="healthy arms, a year each")
    parser.add_argument("--rises", type=int, default=24, help="arms with a rise of friction")
    parser.add_argument("--robot", nargs="+", default=["two_link"], help="two_link, puma560, or robot files")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    robots = {name: load(name) for name in options.robot}
    first = options.seed * 1_000_003
    kinds = list(islice(cycle(robots), max(options.years, options.rises)))
    healthy = [Arm(f"arm {k:03d}", kinds[k], first + k, tools=k % 2 == 1) for k in range(options.years)]
    found = histories(recorded(healthy, robots, YEAR), robots)
    years = sum((one.time[-1] - one.time[0]) / NANOSECONDS_PER_DAY / 365.25 for one in found)
    alarms = [alarm.text for one in found for alarm in one.alarms]
    low, high = poisson_interval(len(alarms))
    print(f"healthy: {len(alarms)} alarms in {years:.2f} arm-years, ", end="")
    print(f"{len(alarms) / years:.2f} per arm-year [{low / years:.2f}, {high / years:.2f}]")
    print("".join(f"  {text}\n" for text in alarms), end="")
    rises(options, robots, kinds, first + 500_000)


def rises(options: argparse.Namespace, robots: dict[str, sgpr.Robot], kinds: list[str], first: int) -> None:
    """Arms with a rise of friction."""
    rng = np.random.default_rng(first)
    arms = []
    for k in range(options.rises):
        session = int(rng.integers(MONTH * PER_DAY // 2, MONTH * PER_DAY - 2 * PER_DAY))
        fault = Fault("friction", int(rng.integers(robots[kinds[k]].dof)), session, RISE)
        arms.append(Arm(f"arm {k:03d}", kinds[k], first + k, (fault,)))
    of_arm = {arm.name: arm for arm in arms}
    within, named, others, known = 0, 0, 0, 0
    for one in histories(recorded(arms, robots, MONTH), robots):
        fault = of_arm[one.robot].faults[0]
        joint = robots[one.type].joint_names[fault.joint]
        right = [alarm for alarm in one.alarms if alarm.joint == joint and alarm.told >= fault.session]
        within += any(alarm.told < fault.session + PER_DAY for alarm in right)
        named += any(alarm.cause == "Coulomb friction" for alarm in right)
        others += len(one.alarms) - min(len(right), 1)
        friction = one.find(joint, "Fc")
        known += friction is not None and bool(np.isfinite(friction.change).mean() > 0.5)
    low, high = binomial_interval(within, options.rises)
    print(f"+{100 * RISE:.0f} % Coulomb friction: {within} of {options.rises} found within a day ", end="")
    print(f"[{100 * low:.0f}, {100 * high:.0f} %], {named} with the right cause, {others} other alarms; ", end="")
    print(f"{known} of these joints have friction that most sessions know to 25 %")


def load(name: str) -> sgpr.Robot:
    """A robot of the library, or of a file."""
    return getattr(sgpr.robots, name)() if hasattr(sgpr.robots, name) else sgpr.Robot.from_urdf(name)


def recorded(arms: list[Arm], robots: dict[str, sgpr.Robot], days: int) -> list[sgpr.Record]:
    """Records of all sessions; each type of arm is processed as its first sessions ask for."""
    texts: dict[str, str] = {}
    for arm in arms:
        if arm.type not in texts:
            logs = [recording(arm, robots[arm.type], session) for session in range(3)]
            texts[arm.type] = sgpr.choose_processing(robots[arm.type], logs).to_json()
    jobs = [(arm, robots[arm.type], texts[arm.type], days) for arm in arms]
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        parts = [part for own in pool.map(records_of, jobs) for part in own]
    return [sgpr.Record.from_parts(*part) for part in parts]


def records_of(job: tuple[Arm, sgpr.Robot, str, int]) -> list[tuple[str, np.ndarray]]:
    """Parts of the records of an arm. Runs in a process of its own."""
    warnings.simplefilter("ignore")
    arm, robot, processing, days = job
    found = []
    for session in range(days * PER_DAY):
        labels = {"robot": arm.name, "type": arm.type, "session": str(session), "tool": arm.tool(session / PER_DAY)[0]}
        chosen = sgpr.Processing.from_json(processing)
        log = recording(arm, robot, session)
        found.append(sgpr.record(robot, log, processing=chosen, blocks=1, labels=labels).to_parts())
    return found


def recording(arm: Arm, robot: sgpr.Robot, session: int) -> sgpr.Recording:
    """The log of a session."""
    log = session_log(arm, robot, session, PER_DAY, tracked=False)
    return sgpr.Recording(
        log["t"],
        log["q"],
        tau=log["tau"],
        joint_names=robot.joint_names,
        channels={"temperature": log["temperature"]},
        source=f"{arm.name}, session {session}",
    )


def poisson_interval(count: int) -> tuple[float, float]:
    """95 % interval of the mean of a Poisson variable (Garwood)."""
    return (float(chi2.ppf(0.025, 2 * count) / 2) if count else 0.0), float(chi2.ppf(0.975, 2 * count + 2) / 2)


def binomial_interval(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson)."""
    low = float(beta.ppf(0.025, count, of - count + 1)) if count else 0.0
    return low, float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0


if __name__ == "__main__":
    main()
