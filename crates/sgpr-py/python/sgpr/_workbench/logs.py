"""Logs of the project: what was read of them, and what the checks and the physics say."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

from .. import Model, Recording, Robot, SgprError
from ..cli.errors import BadData
from ..cli.project import KEYS, settings_of
from ..cli.reading import REPAIRS, ReadingOptions, read_log
from ..cli.reading import Log as ReadLog
from ..cli.screening import excitation, repeated
from .folder import ROLES, Folder

CANNOT = (SgprError, BadData, OSError, typer.BadParameter)

SHORTEST = 1.0
"""s, of a stretch that is compared: what is left between two gaps may be less than a filter needs."""

BY_HAND = (
    "columns",
    "units",
    "torque_constants",
    "rate",
    "accept",
    *REPAIRS,
)
"""Settings of reading that the page can change."""

WITHOUT_TORQUE = (
    "there is no torque in this log: name its “columns of torque” under “How … is read”; for motor currents name those "
    "and give the “torque constants”"
)

UNREAD = "not read yet: look into the folder again if nothing is being read"


@dataclass
class Log:
    """A log of the project: what was read, or why it could not be."""

    name: str
    role: str
    stretches: list[Recording] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    layout: str = ""
    problem: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    issues: list[dict[str, str]] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        first = self.stretches[0] if self.stretches else None
        return {
            "name": self.name,
            "role": self.role,
            "problem": self.problem,
            "unread": self.problem == UNREAD,
            "samples": sum(len(part) for part in self.stretches),
            "seconds": sum(part.duration for part in self.stretches),
            "rate": None if first is None else first.sample_rate_hz,
            "joints": [] if first is None else first.joint_names,
            "layout": self.layout,
            "said": self.said,
            "issues": self.issues,
            "settings": self.settings,
        }


def read(folder: Folder, robot: Robot | None, name: str, role: str) -> Log:
    """The log of that name, as the project file says that it is read."""
    log = Log(name, role)
    path: Path | None = None
    try:
        path = folder.path(name)
        log.settings = {k: v for k, v in settings_of(str(path))[0].items() if k in KEYS.values()}
        found = read_log(str(path), ReadingOptions(), None if robot is None else robot.joint_names)
        # By their names in the folder, so that a model does not tell where the folder is.
        log.stretches = [part._from_source(name, part.notes) for part in found.stretches]
        log.said = [*found.raw.notes, *found.actions]
        log.layout = "" if found.raw.layout is None else found.raw.layout["text"]
        log.issues = [{"rank": i.rank, "text": i.message} for part in log.stretches for i in part.issues]
        if all(part.tau is None for part in log.stretches):
            log.issues.insert(0, {"rank": "stop", "text": WITHOUT_TORQUE})
    except CANNOT as error:
        log.problem = str(error).removeprefix(f"{path}: ")
        log.role = role if role in ROLES else "off"
    return log


def used(logs: Mapping[str, Log], role: str) -> list[Recording]:
    """The stretches of all logs of a role."""
    return [part for log in logs.values() if log.role == role for part in log.stretches]


def judged(logs: Mapping[str, Log]) -> dict[str, list[Recording]]:
    """Logs that are compared, by name, without stretches that are too short to be filtered."""
    wanted = [log for log in logs.values() if log.role != "off" and log.stretches]
    found = {log.name: long_enough(log.stretches) for log in wanted}
    return {name: parts for name, parts in found.items() if parts}


def long_enough(stretches: Iterable[Recording]) -> list[Recording]:
    """Stretches that can be filtered."""
    return [part for part in stretches if part.duration >= SHORTEST]


def as_read(logs: Mapping[str, Log], role: str) -> list[ReadLog]:
    """Logs of a role as the commands hold them."""
    wanted = [log for log in logs.values() if log.role == role and log.stretches]
    return [ReadLog(log.name, log.stretches[0], log.stretches, []) for log in wanted]


def checked(model: Model, logs: Mapping[str, Log]) -> dict[str, Any]:
    """What the physics says of the training logs."""
    if model.fit is None:
        return {}
    texts = [
        *repeated(as_read(logs, "train"), as_read(logs, "test")),
        *([] if model.report is None else model.report.warnings),
    ]
    condition, undetermined = model.fit["scaled_condition"], model.fit["undetermined"]
    return {
        "excitation": excitation(condition, len(model.parameters), undetermined),
        "texts": list(dict.fromkeys(texts)),
    }
