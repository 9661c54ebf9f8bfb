"""Which logs a fleet has: by a pattern, or by a table that names robot, session and path."""

import csv
import glob
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from .._sgpr import SgprError

COLUMNS = ("path", "robot", "session", "type", "tool", "start")
_MOST_TABLE_BYTES = 1 << 30


@dataclass(frozen=True)
class Log:
    """A log of a fleet.

    - `robot`: name of the arm
    - `type`: name of the robot file that it has; empty if all arms share one
    - `labels`: more columns of the table, `session` and `start` (ISO 8601) among them
    """

    path: str
    robot: str
    type: str = ""
    labels: dict[str, str] = field(default_factory=dict, hash=False)


def find(given: str, storage: dict[str, Any] | None = None) -> list[Log]:
    """The logs that a pattern or a table names, sorted by path.

    - `given`: a pattern such as `logs/**/*.csv.gz` or `s3://bucket/logs/*/*.parquet`, whose arms are the folders that
      the logs are in; or a table `fleet.csv` with the columns `path` and `robot`, and if wished `session`, `type`,
      `start`
    - `storage`: options for the store of logs that are not on this machine's disks, as fsspec takes them

    Raises SgprError if there is no log, or the table lacks a column.
    """
    if is_table(given):
        logs = _of_table(Path(given))
    else:
        logs = [Log(path, *_named_by(path)) for path in _matching(given, storage or {})]
    if not logs:
        raise SgprError(f"{given}: no log is there; quote a pattern so that the shell does not expand it")
    return sorted(set(logs), key=lambda log: (log.path, log.robot))


def is_remote(path: str) -> bool:
    """Whether a path is of another store than the disks of this machine."""
    return "://" in path and not path.startswith("file://")


def is_table(given: str) -> bool:
    """Whether this is a table of logs."""
    place = Path(given)
    if is_remote(given) or place.suffix.lower() != ".csv" or not place.is_file():
        return False
    with place.open(encoding="utf-8", errors="replace", newline="") as file:
        return {"path", "robot"} <= {name.strip() for name in next(csv.reader(file), [])}


def _of_table(table: Path) -> list[Log]:
    if table.stat().st_size > _MOST_TABLE_BYTES:
        raise SgprError(f"{table}: too large for a table of logs")
    logs = []
    with table.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        for row in reader:
            cells = {str(name).strip(): (value or "").strip() for name, value in row.items() if isinstance(value, str)}
            if not cells.get("path") or not cells.get("robot"):
                raise SgprError(f"{table}, line {reader.line_num}: `path` and `robot` are needed")
            path = cells.pop("path")
            if not is_remote(path) and not Path(path).is_absolute():
                path = str(table.parent / path)
            robot, kind = cells.pop("robot"), cells.pop("type", "")
            logs.append(Log(path, robot, kind, {name: value for name, value in cells.items() if value}))
    return logs


def _matching(pattern: str, storage: dict[str, Any]) -> list[str]:
    if not is_remote(pattern):
        return glob.glob(pattern, recursive=True)
    import fsspec  # type: ignore[import-untyped]

    system, _, _ = fsspec.get_fs_token_paths(pattern, storage_options=storage)
    return [system.unstrip_protocol(path) for path in system.glob(pattern)]


def _named_by(path: str) -> tuple[str, str, dict[str, str]]:
    place = PurePosixPath(path)
    return place.parent.name or ".", "", {"session": place.name.partition(".")[0]}
