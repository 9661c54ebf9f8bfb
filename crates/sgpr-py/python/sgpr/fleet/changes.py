"""What changed, in which arm, and when: parameters over sessions, change points, and their causes."""

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._sgpr import Model, Record, Robot, SgprError, deviations, identify_records

Array = NDArray[np.float64]

FALSE_ALARMS = 0.1
"""Per arm and year, all its joints and parameters together, that chance may make."""
BASELINE_SHARE, FEWEST_OF_BASELINE = 0.2, 5
SHORTEST_SEGMENT = 2
NEAR = 3
"""Sessions by which change points of one cause may lie apart."""
RIGID = ("Ia",)
"""Parameters of effects that do not change while an arm works."""
NAMES = {"Fv": "viscous friction", "Fc": "Coulomb friction", "tau0": "torque offset", "gain": "torque gain"}
LEAST_EFFECT = 0.01
"""Changes below this share of the parameter's scale are no alarm, however sure."""
LARGEST_DEVIATION = 0.25
"""Sessions that know a parameter less well than to this share of its scale say nothing of it."""
CAUTION = 1.2
"""Factor on scatter that is known from a few dozen sessions only: their median can be that much too low."""
TOOL_SHARE, TOOL_SHARE_OF_ONE_JOINT = 0.3, 0.9
"""Shares of the residual that a tool explains: of several joints that changed, and where one did."""
OUTLIER = 4.0
DAYS_PER_YEAR = 365.25
NANOSECONDS_PER_DAY = 86_400e9


@dataclass
class Series:
    """A parameter of an arm over its sessions, as a share of `scale` off the reference.

    - `std`: of single sessions, from the residual and its memory
    - `scatter`: of one session, from what neighbouring sessions differ by
    - `widening`: factor on both that the tails of differences and caution ask for
    - `slope`: per °C, from all arms of the type; 0 where temperature is not logged or explains nothing
    - `steps`: indices of sessions at which it changed
    """

    joint: str
    parameter: str
    unit: str
    reference: float
    scale: float
    change: Array
    std: Array
    gain: Array
    scatter: float = 0.0
    widening: float = 1.0
    slope: float = 0.0
    steps: list[int] = field(default_factory=list)

    @property
    def name(self) -> str:
        """What the parameter is called."""
        return NAMES.get(self.parameter, self.parameter)


@dataclass
class Alarm:
    """A change that chance does not explain."""

    robot: str
    type: str
    joint: str
    cause: str
    unit: str
    change: float
    interval: tuple[float, float]
    since: int
    session: int
    steps: int
    deviations: float
    of_temperature: float | None
    text: str


@dataclass
class ArmHistory:
    """An arm over time.

    - `time`: start of each session, ns; `error`: residual of the reference as a share of the torque, `(sessions,
      joints)`
    """

    robot: str
    type: str
    joints: list[str]
    units: list[str]
    sessions: list[str]
    time: list[int]
    hours: float
    baseline: int
    borrowed: bool
    temperature: Array
    error: Array
    series: list[Series]
    alarms: list[Alarm] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    outliers: list[dict[str, Any]] = field(default_factory=list)


def histories(
    records: Iterable[Record],
    robots: Mapping[str, Robot | Model],
    *,
    false_alarms: float = FALSE_ALARMS,
    temperature: str = "temperature",
    progress: Callable[[str, int, int], Any] | None = None,
) -> list[ArmHistory]:
    """The arms of a fleet with what changed in them.

    Parameters
    ----------
    records : iterable of Record
        With the labels `robot` and `type`, as `sgpr fleet run` makes them.
    robots : dict of str to Robot or Model
        By type. A model is the reference of all arms of its type; with a robot each arm's reference is identified
        from its first sessions.
    false_alarms : float
        Alarms per arm and year that chance may make.
    temperature : str
        Channels whose name contains this are the temperature, °C.

    Returns
    -------
    list of ArmHistory
        By name of the arm.

    Raises
    ------
    SgprError
        If there is no record, or a type has no robot.
    """
    arms = _by_arm(records)
    if not arms:
        raise SgprError("there is no record")
    found = []
    baselines = {key: _baseline(own) for key, own in arms.items()}
    for done, ((kind, robot), own) in enumerate(arms.items()):
        if kind not in robots:
            raise SgprError(f"there is no robot for the type `{kind}` of {robot}: give --robot {kind or 'ROBOT'}=...")
        reference, borrowed = _reference(robots[kind], own, baselines[kind, robot], arms, kind)
        history = _history(robot, kind, own, baselines[kind, robot], reference, temperature)
        history.borrowed = borrowed
        found.append(history)
        if progress is not None:
            progress("arms", done + 1, len(arms))
    for kind in {history.type for history in found}:
        sisters = [history for history in found if history.type == kind]
        _share_temperature(sisters)
        _share_scatter(sisters)
        _find_outliers(sisters)
    for history in found:
        _find_changes(history, false_alarms)
        _name_changes(history)
        _find_events(history)
    return sorted(found, key=lambda history: (history.type, history.robot))


def threshold(series: int, sessions: int, days: float, false_alarms: float) -> float:
    """Standard deviations that a step must have: Bonferroni over all places, parameters and joints of an arm, so that
    chance makes at most `false_alarms` per arm and year."""
    years = max(days / DAYS_PER_YEAR, 1e-3)
    tests = max(series * max(sessions - 2 * SHORTEST_SEGMENT + 1, 1), 1)
    share = min(false_alarms * years / tests, 0.5)
    return NormalDist().inv_cdf(1.0 - share / 2.0)


def to_dict(history: ArmHistory) -> dict[str, Any]:
    """The alarms and events of an arm for machines."""
    return {
        "robot": history.robot,
        "type": history.type,
        "sessions": len(history.time),
        "hours": history.hours,
        "reference_borrowed": history.borrowed,
        "alarms": [asdict(alarm) for alarm in history.alarms],
        "events": history.events,
        "outliers": history.outliers,
    }


def _by_arm(records: Iterable[Record]) -> dict[tuple[str, str], list[Record]]:
    arms: dict[tuple[str, str], list[Record]] = {}
    for one in records:
        arms.setdefault((one.labels.get("type", ""), one.labels.get("robot", "")), []).append(one)
    for key, own in arms.items():
        own.sort(key=lambda one: (_time(one), one.source))
        seen: set[Any] = set()
        arms[key] = [one for one in own if not ((mark := (one.content_hash, one.counted)) in seen or seen.add(mark))]
    return arms


def _time(one: Record) -> int:
    """Start of the log, ns: that of the table if it says so, as stamps may count from the start of the log."""
    start = one.labels.get("start")
    if start:
        try:
            return int(np.datetime64(start.removesuffix("Z"), "ns").astype(np.int64))
        except ValueError:
            raise SgprError(f"{one.source}: `start` is {start}, expected a date such as 2026-03-04T08:00:00") from None
    return one.start_time


def _baseline(own: Sequence[Record]) -> int:
    return min(max(math.ceil(BASELINE_SHARE * len(own)), FEWEST_OF_BASELINE), len(own))


def _reference(
    robot: Robot | Model,
    own: Sequence[Record],
    baseline: int,
    arms: Mapping[tuple[str, str], Sequence[Record]],
    kind: str,
) -> tuple[Model, bool]:
    """The model that an arm is measured by, and whether it is that of its sisters."""
    if isinstance(robot, Model):
        return robot, False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return identify_records(robot, own[:baseline]), False
        except SgprError:
            sisters = [
                one for (other, _), theirs in arms.items() if other == kind for one in theirs[: _baseline(theirs)]
            ]
            return identify_records(robot, sisters), True


def _history(
    robot: str, kind: str, own: Sequence[Record], baseline: int, reference: Model, temperature: str
) -> ArmHistory:
    joints = reference.robot.joint_names
    found = [deviations(reference, one)[0] for one in own]
    columns: dict[tuple[str, str], dict[str, Any]] = {}
    error = np.full((len(own), len(joints)), np.nan)
    for k, deviation in enumerate(found):
        for joint in deviation["joints"]:
            j = joints.index(joint["joint"])
            error[k, j] = joint["error"] / max(joint["torque"], 1e-300)
            for parameter in joint["parameters"]:
                symbol = parameter["name"].rpartition(".")[2]
                if symbol in RIGID:
                    continue
                column = columns.setdefault(
                    (joint["joint"], symbol),
                    {
                        "unit": parameter["unit"],
                        "reference": parameter["reference"],
                        "values": np.full((3, len(own)), np.nan),
                    },
                )
                explained = joint["error"] ** 2 - parameter["error_alone"] ** 2
                column["values"][:, k] = parameter["change"], parameter["std"], explained
    series = [
        Series(joint, symbol, column["unit"], column["reference"], _scale(joint, symbol, columns), *column["values"])
        for (joint, symbol), column in columns.items()
    ]
    mass = np.array([[one["tool_mass"], one["tool_mass_std"], one["tool_share"]] for one in found]).T
    series.append(Series("", "tool", "kg", 0.0, 1.0, *mass))
    for one in series:
        # Sessions that do not determine a parameter say nothing of it.
        one.change, one.std = one.change / one.scale, one.std / one.scale
        one.change = np.where(one.std < LARGEST_DEVIATION, one.change, np.nan)
    return ArmHistory(
        robot=robot,
        type=kind,
        joints=joints,
        units=reference.robot.torque_units,
        sessions=[one.labels.get("session", one.source) for one in own],
        time=[_time(one) for one in own],
        hours=sum((one.end_time - one.start_time) / 3600e9 for one in own),
        baseline=baseline,
        borrowed=False,
        temperature=np.array([_temperature(one, temperature) for one in own]),
        error=error,
        series=series,
    )


def _scale(joint: str, symbol: str, columns: Mapping[tuple[str, str], Mapping[str, Any]]) -> float:
    """What a change is a share of: the parameter, of a torque offset the Coulomb friction."""
    own = "Fc" if symbol == "tau0" else symbol
    column = columns.get((joint, own))
    value = abs(column["reference"]) if column is not None else 1.0
    return value if value > 0.0 else 1.0


def _temperature(one: Record, name: str) -> float:
    values = [
        mean
        for block in one.blocks
        for channel, mean in block["channels"].items()
        if name.lower() in channel.lower() and math.isfinite(mean)
    ]
    return float(np.mean(values)) if values else math.nan


def _share_temperature(sisters: Sequence[ArmHistory]) -> None:
    """Slopes by temperature from all arms of a type: one arm's days are too alike. Differences of neighbouring sessions
    hold no step but at one place, and those that are far off are left out."""
    for one in (_all(sisters, key) for key in _keys(sisters)):
        differences = [np.array([np.diff(x.change), np.diff(history.temperature)]) for history, x in one]
        dx, dt = np.concatenate(differences, axis=1)
        good = np.isfinite(dx) & np.isfinite(dt)
        dx, dt = dx[good], dt[good]
        slope = 0.0
        for _ in range(5):
            left = np.abs(dx - slope * dt)
            kept = left <= 3.0 * 1.4826 * np.median(left) if len(left) else left < 0.0
            squares = float(dt[kept] @ dt[kept])
            if kept.sum() < FEWEST_OF_BASELINE or squares <= 0.0:
                slope = 0.0
                break
            slope = float(dx[kept] @ dt[kept]) / squares
            rest = dx[kept] - slope * dt[kept]
            # Neighbouring differences share a session: their noise is not independent.
            variance = 2.0 * float(rest @ rest) / kept.sum() / squares
        if slope != 0.0:
            slope *= slope**2 / (slope**2 + variance)
        for _, x in one:
            x.slope = slope


def _share_scatter(sisters: Sequence[ArmHistory]) -> None:
    """What sessions differ by when nothing changes, beyond what their residuals say: from differences of neighbours,
    which steps hardly touch; no arm is taken to be calmer than its type."""
    for one in (_all(sisters, key) for key in _keys(sisters)):
        own = []
        for history, x in one:
            value = without_temperature(history, x)
            there = np.isfinite(value)
            step, noise = np.diff(value[there]), x.std[there] ** 2
            if len(step) < 3:
                own.append(math.nan)
                continue
            # The quietest excess that makes the differences as large as they are.
            excess = step**2 / 2.0 / 0.455 - (noise[1:] + noise[:-1]) / 2.0
            own.append(math.sqrt(max(float(np.median(excess)), 0.0)))
        known = [value for value in own if math.isfinite(value)]
        typical = float(np.median(known)) if known else math.inf
        for value, (_, x) in zip(own, one, strict=True):
            x.scatter = max(value if math.isfinite(value) else typical, typical, 1e-6)
        # Tails of differences that are wider than those of a normal distribution widen all.
        ratios = []
        for history, x in one:
            value, deviation = without_temperature(history, x), deviation_of(x)
            there = np.isfinite(value)
            ratios.append(np.abs(np.diff(value[there])) / np.hypot(deviation[there][1:], deviation[there][:-1]))
        together = np.concatenate(ratios)
        widening = max(1.0, float(np.quantile(together, 0.95)) / 1.96) if len(together) else 1.0
        for _, x in one:
            x.widening = CAUTION * widening


def _find_outliers(sisters: Sequence[ArmHistory]) -> None:
    """Arms whose friction is not that of their sisters, each shrunk toward them by how little it is known."""
    if len(sisters) < FEWEST_OF_BASELINE:
        return
    for key in _keys(sisters):
        if key[1] not in ("Fv", "Fc"):
            continue
        values, stds, arms = [], [], []
        for history in sisters:
            one = _series(history, key)
            if one is not None and np.isfinite(one.change[: history.baseline]).any():
                first = one.change[: history.baseline] * one.scale + one.reference
                values.append(float(np.nanmean(first)))
                stds.append(float(np.nanmean(one.std[: history.baseline])) * one.scale / math.sqrt(history.baseline))
                arms.append(history)
        if len(values) < FEWEST_OF_BASELINE:
            continue
        value, std = np.array(values), np.array(stds)
        centre = float(np.median(value))
        spread = 1.4826 * float(np.median(np.abs(value - centre)))
        between = max(spread**2 - float(np.median(std**2)), 1e-12 * centre**2 + 1e-300)
        shrunk = centre + (value - centre) * between / (between + std**2)
        for history, raw, one, deviation in zip(arms, value, shrunk, std, strict=True):
            apart = (raw - centre) / math.sqrt(between + deviation**2)
            if abs(apart) > OUTLIER:
                history.outliers.append(
                    {
                        "joint": key[0],
                        "parameter": NAMES[key[1]],
                        "value": float(one),
                        "sisters": centre,
                        "deviations": float(apart),
                    }
                )


def _find_changes(history: ArmHistory, false_alarms: float) -> None:
    import ruptures  # type: ignore[import-untyped]

    days = (history.time[-1] - history.time[0]) / NANOSECONDS_PER_DAY
    limit = threshold(len(history.series), len(history.time), days, false_alarms)
    for one in history.series:
        x, deviation = without_temperature(history, one), deviation_of(one)
        there = np.flatnonzero(np.isfinite(x) & np.isfinite(deviation))
        alone = _alone(x[there], deviation[there])
        # They are no level of the parameter: nothing is averaged over them.
        one.change[there[alone]] = np.nan
        there = there[~alone]
        if len(there) < 2 * SHORTEST_SEGMENT:
            continue
        signal = np.column_stack([x[there], deviation[there]])
        search = ruptures.Pelt(custom_cost=weighted_cost(), min_size=SHORTEST_SEGMENT, jump=1).fit(signal)
        steps = search.predict(pen=limit**2)[:-1]
        one.steps = [int(there[step]) for step in steps]
        if one.steps and abs(_step(one, history)[0]) < limit * _step(one, history)[1]:
            # What went away again is no change that lasts.
            one.steps = []


def weighted_cost() -> Any:
    """Squares about the weighted mean of a segment: a step saves the square of its standard deviations."""
    from ruptures.base import BaseCost  # type: ignore[import-untyped]

    class Weighted(BaseCost):  # type: ignore[misc]
        model = "weighted mean"
        min_size = 1

        def fit(self, signal: Array) -> Any:
            weight = 1.0 / signal[:, 1] ** 2
            x = signal[:, 0] - np.average(signal[:, 0], weights=weight)
            parts = np.array([weight, weight * x, weight * x**2])
            self.signal = signal
            self.sums = np.concatenate([np.zeros((3, 1)), np.cumsum(parts, axis=1)], axis=1)
            return self

        def error(self, start: int, end: int) -> float:
            weight, first, second = self.sums[:, end] - self.sums[:, start]
            return float(second - first**2 / weight)

    return Weighted()


def deviation_of(one: Series) -> Array:
    """Standard deviation of each session."""
    return np.asarray(one.widening * np.sqrt(one.scatter**2 + one.std**2))


def _alone(x: Array, deviation: Array) -> NDArray[np.bool_]:
    """Sessions that stand apart from those before and from those after, which no step does."""
    alone = np.zeros(len(x), dtype=bool)
    for k in range(len(x)):
        before, after = x[max(k - 3, 0) : k], x[k + 1 : k + 4]
        apart = [(x[k] - np.median(part)) / deviation[k] for part in (before, after) if len(part)]
        alone[k] = len(apart) == 2 and min(np.abs(apart)) > OUTLIER and apart[0] * apart[1] > 0.0
    return alone


def _name_changes(history: ArmHistory) -> None:
    """Alarms: of change points that lie together the cause that explains most of the residual."""
    changed = [one for one in history.series if one.steps and abs(_step(one, history)[0]) >= LEAST_EFFECT]
    tool = next((one for one in changed if one.parameter == "tool"), None)
    if tool is not None:
        together = {one.joint for one in changed if one is not tool and abs(one.steps[0] - tool.steps[0]) <= NEAR}
        share = np.nanmean(tool.gain[tool.steps[-1] :]) - np.nanmean(tool.gain[: tool.steps[0]])
        if share > (TOOL_SHARE if len(together) > 1 else TOOL_SHARE_OF_ONE_JOINT):
            history.alarms.append(_alarm(history, tool))
            changed = [one for one in changed if one.joint not in together]
        changed = [one for one in changed if one is not tool]
    for joint in history.joints:
        own = sorted((one for one in changed if one.joint == joint), key=lambda one: one.steps[0])
        while own:
            first = own[0].steps[0]
            together_here = [one for one in own if one.steps[0] - first <= NEAR]
            cause = max(together_here, key=_explained)
            history.alarms.append(_alarm(history, cause))
            own = [one for one in own if one.steps[0] - first > NEAR and _is_new(one, cause)]
    history.alarms.sort(key=lambda alarm: alarm.session)


def _is_new(one: Series, cause: Series) -> bool:
    """Whether a later change point is of another cause: none of the first lies near."""
    return all(abs(step - other) > NEAR for step in one.steps[:1] for other in cause.steps)


def _explained(one: Series) -> float:
    """Square of the residual that the parameter alone explains, after its change and not before."""
    return float(np.nanmean(one.gain[one.steps[-1] :]) - np.nanmean(one.gain[: one.steps[0]]))


def _step(one: Series, history: ArmHistory) -> tuple[float, float]:
    """Change from before the first to after the last change point, and its standard deviation."""
    x, deviation = without_temperature(history, one), deviation_of(one)
    first, last = one.steps[0], one.steps[-1]
    before, after = _mean(x[:first], deviation[:first]), _mean(x[last:], deviation[last:])
    return after[0] - before[0], math.hypot(before[1], after[1])


def _mean(x: Array, deviation: Array) -> tuple[float, float]:
    """Weighted mean and its standard deviation."""
    there = np.isfinite(x) & np.isfinite(deviation)
    weight = 1.0 / deviation[there] ** 2
    if not weight.size:
        return math.nan, math.inf
    return float(np.average(x[there], weights=weight)), 1.0 / math.sqrt(float(weight.sum()))


def _alarm(history: ArmHistory, one: Series) -> Alarm:
    change, std = _step(one, history)
    of_temperature = None
    if np.isfinite(history.temperature).any():
        parts = (history.temperature[: one.steps[0]], history.temperature[one.steps[-1] :])
        of_temperature = one.slope * float(np.nanmean(parts[1]) - np.nanmean(parts[0]))
    cause = one.name
    interval = (change - 1.96 * std, change + 1.96 * std)
    alarm = Alarm(
        robot=history.robot,
        type=history.type,
        joint=one.joint,
        cause=cause,
        unit=one.unit,
        change=change,
        interval=interval,
        since=history.time[one.steps[0]],
        session=one.steps[0],
        steps=len(one.steps),
        deviations=change / std,
        of_temperature=of_temperature,
        text="",
    )
    alarm.text = _sentence(alarm, history)
    return alarm


def _sentence(alarm: Alarm, history: ArmHistory) -> str:
    low, high = alarm.interval
    if alarm.cause == "tool":
        what = f"{alarm.robot}: mass at the last link {alarm.change:+.2f} kg [{low:.2f}, {high:.2f}]"
    else:
        of = " of the Coulomb friction" if alarm.cause == "torque offset" else ""
        size = f"{100 * alarm.change:+.0f} % [{100 * low:.0f}, {100 * high:.0f}]{of}"
        what = f"{alarm.robot}, {alarm.joint}: {alarm.cause} {size}"
    since = f"since {date(alarm.since)}" if alarm.since > 0 else f"since session {history.sessions[alarm.session]}"
    if alarm.steps > 1:
        since += f", in {alarm.steps} steps"
    if alarm.of_temperature is None:
        return f"{what} {since}; temperature is not logged"
    if alarm.cause == "tool" or abs(alarm.of_temperature) < 0.1 * abs(alarm.change):
        return f"{what} {since}, temperature does not explain it"
    share = f"{100 * abs(alarm.of_temperature):.0f} % that temperature explains are taken off"
    return f"{what} {since}, {share}"


def _find_events(history: ArmHistory) -> None:
    """Single sessions whose error stands out from those before and after."""
    if len(history.time) < 2 * FEWEST_OF_BASELINE:
        return
    for j, joint in enumerate(history.joints):
        level = np.log(np.maximum(history.error[:, j], 1e-12))
        for k in range(len(level)):
            near = np.r_[level[max(k - 4, 0) : k], level[k + 1 : k + 5]]
            near = near[np.isfinite(near)]
            if len(near) < 4 or not math.isfinite(level[k]):
                continue
            spread = 1.4826 * float(np.median(np.abs(near - np.median(near))))
            apart = level[k] - max(float(near.max()), float(np.median(near)) + 3.0 * spread)
            if apart > math.log(2.0):
                history.events.append(
                    {
                        "joint": joint,
                        "session": history.sessions[k],
                        "time": history.time[k],
                        "ratio": float(np.exp(level[k] - np.median(near))),
                    }
                )


def without_temperature(history: ArmHistory, one: Series) -> Array:
    """A parameter over the sessions, less what temperature explains."""
    if one.slope == 0.0:
        return one.change
    mean = np.nanmean(history.temperature)
    shift = np.where(np.isfinite(history.temperature), history.temperature - mean, 0.0)
    return np.asarray(one.change - one.slope * shift)


def _series(history: ArmHistory, key: tuple[str, str]) -> Series | None:
    return next((one for one in history.series if (one.joint, one.parameter) == key), None)


def _keys(sisters: Sequence[ArmHistory]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((one.joint, one.parameter) for history in sisters for one in history.series))


def _all(sisters: Sequence[ArmHistory], key: tuple[str, str]) -> list[tuple[ArmHistory, Series]]:
    found = ((history, _series(history, key)) for history in sisters)
    return [(history, one) for history, one in found if one is not None]


def date(stamp: int) -> str:
    """`4 March 2026`."""
    day = np.datetime64(stamp, "ns").astype("datetime64[s]").item()
    return f"{day.day} {day:%B %Y}"
