"""A fleet that does not exist: arms of several types, weeks of logs, and faults that are known, by seed."""

import csv
import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import robots
from .._sgpr import Model, Robot, SgprError, simulate

Array = NDArray[np.float64]

RATE_HZ = 100.0
SECONDS = 20.0
SHORTEST_SECONDS = 5.0
START_SECONDS = 2.0
STEP = 2e-3
FIRST_DAY = np.datetime64("2026-03-01T06:00:00", "ns")
REFERENCE_CELSIUS = 25.0
FRICTION_PER_DEGREE = -0.01
"""Share by which friction changes per degree."""
SCATTER = 0.01
"""Standard deviation of friction between sessions, as a share of it."""
WEAR_PER_YEAR = (0.03, 0.05)
"""Share by which friction grows in a year: mean and standard deviation over joints. That is normal."""
YEARLY_CELSIUS, FORTNIGHTLY_CELSIUS = 4.0, 4.0
"""Amplitudes of the temperature."""
TOOLS = (("gripper", 0.0), ("spindle", 0.8))
"""Tools that an arm changes, and what they weigh beyond the first, kg."""
TOOL_DAYS = (5.0, 25.0)
"""Days between two changes of the tool, from and to."""
USED_OF_LIMITS, USED_OF_EFFORT = 0.95, 0.7
"""Shares of range and speed of a joint that motions use at most, and of its effort without friction and tools."""
MOST_REDUCTIONS = 8
EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")
FAULTS = ("wear", "friction", "torque_gain", "torque_offset", "tool", "collision")


@dataclass(frozen=True)
class Fault:
    """What happens to an arm from a session on.

    - `kind`: "wear", Coulomb friction that grows by `size` over ten days; "friction", a step of it by `size`, both as
      shares; "torque_gain", a sensor whose gain is off by `size`; "torque_offset", one that is off by `size` of the
      joint's Coulomb friction; "tool", `size` kg more at the last link; "collision", an impact in that session, and
      friction up by `size`
    """

    kind: str
    joint: int
    session: int
    size: float


@dataclass(frozen=True)
class Arm:
    """An arm of the fleet, with its truth.

    - `tools`: whether it changes between the two `TOOLS`, which its table says
    """

    name: str
    type: str
    seed: int
    faults: tuple[Fault, ...] = field(default=())
    tools: bool = False

    def tool(self, day: float) -> tuple[str, float]:
        """Name and mass of the tool on a day."""
        if not self.tools:
            return TOOLS[0]
        rng = np.random.default_rng([self.seed, 5])
        changes, until = 0, rng.uniform(*TOOL_DAYS)
        while until <= day:
            changes, until = changes + 1, until + rng.uniform(*TOOL_DAYS)
        return TOOLS[changes % len(TOOLS)]


def simulate_fleet(
    out: str | os.PathLike[str],
    *,
    types: Mapping[str, Robot] | None = None,
    arms: int = 40,
    days: int = 30,
    sessions_per_day: int = 2,
    seconds: float = SECONDS,
    faulty: float = 0.2,
    spoiled: bool = True,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[str, int, int], Any] | None = None,
) -> Path:
    """Write the logs of a simulated fleet, its table and its truth.

    Each arm has inertias, friction and torque offsets of its own around those of its type; friction follows the
    temperature, which is logged, wears slowly, and varies a little from session to session. Every third arm changes
    between two tools, which the table says. Sessions are motions under computed torque, from the library's
    simulator, within the limits of position, velocity and effort that the robot files have.

    Parameters
    ----------
    out : path
        Folder; gets `fleet.csv` (path, robot, session, type, tool), `truth.json`, and `logs/`.
    types : dict of str to Robot, optional
        By default the PUMA 560 and a two-link arm.
    arms, days, sessions_per_day : int
    seconds : float
        Of each session, at least five.
    faulty : float
        Share of the arms to which something happens.
    spoiled : bool
        Whether some logs are broken: cut off, a copy, of another robot, with a clock that jumps back.
    seed : int
    workers : int, optional
        Processes; one per processor by default.

    Returns
    -------
    Path
        The table.

    Examples
    --------
    >>> table = sgpr.fleet.simulate_fleet("fleet", arms=1, days=1, sessions_per_day=1, faulty=0.0, spoiled=False)
    >>> table.read_text().splitlines()[0]
    'path,robot,session,type,tool'
    """
    if min(arms, days, sessions_per_day) < 1 or not 0.0 <= faulty <= 1.0:
        raise SgprError("a fleet has at least one arm, day and session, and a share of faulty arms from 0 to 1")
    if not SHORTEST_SECONDS <= seconds <= 3600.0:
        raise SgprError(f"seconds: got {seconds:g}, expected {SHORTEST_SECONDS:g} to 3600 of each session")
    types = dict(types) if types else {"puma560": robots.puma560(), "two_link": robots.two_link()}
    place = Path(out)
    (place / "logs").mkdir(parents=True, exist_ok=True)
    sessions = days * sessions_per_day
    fleet = _arms(types, arms, sessions, faulty, seed)
    jobs = [(place, arm, types[arm.type], sessions, sessions_per_day, seconds) for arm in fleet]
    with ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn")) as pool:
        for done, _ in enumerate(pool.map(_write_arm, jobs)):
            if progress is not None:
                progress("arms", done + 1, arms)
    rows = [
        [_log_name(arm, k), arm.name, f"{k:04d}", arm.type, arm.tool(k / sessions_per_day)[0]]
        for arm in fleet
        for k in range(sessions)
    ]
    broken = _spoil(place, fleet, rows, types, seed, seconds) if spoiled else {}
    with (place / "fleet.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["path", "robot", "session", "type", "tool"], *rows])
    truth = {
        "sessions_per_day": sessions_per_day,
        "faults": [
            {
                "robot": arm.name,
                "type": arm.type,
                **asdict(fault),
                "joint_name": types[arm.type].joint_names[fault.joint],
            }
            for arm in fleet
            for fault in arm.faults
        ],
        "broken": broken,
    }
    (place / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    return place / "fleet.csv"


def _arms(types: Mapping[str, Robot], arms: int, sessions: int, faulty: float, seed: int) -> list[Arm]:
    rng = np.random.default_rng([seed, 1])
    names = list(types)
    chosen = rng.permutation(arms)[: round(faulty * arms)]
    fleet = []
    for k in range(arms):
        kind = names[k % len(names)]
        faults: tuple[Fault, ...] = ()
        if k in chosen:
            what = FAULTS[int(np.flatnonzero(chosen == k)[0]) % len(FAULTS)]
            size = {
                "wear": 0.3,
                "friction": 0.22,
                "torque_gain": 0.05,
                "torque_offset": 0.5,
                "tool": 1.0,
                "collision": 0.3,
            }
            joint = int(rng.integers(types[kind].dof))
            when = int(rng.integers(sessions // 3, max(2 * sessions // 3, sessions // 3 + 1)))
            faults = (Fault(what, joint, when, size[what]),)
        fleet.append(Arm(f"arm {k:03d}", kind, seed * 100_003 + k, faults, tools=k % 3 == 2))
    return fleet


def _write_arm(job: tuple[Path, Arm, Robot, int, int, float]) -> None:
    place, arm, robot, sessions, per_day, seconds = job
    for session in range(sessions):
        log = session_log(arm, robot, session, per_day, seconds=seconds)
        _write_log(place / _log_name(arm, session), robot, log)


def session_log(
    arm: Arm, robot: Robot, session: int, sessions_per_day: int, *, seconds: float = SECONDS, tracked: bool = True
) -> dict[str, Array]:
    """Columns of a session's log: `t` (ns), `q`, `tau`, `temperature`.

    - `tracked`: the motion is that of an arm under computed torque; otherwise the planned one with its torque, which
      takes a tenth of the time
    """
    own = np.random.default_rng([arm.seed, 2])
    rng = np.random.default_rng([arm.seed, 3, session])
    n = robot.dof
    links = robot.standard_parameters.reshape(n, 10) * own.normal(1.0, 0.05, size=(n, 1))
    motion = _motion(robot, rng, seconds)
    size = _torque_size(robot)
    coulomb = 0.06 * size * own.lognormal(0.0, 0.15, n)
    viscous = 0.04 * size * own.lognormal(0.0, 0.15, n)
    offset = 0.01 * size * own.normal(size=n)
    rotor = 0.02 * size * own.lognormal(0.0, 0.1, n)
    day = session / sessions_per_day
    celsius = _celsius(arm, day) + rng.normal(0.0, 1.0)
    warm = 1.0 + FRICTION_PER_DEGREE * (celsius - REFERENCE_CELSIUS)
    worn = 1.0 + np.random.default_rng([arm.seed, 6]).normal(*WEAR_PER_YEAR, n) * day / 365.25
    friction = worn * warm * rng.normal(1.0, SCATTER, n)
    tool_mass = arm.tool(day)[1]
    gain, extra = np.ones(n), np.zeros(n)
    for fault in arm.faults:
        since = session - fault.session
        if since < 0:
            continue
        match fault.kind:
            case "wear":
                growth = fault.size * min(since / (10.0 * sessions_per_day), 1.0)
                coulomb[fault.joint] *= 1.0 + growth
            case "friction" | "collision":
                coulomb[fault.joint] *= 1.0 + fault.size
            case "torque_gain":
                gain[fault.joint] *= 1.0 + fault.size
            case "torque_offset":
                extra[fault.joint] += fault.size * coulomb[fault.joint]
            case "tool":
                tool_mass += fault.size
    links[n - 1] += tool_mass * np.array([1.0, 0.0, 0.0, 0.08, 0.0064, 0.0, 0.0064, 0.0, 0.0, 0.0])
    parameters = np.concatenate([links.ravel(), viscous * friction, coulomb * friction, rotor, offset])
    truth = Model.from_parameters(robot, parameters, effects=EFFECTS)
    q, torque = _tracked(truth, motion) if tracked else (motion[0], np.asarray(truth.predict(*motion)))
    tau = torque * gain + extra + rng.normal(0.0, 0.004, torque.shape) * size
    if any(fault.kind == "collision" and fault.session == session for fault in arm.faults):
        hit = slice(len(tau) // 2, len(tau) // 2 + 20)
        tau[hit, [fault.joint for fault in arm.faults if fault.kind == "collision"]] += 2.0 * size.max()
    start = FIRST_DAY + np.timedelta64(int(session / sessions_per_day * 86_400e9), "ns")
    return {
        "t": start.astype(np.int64) + np.arange(len(tau)) * round(1e9 / RATE_HZ),
        "q": q + rng.normal(0.0, 2e-6, q.shape),
        "tau": tau,
        "temperature": np.full(len(tau), celsius),
    }


def _tracked(truth: Model, motion: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Positions and torques of an arm that a controller keeps on a motion. It knows the friction: it would hold light
    joints otherwise."""
    run = simulate(
        truth,
        (RATE_HZ, *motion),
        controller="computed_torque",
        model=truth,
        step=STEP,
        control_period=STEP,
        record_period=1 / RATE_HZ,
    )
    return run.q, run.tau


def _celsius(arm: Arm, day: float) -> float:
    """Temperature of a day, by the seasons and the weather."""
    phases = np.random.default_rng([arm.seed, 7]).uniform(0.0, 2.0 * np.pi, 2)
    year = YEARLY_CELSIUS * np.sin(2.0 * np.pi * day / 365.25 + phases[0])
    return float(REFERENCE_CELSIUS + year + FORTNIGHTLY_CELSIUS * np.sin(0.45 * day + phases[1]))


def _motion(robot: Robot, rng: np.random.Generator, seconds: float) -> tuple[Array, Array, Array]:
    """A motion of five harmonics of a tenth of a hertz, from rest, within the limits of the robot file."""
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    w = 2.0 * np.pi * 0.1 * np.arange(1, 6)
    a, b = rng.normal(size=(2, robot.dof, 5)) * 0.35 / np.arange(1, 6)
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    s = sin @ a.T + cos @ b.T
    ds = (w * cos) @ a.T - (w * sin) @ b.T
    dds = -(w**2 * sin) @ a.T - (w**2 * cos) @ b.T
    # From rest, smoothly: the first second belongs to no analysis anyway.
    x = np.clip(t / START_SECONDS, 0.0, 1.0)[:, None]
    r = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    dr = 30.0 * x**2 * (1.0 - x) ** 2 / START_SECONDS
    ddr = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / START_SECONDS**2
    return _within_limits(robot, r * s, dr * s + r * ds, ddr * s + 2.0 * dr * ds + r * dds)


def _within_limits(robot: Robot, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
    """The motion about the pose nearest to zero that its joints can have there, smaller where it would leave the limits
    of the robot file."""
    limits = robot.limits
    room = limits["upper"] - limits["lower"]
    lowest, highest, fastest = q.min(axis=0), q.max(axis=0), np.abs(dq).max(axis=0)
    scale = np.minimum(1.0, USED_OF_LIMITS * np.minimum(room / (highest - lowest), limits["velocity"] / fastest))
    margin = np.where(np.isfinite(room), 0.5 * (1.0 - USED_OF_LIMITS) * room, 0.0)
    lowest_pose = limits["lower"] + margin - scale * lowest
    highest_pose = np.maximum(limits["upper"] - margin - scale * highest, lowest_pose)
    pose = np.clip(0.0, lowest_pose, highest_pose)
    if np.isfinite(limits["effort"]).any():
        nominal = Model.nominal(robot)
        for _ in range(MOST_REDUCTIONS):
            torque = np.abs(nominal.predict(pose + scale * q, scale * dq, scale * ddq)).max(axis=0)
            if (torque <= USED_OF_EFFORT * limits["effort"]).all():
                break
            scale = 0.8 * scale
    return pose + scale * q, scale * dq, scale * ddq


def _torque_size(robot: Robot) -> Array:
    """Root mean square torque of a motion, N·m, not below a hundredth of the largest."""
    motion = _motion(robot, np.random.default_rng(0), SECONDS)
    size = np.sqrt(np.mean(np.asarray(Model.nominal(robot).predict(*motion)) ** 2, axis=0))
    return np.asarray(np.maximum(size, 0.05 * size.max()))


def _log_name(arm: Arm, session: int) -> str:
    return f"logs/{arm.name.replace(' ', '_')}/{session:04d}.parquet"


def _write_log(path: Path, robot: Robot, log: Mapping[str, Any]) -> None:
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    columns = {"t": arrow.array(log["t"]).cast(arrow.timestamp("ns"))}
    for name, key in (("position", "q"), ("torque", "tau")):
        columns |= {f"{joint}_{name}": log[key][:, k] for k, joint in enumerate(robot.joint_names)}
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.table({**columns, "temperature": log["temperature"]}), path)


def _spoil(
    place: Path, fleet: list[Arm], rows: list[list[str]], types: Mapping[str, Robot], seed: int, seconds: float
) -> dict[str, str]:
    """Breaks a few logs; returns what was done to which."""
    rng = np.random.default_rng([seed, 4])
    healthy = [k for k, row in enumerate(rows) if not any(arm.faults for arm in fleet if arm.name == row[1])]
    if len(healthy) < 4:
        return {}
    cut, copy, foreign, back = (int(k) for k in rng.choice(healthy, 4, replace=False))
    broken = {}
    whole = place / rows[cut][0]
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    broken[rows[cut][0]] = "cut off"
    name = rows[copy][0].replace(".parquet", "_again.parquet")
    (place / name).write_bytes((place / rows[copy][0]).read_bytes())
    rows.append([name, *rows[copy][1:]])
    broken[name] = f"a copy of {rows[copy][0]}"
    others = [arm for arm in fleet if arm.type != rows[foreign][3]]
    if others:
        log = session_log(others[0], types[others[0].type], 0, 1, seconds=seconds)
        _write_log(place / rows[foreign][0], types[others[0].type], log)
        broken[rows[foreign][0]] = f"of another robot, {others[0].type}"
    arm = next(arm for arm in fleet if arm.name == rows[back][1])
    log = session_log(arm, types[arm.type], int(rows[back][2]), 1, seconds=seconds)
    log["t"][len(log["t"]) // 2 :] -= 3_000_000_000
    _write_log(place / rows[back][0], types[arm.type], log)
    broken[rows[back][0]] = "a clock that jumps back by 3 s"
    return broken
