"""Alarms: the cause of what changed, and sentences."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .series import FEWEST_OF_BASELINE, TOOL, ArmHistory, Array, Series

NEAR = 3
"""Sessions by which jumps of one cause may lie apart."""
LEAST_EFFECT = 0.01
"""Share of the parameter's scale (kg) that a change must exceed to matter, with 97.5 % certainty."""
TOOL_SHARE, TOOL_SHARE_OF_ONE_JOINT = 0.3, 0.8
"""Shares of the residual that a tool explains: of several joints that changed, and where one did."""


@dataclass
class Alarm:
    """A change that chance does not explain.

    - `since`: start of the first session with it, ns, and `session`: its index; `told`: index of the session after
      which it was sure
    - `until`: start of the first session without it, ns, if it went away
    - `change`, `interval`: as a share of the parameter (of a torque offset, of the Coulomb friction; of a tool, kg),
      and 95 % of what it can be
    """

    robot: str
    type: str
    joint: str
    cause: str
    unit: str
    change: float
    interval: tuple[float, float]
    since: int
    session: int
    told: int
    until: int | None
    steps: int
    deviations: float
    of_temperature: float | None
    text: str


@dataclass
class _Group:
    """Jumps of the parameters of a joint that lie together."""

    joint: str
    jumps: list[tuple[int, int, Series]]

    @property
    def session(self) -> int:
        """Where most of the evidence puts it: the parameter that was sure first."""
        return min(self.jumps, key=lambda jump: (jump[1], jump[0]))[0]

    @property
    def told(self) -> int:
        return min(told for _, told, _ in self.jumps)


def name_changes(history: ArmHistory) -> None:
    """Alarms of an arm: of jumps that lie together the cause that explains most of the torque."""
    tools = _groups("", [one for one in history.series if one.parameter == TOOL])
    groups = {joint: _groups(joint, [one for one in history.series if one.joint == joint]) for joint in history.joints}
    for tool in tools:
        one = tool.jumps[0][2]
        together = [(joint, near) for joint, own in groups.items() for near in own if _near(near, tool)]
        before, after = _around(tools, tool, len(history.time))
        share = _mean_of(one.gain[after]) - _mean_of(one.gain[before])
        # One that went leaves the sessions before it to be explained.
        carried, share = (after, share) if share >= 0.0 else (before, -share)
        joints = {joint for joint, _ in together}
        of_several = share > TOOL_SHARE and len(joints) > 1
        of_one = share > TOOL_SHARE_OF_ONE_JOINT and all(_explains_more(history, joint, carried) for joint in joints)
        if of_several or of_one:
            alarm = _alarm(history, one, [tool], tools)
            if alarm is not None:
                history.alarms.append(alarm)
                for joint, near in together:
                    groups[joint].remove(near)
    for own in groups.values():
        history.alarms += _of_joint(history, own)
    history.alarms.sort(key=lambda alarm: (alarm.session, alarm.joint))


def _explains_more(history: ArmHistory, joint: str, sessions: slice) -> bool:
    """Whether a tool explains more of the residual of a joint than the best of the joint's own parameters."""
    own = max(_mean_of(one.gain[sessions]) for one in history.series if one.joint == joint)
    return _mean_of(history.tool_gain[sessions, history.joints.index(joint)]) > own


def _of_joint(history: ArmHistory, groups: list[_Group]) -> list[Alarm]:
    """Neighbouring jumps of one cause are one alarm."""
    causes = [(group, _cause(history, group, groups)) for group in groups]
    alarms: list[Alarm | None] = []
    together: list[_Group] = []
    for k, (group, cause) in enumerate(causes):
        together.append(group)
        if k + 1 == len(causes) or causes[k + 1][1] is not cause:
            alarms.append(None if cause is None else _alarm(history, cause, together, groups))
            together = []
    return [alarm for alarm in alarms if alarm is not None]


def _groups(joint: str, series: Sequence[Series]) -> list[_Group]:
    jumps = [(jump, told, one) for one in series for jump, told in zip(one.jumps, one.told, strict=True)]
    groups: list[_Group] = []
    for jump in sorted(jumps, key=lambda jump: jump[:2]):
        if groups and jump[0] - groups[-1].jumps[0][0] <= NEAR:
            groups[-1].jumps.append(jump)
        else:
            groups.append(_Group(joint, [jump]))
    return groups


def _near(one: _Group, other: _Group) -> bool:
    return abs(one.session - other.session) <= NEAR


def _around(groups: Sequence[_Group], group: _Group, sessions: int) -> tuple[slice, slice]:
    """Sessions from the jump before to this one, and from this one to the next."""
    index = groups.index(group)
    start = groups[index - 1].session if index > 0 else 0
    end = groups[index + 1].session if index + 1 < len(groups) else sessions
    return slice(start, group.session), slice(group.session, end)


def _cause(history: ArmHistory, group: _Group, groups: Sequence[_Group]) -> Series | None:
    """The parameter of the joint that alone explains the largest change of the torque at the jump; none if no parameter
    changed by enough to matter."""
    before, after = _around(groups, group, len(history.time))
    best, most = None, 0.0
    for one in history.series:
        if one.joint != group.joint:
            continue
        change, std = _step(history, one, before, after)
        # The torque that the parameter explains, with its sign: before the jump it may be off the reference, too.
        torque = np.sign(one.change) * np.sqrt(np.maximum(one.gain, 0.0))
        explained = abs(_mean_of(torque[after]) - _mean_of(torque[before]))
        if _matters(change, std) and explained > most:
            best, most = one, explained
    return best


def _matters(change: float, std: float) -> bool:
    return abs(change) - 1.96 * std > LEAST_EFFECT


def _step(history: ArmHistory, one: Series, before: slice, after: slice) -> tuple[float, float]:
    """Change of a parameter from some sessions to others, and its standard deviation."""
    x, deviation = history.without_temperature(one), one.deviation
    means = [_mean(x[part], deviation[part]) for part in (before, after)]
    return means[1][0] - means[0][0], math.hypot(means[0][1], means[1][1])


def _mean(x: Array, deviation: Array) -> tuple[float, float]:
    """Weighted mean without what is far from the median, and its standard deviation."""
    there = np.isfinite(x) & np.isfinite(deviation)
    if not there.any():
        return math.nan, math.inf
    x, deviation = x[there], deviation[there]
    far = np.abs(x - np.median(x)) / deviation
    kept = far <= max(4.0, float(np.median(far)))
    weight = kept / deviation**2
    return float(np.average(x, weights=weight)), 1.0 / math.sqrt(float(weight.sum()))


def _mean_of(values: Array) -> float:
    there = values[np.isfinite(values)]
    return float(np.mean(there)) if there.size else 0.0


def _alarm(history: ArmHistory, one: Series, jumps: Sequence[_Group], groups: Sequence[_Group]) -> Alarm | None:
    """From before the first to after the last jump; what went away again ends with the last."""
    before, _ = _around(groups, jumps[0], len(history.time))
    _, after = _around(groups, jumps[-1], len(history.time))
    change, std = _step(history, one, before, after)
    until = None
    if len(jumps) > 1 and not _matters(change, std):
        until = history.time[jumps[-1].session]
        after = slice(jumps[0].session, jumps[-1].session)
        change, std = _step(history, one, before, after)
    if not _matters(change, std):
        return None
    of_temperature = None
    if np.isfinite(history.temperature).any():
        parts = [_mean_of(history.temperature[part]) for part in (before, after)]
        of_temperature = one.slope * (parts[1] - parts[0])
    alarm = Alarm(
        robot=history.robot,
        type=history.type,
        joint=one.joint,
        cause=one.name,
        unit=one.unit,
        change=change,
        interval=(change - 1.96 * std, change + 1.96 * std),
        since=history.time[jumps[0].session],
        session=jumps[0].session,
        told=jumps[0].told,
        until=until,
        steps=len(jumps) - (until is not None),
        deviations=change / std,
        of_temperature=of_temperature,
        text="",
    )
    alarm.text = _sentence(alarm, history)
    return alarm


def _sentence(alarm: Alarm, history: ArmHistory) -> str:
    low, high = alarm.interval
    if alarm.cause == TOOL:
        ends = ", ".join(f"{end:z.2f}" for end in (low, high))
        what = f"{alarm.robot}: mass at the last link {alarm.change:+z.2f} kg [{ends}]"
    else:
        of = " of the Coulomb friction" if alarm.cause == "torque offset" else ""
        # As many digits as the interval leaves.
        digits = 0 if high - low >= 0.02 else 1
        ends = ", ".join(f"{100 * end:z.{digits}f}" for end in (low, high))
        size = f"{100 * alarm.change:+z.{digits}f} % [{ends}]{of}"
        what = f"{alarm.robot}, {alarm.joint}: {alarm.cause} {size}"
    dated = alarm.since > 0
    since = f"since {date(alarm.since)}" if dated else f"since session {history.sessions[alarm.session]}"
    if alarm.until is not None:
        session = history.sessions[history.time.index(alarm.until)]
        since += f" until {date(alarm.until)}" if dated else f" until session {session}"
    if alarm.steps > 1:
        since += f", in {alarm.steps} steps"
    if alarm.of_temperature is None:
        return f"{what} {since}; temperature is not logged"
    if alarm.cause == TOOL or abs(alarm.of_temperature) < 0.1 * abs(alarm.change):
        return f"{what} {since}, temperature does not explain it"
    share = f"{100 * abs(alarm.of_temperature):.0f} % that temperature explains are taken off"
    return f"{what} {since}, {share}"


def find_events(history: ArmHistory) -> None:
    """Single sessions whose error stands out from those before and after, in itself and as a share of the torque: a
    session of gentle motion has less torque, and one of fast motion more error."""
    if len(history.time) < 2 * FEWEST_OF_BASELINE:
        return
    for j, joint in enumerate(history.joints):
        errors = [np.log(np.maximum(error[:, j], 1e-12)) for error in (history.residual, history.error)]
        for k in range(len(history.time)):
            apart, ratio = np.min([_apart(level, k) for level in errors], axis=0)
            if apart > math.log(2.0):
                history.events.append(
                    {
                        "joint": joint,
                        "session": history.sessions[k],
                        "time": history.time[k],
                        "ratio": float(np.exp(ratio)),
                    }
                )


def _apart(level: Array, k: int) -> tuple[float, float]:
    """How far session k is from the highest around it, or from three times their spread, and from their median."""
    near = np.r_[level[max(k - 4, 0) : k], level[k + 1 : k + 5]]
    near = near[np.isfinite(near)]
    if len(near) < 4 or not math.isfinite(level[k]):
        return -math.inf, -math.inf
    middle = float(np.median(near))
    spread = 1.4826 * float(np.median(np.abs(near - middle)))
    return float(level[k]) - max(float(near.max()), middle + 3.0 * spread), float(level[k]) - middle


def date(stamp: int) -> str:
    """`4 March 2026`."""
    day = np.datetime64(stamp, "ns").astype("datetime64[s]").item()
    return f"{day.day} {day:%B %Y}"
