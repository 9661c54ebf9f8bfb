"""What changed, in which arm, and when."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._sgpr import Model, Record, Robot, SgprError
from .alarms import LEAST_EFFECT, find_events, name_changes
from .doubtful import MixedTool, mixed_tools, of_two_arms, told_apart, without_doubles, without_wrong_clocks
from .evidence import Track, find_jumps
from .screening import findings_of
from .series import TOOL, ArmHistory, Series, by_arm, history_of, session_of, start_of, tool_of, with_tool
from .sisters import find_outliers, share_scatter, share_temperature

FALSE_ALARMS = 0.5
"""Per arm and year, all its joints and parameters together, that chance may make."""
DAYS_PER_YEAR = 365.25
NANOSECONDS_PER_DAY = 86_400e9
WEAR_PER_YEAR = {"Fv": 0.1, "Fc": 0.1, "tau0": 0.1, "gain": 0.01, "tool": 0.05}
"""Standard deviation of what a parameter wanders in a year without being broken, as a share of its scale (kg)."""
RELATIVE = ("gain", "tool")
"""Parameters that are nothing but relative to the reference."""
FEWEST_SESSIONS = 4
Sessions = NDArray[np.intp]


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
        With the labels `robot` and `type`, as `sgpr fleet run` makes them; sessions with another `tool` have a
        reference of their own.
    robots : dict of str to Robot or Model
        By type. A model is the reference of all arms of its type; with a robot each arm's reference is identified
        from its first sessions.
    false_alarms : float
        Alarms per arm and year that chance may make, if all changes are looked for every session.
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
    every_session = by_arm(records)
    if not every_session:
        raise SgprError("there is no record")
    arms, doubtful = without_wrong_clocks(every_session)

    def history(key: tuple[str, str]) -> ArmHistory:
        return history_of(*key, arms, robots[key[0]], temperature)

    of_arms: dict[tuple[str, str], ArmHistory] = {}
    for done, key in enumerate(arms):
        kind, robot = key
        if kind not in robots:
            raise SgprError(f"there is no robot for the type `{kind}` of {robot}: give --robot {kind or 'ROBOT'}=...")
        of_arms[key] = history(key)
        if progress is not None:
            progress("arms", done + 1, len(arms))
    foreign = {key: own.foreign for key, own in of_arms.items()}
    shared = of_two_arms(arms, foreign)
    mixed: dict[tuple[str, str], list[MixedTool]] = {}
    for key in arms:
        reasons = shared.get(key, {})
        single, doubles = without_doubles([one for one in arms[key] if session_of(one) not in reasons], foreign[key])
        if reasons or doubles:
            doubtful[key] |= reasons | doubles
            arms[key] = single
            of_arms[key] = history(key)
        mixed[key] = mixed_tools(of_arms[key])
        if mixed[key]:
            arms[key] = told_apart(arms[key], mixed[key])
            of_arms[key] = history(key)
    found = list(of_arms.values())
    every = []
    for kind in sorted({own.type for own in found}):
        sisters = [own for own in found if own.type == kind]
        _look(sisters, false_alarms)
        anew = [_with_tools(own, arms, robots[kind], temperature) for own in sisters]
        if any(anew):
            again = [other or own for other, own in zip(anew, sisters, strict=True)]
            _look(again, false_alarms)
            for other, own in zip(anew, sisters, strict=True):
                if other is not None:
                    _keep_tools(other, own)
            sisters = again
        every += sorted(sisters, key=lambda own: own.robot)
    for own in every:
        key = own.type, own.robot
        own.findings, own.left_out = findings_of(every_session[key]), doubtful[key]
        own.mixed = [one.text for one in mixed[key]]
    return every


def to_dict(history: ArmHistory) -> dict[str, Any]:
    """An arm for machines: alarms and events, what could have been seen (`shows`: the smallest change), and what a look
    at its logs found."""
    return {
        "robot": history.robot,
        "type": history.type,
        "sessions": len(history.time),
        "hours": history.hours,
        "reference_borrowed": history.borrowed,
        "alarms": [asdict(alarm) for alarm in history.alarms],
        "events": history.events,
        "outliers": history.outliers,
        "foreign": history.foreign,
        "left_out": history.left_out,
        "mixed_tools": history.mixed,
        "findings": [finding.to_dict() for finding in history.findings],
        "watched": [
            {"joint": one.joint, "parameter": one.name, "shows": one.shows} for one in history.series if one.watched
        ],
        "not_watched": [{"joint": one.joint, "parameter": one.name} for one in history.series if not one.watched],
    }


def _look(sisters: Sequence[ArmHistory], false_alarms: float) -> None:
    """What changed in the arms of a type."""
    share_temperature(sisters)
    share_scatter(sisters)
    for history in sisters:
        history.alarms, history.events, history.outliers = [], [], []
    find_outliers(sisters)
    _find_jumps(sisters, false_alarms)
    for history in sisters:
        name_changes(history)
        find_events(history)


def _with_tools(
    history: ArmHistory, arms: Mapping[tuple[str, str], Sequence[Record]], robot: Robot | Model, temperature: str
) -> ArmHistory | None:
    """The arm again as if the tools that it was found to carry had been declared: what its joints do later is not to
    be measured by another body. None if none was found, or no reference can be made."""
    tools = [alarm for alarm in history.alarms if alarm.cause == TOOL]
    if not tools:
        return None

    def tool(one: Record) -> str:
        carried = [k for k, alarm in enumerate(tools) if alarm.since <= start_of(one) < (alarm.until or math.inf)]
        return f"{tool_of(one)} and found {carried[-1] + 1}" if carried else tool_of(one)

    key = history.type, history.robot
    own = [with_tool(one, tool(one)) for one in arms[key]]
    try:
        return history_of(*key, {**arms, key: own}, robot, temperature)
    except SgprError:
        return None


def _keep_tools(history: ArmHistory, before: ArmHistory) -> None:
    """Tools and errors as the first reference tells them."""
    history.alarms = [alarm for alarm in history.alarms if alarm.cause != TOOL]
    history.alarms += [alarm for alarm in before.alarms if alarm.cause == TOOL]
    history.alarms.sort(key=lambda alarm: (alarm.session, alarm.joint))
    history.series = [one for one in history.series if one.parameter != TOOL]
    history.series += [one for one in before.series if one.parameter == TOOL]
    history.error, history.residual, history.tools = before.error, before.residual, before.tools


def _find_jumps(sisters: Sequence[ArmHistory], false_alarms: float) -> None:
    """Jumps of all parameters in all arms of a type."""
    tracks, seen = [], []
    for history in sisters:
        own = [(one, there) for one in history.series for there in _stretches(history, one)]
        limit = max(len(own), 1) * _sessions_per_alarm(history, false_alarms)
        tracks += [_track(history, one, there, limit) for one, there in own]
        seen += own
        for one in history.series:
            one.jumps, one.told, one.shows = [], [], math.inf
    if not tracks:
        return
    for found, (one, there) in zip(find_jumps(tracks), seen, strict=True):
        one.factor = found.factor
        one.jumps += [int(there[k]) for k in found.jumps]
        one.told += [int(there[k]) for k in found.told]
        one.shows = max(found.shows, LEAST_EFFECT)


def _stretches(history: ArmHistory, one: Series) -> list[Sessions]:
    """Sessions that measure a parameter. What is relative to a reference is apart for each declared tool, as the
    references are, and only sessions count that the reference was not fitted to."""
    there = np.isfinite(history.without_temperature(one)) & np.isfinite(one.deviation)
    tools = np.array(history.tools)
    if one.parameter in RELATIVE:
        there &= ~history.referred
        parts = [np.flatnonzero(there & (tools == tool)) for tool in dict.fromkeys(history.tools)]
    else:
        parts = [np.flatnonzero(there)]
    return [part for part in parts if len(part) >= FEWEST_SESSIONS]


def _track(history: ArmHistory, one: Series, there: Sessions, limit: float) -> Track:
    day = np.array(history.time)[there] / NANOSECONDS_PER_DAY
    wander = _wear(history, one) ** 2 / DAYS_PER_YEAR * np.diff(day, prepend=day[0])
    tools = np.array(history.tools)[there]
    # References of two tools differ by what their fits, and a session, are unsure of: the offset of a joint under
    # gravity is known from one session to the next better than the fit tells it from the moments of the links.
    own, unsure = one.deviation[there], one.unsure[there]
    changed = tools[1:] != tools[:-1]
    wander[1:] += np.where(changed, own[1:] ** 2 + unsure[1:] ** 2 + unsure[:-1] ** 2, 0.0)
    value = history.without_temperature(one)[there]
    return Track(value, one.deviation[there], wander, f"{one.joint}.{one.parameter}", limit)


def _wear(history: ArmHistory, one: Series) -> float:
    """What a parameter wanders in a year. The gain of a joint whose torque is mostly friction wanders with the
    friction, by as much of it as temperature, which moves friction and no gain, shows."""
    own = WEAR_PER_YEAR.get(one.parameter, WEAR_PER_YEAR["Fc"])
    friction = history.find(one.joint, "Fc")
    if one.parameter != "gain" or friction is None or friction.slope == 0.0:
        return own
    return math.hypot(own, min(abs(one.slope / friction.slope), 1.0) * WEAR_PER_YEAR["Fc"])


def _sessions_per_alarm(history: ArmHistory, false_alarms: float) -> float:
    days = (history.time[-1] - history.time[0]) / NANOSECONDS_PER_DAY
    per_year = max(len(history.time) - 1, 1) / max(days / DAYS_PER_YEAR, 1e-3)
    return max(per_year / false_alarms, 1.0)
