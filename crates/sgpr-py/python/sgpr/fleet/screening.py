"""What a look at the logs of an arm found, over its sessions."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .._sgpr import Record

RANKS = ("stop", "look", "know")
"""What to do about a finding; the worst first."""


@dataclass(frozen=True)
class LogFinding:
    """A finding in the logs of an arm.

    - `kind`: such as `frozen_torque` or `saturated`; `rank`: one of `RANKS`
    - `subject`: the joint or column, empty if it is the whole log
    - `sessions`: those with it; `message`: the sentence of the first
    """

    kind: str
    rank: str
    subject: str
    sessions: list[str]
    message: str

    def to_dict(self) -> dict[str, Any]:
        """For machines."""
        return {
            "kind": self.kind,
            "rank": self.rank,
            "subject": self.subject or None,
            "sessions": len(self.sessions),
            "first": self.sessions[0],
            "message": self.message,
        }


def findings_of(records: Iterable[Record]) -> list[LogFinding]:
    """The findings in the logs of an arm, what is worse first, then what more sessions have.

    - `records`: in the order of time
    """
    found: dict[tuple[str, str, str], LogFinding] = {}
    for one in records:
        session = one.labels.get("session", one.source)
        for finding in one.screening:
            key = finding["kind"], finding["rank"], finding["subject"] or ""
            own = found.setdefault(key, LogFinding(*key, [], finding["message"]))
            if session not in own.sessions:
                own.sessions.append(session)
    return sorted(found.values(), key=lambda own: (RANKS.index(own.rank), -len(own.sessions), own.kind, own.subject))
