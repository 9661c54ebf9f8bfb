"""The project: a folder with a robot and logs, and `sgpr.toml` beside them, which the commands read as well."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from .._pages import write_page
from ..cli.errors import BadData
from ..cli.inputs import kind_of
from ..cli.project import NAME
from ..cli.robots import READY_MADE
from ..reading import suffixes

ROBOT_SUFFIXES = (".urdf", ".xml", ".toml", ".json")
LOAD_WORD = re.compile(r"(?<!un)(?<!no_)(?<!no-)(?<!without_)load", re.IGNORECASE)
"""A log with a load is one of another arm."""
TEST_WORDS = ("test", "valid", "eval", "unseen", "check")
MOST_LOGS = 200
LARGEST_PROJECT_FILE = 1_000_000

ROLES = ("train", "test", "off")


class Folder:
    """Where the files of a project are.

    - `root`: no path outside of it is read because a page or `sgpr.toml` says so, only because the command line does
    - `allowed`: files outside of it that the command line named, by the name that the project uses for them
    """

    def __init__(self, root: Path, allowed: Sequence[Path] = ()) -> None:
        self.root = root.resolve()
        self.allowed = {self.name_of(path): path.resolve() for path in allowed}

    @property
    def file(self) -> Path:
        """The project file."""
        return self.root / NAME

    def name_of(self, path: Path) -> str:
        """How the project calls a file: from its folder, with slashes."""
        return Path(os.path.relpath(path.resolve(), self.root)).as_posix()

    def path(self, name: str) -> Path:
        """The file of that name, which is in the folder or was named on the command line.

        Raises BadData for any other.
        """
        if name in self.allowed:
            return self.allowed[name]
        try:
            path = (self.root / name).resolve()
        except (OSError, ValueError) as error:
            raise BadData(f"{name!r}: no name of a file") from error
        if not path.is_relative_to(self.root) or path == self.root:
            raise BadData(
                f"{name}: outside of the folder {self.root}; put it there, or name it when you start: "
                "sgpr workbench ROBOT LOG..."
            )
        return path

    def robots(self) -> list[str]:
        """Files that may be robots."""
        found = [path for path in self._files() if path.suffix.lower() in ROBOT_SUFFIXES and path.name != NAME]
        return [path.name for path in found if _is_robot(path)]

    def logs(self) -> list[str]:
        """Files that may be logs, those with tables of results of the commands left out."""
        known = suffixes()
        return [path.name for path in self._files() if path.name.lower().endswith(known)][:MOST_LOGS]

    def _files(self) -> list[Path]:
        found = [path for path in self.root.iterdir() if path.is_file() and not path.name.startswith(".")]
        return sorted(found, key=lambda path: path.name)

    def load(self) -> dict[str, Any]:
        """What the project file says; empty if there is none."""
        if not self.file.is_file():
            return {}
        if self.file.stat().st_size > LARGEST_PROJECT_FILE:
            raise BadData(f"{self.file}: larger than {LARGEST_PROJECT_FILE} bytes; no project file is")
        try:
            return dict(tomlkit.parse(self.file.read_text(encoding="utf-8")).unwrap())
        except (TOMLKitError, UnicodeDecodeError) as error:
            raise BadData(f"{self.file}: {error}") from error

    def save(self, changes: Mapping[str, Any]) -> None:
        """Writes entries of the project file, complete or not at all; None removes one, all else stays as it is."""
        document = tomlkit.document()
        if self.file.is_file():
            document = tomlkit.parse(self.file.read_text(encoding="utf-8"))
        # At the end of the file they would belong to its last table.
        first = tomlkit.document()
        for key, value in changes.items():
            if value is None:
                document.pop(key, None)
            elif document.get(key) == value:
                continue
            elif _is_tables(value):
                document.pop(key, None)
                document[key] = _tables(value)
            elif key in document or isinstance(value, Mapping):
                document[key] = value
            else:
                first[key] = value
        write_page(self.file, tomlkit.dumps(first) + tomlkit.dumps(document))


def guessed_roles(names: Sequence[str]) -> dict[str, str]:
    """Which logs train and which test: by their names, else the last one tests; those with a load are left out."""
    loaded = {name: "off" for name in names if LOAD_WORD.search(name)}
    if len(loaded) < len(names):
        names = [name for name in names if name not in loaded]
    else:
        loaded = {}
    tests = [name for name in names if any(word in name.lower() for word in TEST_WORDS)]
    if not tests and len(names) > 1:
        tests = [names[-1]]
    if len(tests) == len(names):
        tests = tests[1:]
    return {name: "test" if name in tests else "train" for name in names} | loaded


def sorted_out(names: Sequence[str]) -> tuple[Path, str | None, list[Path]]:
    """Folder, robot and logs of what the command line named: one folder, or a robot and logs in any order."""
    if len(names) == 1 and Path(names[0]).is_dir():
        return Path(names[0]), None, []
    robots = [name for name in names if kind_of(name) == "robot"]
    logs = [Path(name) for name in names if kind_of(name) == "log"]
    rest = [name for name in names if name not in robots and Path(name) not in logs]
    if rest:
        raise BadData(f"{rest[0]}: a model; name a robot and logs, or the folder that holds them")
    if len(robots) > 1:
        raise BadData(f"{' and '.join(robots)}: one robot at a time")
    place = logs[0] if logs else Path(robots[0]) if robots and robots[0] not in READY_MADE else Path("x")
    return place.resolve().parent, robots[0] if robots else None, logs


def _is_robot(path: Path) -> bool:
    head = path.read_bytes()[:4096]
    if path.suffix.lower() in (".urdf", ".xml"):
        return b"<robot" in head
    return b"convention" in head


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)


def _tables(value: list[Mapping[str, Any]]) -> Any:
    rows = tomlkit.aot()
    for each in value:
        rows.append(tomlkit.item(dict(each)))
    return rows
