"""Findings of all kinds in one list: what stops, what to look at, what is good to know."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..report.numbers import counted
from .console import Output
from .errors import of_command_line
from .reading import Log

Rank = Literal["stop", "look", "know"]
RANKS: tuple[Rank, ...] = ("stop", "look", "know")
STYLES = {"stop": "red", "look": "yellow", "know": ""}

KNOWN = (
    r"triangle inequalit",
    r"base parameters? (is|are) smaller than",
    r"turns of a joint that sticks look the same",
    r"the motion hardly excites",
    r"of what the data say come from",
    r"friction that lags behind a reversal, a spring or an elastic joint looks the same",
)
"""What reports say that is right more often than it is a fault, or that nobody can act on: good to know."""


@dataclass(frozen=True)
class Found:
    """A finding.

    - `rank`: what to do about it
    - `where`: log or model, empty if it concerns all
    - `channel`: quantity of the log that it concerns, if it is one
    """

    rank: Rank
    text: str
    where: str = ""
    channel: str | None = None

    def line(self) -> str:
        """For people."""
        place = f"{self.where}: " if self.where else ""
        return f"{self.rank}: {place}{self.text}"

    def to_dict(self) -> dict[str, str]:
        """For programs."""
        return {"rank": self.rank, "where": self.where, "text": self.text}


def of_logs(logs: Iterable[Log]) -> list[Found]:
    """What is wrong with logs after their repairs."""
    return [
        Found(issue.rank, of_command_line(issue.message), log.path, issue.channel)
        for log in logs
        for part in log.stretches
        for issue in part.issues
    ]


def of_texts(texts: Iterable[str], where: str = "") -> list[Found]:
    """What a report says, ranked by what it says."""
    return [Found("know" if _is_only_known(text) else "look", of_command_line(text), where) for text in texts]


def ranked(found: Sequence[Found]) -> list[Found]:
    """The worst first, nothing twice."""
    return sorted(dict.fromkeys(found), key=lambda one: RANKS.index(one.rank))


def of_result(texts: Iterable[str], logs: Iterable[Log]) -> list[Found]:
    """What is said of a result and of the logs that it comes from, in one list."""
    return ranked([*of_texts(texts), *of_logs(logs)])


def merged(found: Sequence[Found]) -> list[Found]:
    """The same, where several quantities of a log have the same finding with other numbers, with the first of them."""
    groups: dict[object, list[Found]] = {}
    for one in found:
        plain = re.sub(r"[-+]?\d[\d.e+-]*", "", one.text.replace(f"`{one.channel}`", ""))
        groups.setdefault((one.rank, one.where, plain) if one.channel else one, []).append(one)
    return [_together(group) for group in groups.values()]


def _together(alike: Sequence[Found]) -> Found:
    first, *others = alike
    if not others:
        return first
    names = ", ".join(f"`{one.channel}`" for one in others)
    return replace(first, text=f"{first.text} (the same of {names})")


def show(found: Sequence[Found], output: Output, more: str) -> None:
    """What stops and what is to be looked at; how much more there is to know.

    - `more`: where the rest is said
    """
    everything = merged(ranked(found))
    shown = [one for one in everything if one.rank != "know"]
    grouped: dict[tuple[Rank, str], list[str]] = {}
    for one in shown:
        grouped.setdefault((one.rank, one.text), []).append(one.where)
    for (rank, text), places in grouped.items():
        where = places[0] if len(places) == 1 else f"{places[0]} and {len(places) - 1} more"
        output.finding(Found(rank, text, where).line(), STYLES[rank])
    rest = len(everything) - len(shown)
    if rest:
        output.told(f"{counted(rest, 'finding')} to know: {more}")


def as_data(found: Sequence[Found]) -> list[dict[str, Any]]:
    """For JSON."""
    return [one.to_dict() for one in ranked(found)]


def _is_only_known(text: str) -> bool:
    return any(re.search(pattern, text) for pattern in KNOWN)
