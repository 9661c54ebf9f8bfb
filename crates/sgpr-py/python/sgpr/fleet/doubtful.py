"""Sessions that are not what they seem: with a wrong clock, of two arms, twice, or with another tool."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .._sgpr import Record
from .series import TOOL, ArmHistory, session_of, start_of, with_tool

NANOSECONDS_PER_DAY = 86_400e9
FAR_DAYS = 3653.0
"""No arm is looked at for ten years: such sessions have a wrong clock."""
FIRST_DATE = int(np.datetime64("2000-01-01", "ns").astype(np.int64))
"""Stamps before it count from the start of the log: they tell no overlap."""
OVERLAP = 0.5
"""Share of the shorter of two sessions from which on they are one, not two files that a recorder cut."""
FEWEST_OF_A_TOOL, FEWEST_SWITCHES = 3, 3
APART, LEAST_APART_KG = 6.0, 0.05
"""Two tools are so many times as far apart as the sessions of either scatter, and so much."""
Key = tuple[str, str]
"""Type and name of an arm."""


def without_wrong_clocks(
    arms: Mapping[Key, Sequence[Record]],
) -> tuple[dict[Key, list[Record]], dict[Key, dict[str, str]]]:
    """The sessions of each arm but those whose clock is wrong, and the reasons for these by session."""
    kept: dict[Key, list[Record]] = {}
    reasons: dict[Key, dict[str, str]] = {}
    for key, own in arms.items():
        middle = float(np.median([start_of(one) for one in own]))
        wrong = [one for one in own if abs(start_of(one) - middle) > FAR_DAYS * NANOSECONDS_PER_DAY]
        # Of two that are so far apart neither is the usual one.
        wrong = wrong if len(wrong) < len(own) else []
        kept[key] = [one for one in own if one not in wrong]
        dates = {session_of(one): np.datetime64(start_of(one), "ns").astype("datetime64[D]") for one in wrong}
        why = "more than ten years from the other sessions of the arm"
        reasons[key] = {session: f"its clock says {date}, {why}" for session, date in dates.items()}
    return kept, reasons


def of_two_arms(
    arms: Mapping[Key, Sequence[Record]], foreign: Mapping[Key, Sequence[str]]
) -> dict[Key, dict[str, str]]:
    """Sessions that are listed for two arms, both of which they could be of, with the reasons to leave them out.

    - `foreign`: sessions of another robot
    """
    owners: dict[str, set[str]] = {}
    for key, own in arms.items():
        for one in own:
            if session_of(one) not in foreign[key]:
                owners.setdefault(one.content_hash, set()).add(key[1])
    found: dict[Key, dict[str, str]] = {}
    for key, own in arms.items():
        for one in own:
            others = sorted(owners.get(one.content_hash, set()) - {key[1]})
            if others and session_of(one) not in foreign[key]:
                why = f"the same samples are a session of {others[0]}, too: they count for neither"
                found.setdefault(key, {})[session_of(one)] = why
    return {key: own for key, own in found.items() if len(own) < len(arms[key])}


def without_doubles(own: Sequence[Record], foreign: Sequence[str]) -> tuple[list[Record], dict[str, str]]:
    """The sessions of an arm without those most of whose time another one has, too, and the reasons for these.

    - `foreign`: sessions that are of another robot, whose time says nothing
    """
    kept: list[Record] = []
    reasons: dict[str, str] = {}
    before: list[Record] = []
    for one in sorted(own, key=lambda one: (start_of(one), -one.samples)):
        start, end = _time(one)
        if start < FIRST_DATE or session_of(one) in foreign:
            kept.append(one)
            continue
        before = [other for other in before if _time(other)[1] > start]
        same = next((other for other in before if _share(other, start, end) > OVERLAP), None)
        if same is None:
            before.append(one)
            kept.append(one)
        else:
            reasons[session_of(one)] = f"{session_of(same)} is of the same time: an arm does not do two things at once"
    return kept, reasons


def _share(one: Record, start: int, end: int) -> float:
    """Of the shorter of a session and one that does not begin earlier, the share that is in both."""
    own_start, own_end = _time(one)
    return (min(end, own_end) - start) / max(min(end - start, own_end - own_start), 1)


def _time(one: Record) -> tuple[int, int]:
    start = start_of(one)
    return start, start + one.end_time - one.start_time


@dataclass(frozen=True)
class MixedTool:
    """A name of a tool under which the arm carries two bodies in turn.

    - `kilograms`: by which they differ; `heavy`: sessions with the heavier one
    """

    tool: str
    kilograms: float
    heavy: list[str]
    text: str


def mixed_tools(history: ArmHistory) -> list[MixedTool]:
    """Tools whose sessions fall into two masses, back and forth: a change that lasts is none of them."""
    mass = next(one for one in history.series if one.parameter == TOOL)
    found = []
    for tool in dict.fromkeys(history.tools):
        there = [k for k, name in enumerate(history.tools) if name == tool and np.isfinite(mass.change[k])]
        values = mass.change[there]
        if len(there) < 2 * FEWEST_OF_A_TOOL:
            continue
        order = np.sort(values)
        gap = int(np.argmax(np.diff(order)))
        light, heavy = order[: gap + 1], order[gap + 1 :]
        if min(len(light), len(heavy)) < FEWEST_OF_A_TOOL:
            continue
        is_heavy = values >= heavy[0]
        scatter = max(light.std(), heavy.std(), float(np.median(mass.std[there])))
        apart = float(heavy.mean() - light.mean())
        switches = int(np.count_nonzero(np.diff(is_heavy)))
        if switches < FEWEST_SWITCHES or apart < max(APART * scatter, LEAST_APART_KG):
            continue
        sessions = [history.sessions[k] for k, own in zip(there, is_heavy, strict=True) if own]
        named = f"under the tool `{tool}`" if tool else "under one tool"
        text = (
            f"{history.robot}: {named} {len(sessions)} of {len(there)} sessions carry {apart:.2f} kg more, back and "
            "forth: two tools under one name; they are measured apart"
        )
        found.append(MixedTool(tool, apart, sessions, text))
    return found


def told_apart(own: Sequence[Record], mixed: Sequence[MixedTool]) -> list[Record]:
    """The sessions of an arm, those with the heavier one of two tools under a name of its own."""
    heavy = {(one.tool, session) for one in mixed for session in one.heavy}
    return [
        with_tool(one, f"{one.labels.get('tool', '')} (heavier)")
        if (one.labels.get("tool", ""), session_of(one)) in heavy
        else one
        for one in own
    ]
