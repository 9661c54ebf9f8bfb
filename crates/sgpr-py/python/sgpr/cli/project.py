"""`sgpr.toml` beside the logs: what was said once about reading them holds for all commands.

units = { position = "deg" }
torque_constants = [9.6, 9.6, 6.0, 2.5, 2.5, 1.6]   # or { elbow = 9.6, ... }

[files."day1_*.csv"]
rows = [635, 3510]

The workbench keeps there what a project is: `robot`, the logs to `train` and to `test`, and the steps of its models.
"""

import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from .._pages import write_page
from .errors import BadData, wrong_use
from .inputs import kind_of
from .robots import is_urdf

NAME = "sgpr.toml"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_name(value: object) -> bool:
    return isinstance(value, str)


def _is_flag(value: object) -> bool:
    return isinstance(value, bool)


def _is_clock(value: object) -> bool:
    return value in ("header", "log")


def _is_rate(value: object) -> bool:
    return value == "median" or _is_number(value)


def _list_of(fits: Callable[[object], bool], length: int | None = None) -> Callable[[object], bool]:
    return lambda value: (
        isinstance(value, list | tuple) and len(value) == (length or len(value)) and all(map(fits, value))
    )


def _table_of(fits: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, Mapping) and all(map(fits, value.values()))


def _either(*of: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: any(fits(value) for fits in of)


class Setting(NamedTuple):
    """A key of the file.

    - `argument`: of `sgpr.read` or `Recording.repair`
    - `fits`: whether a value is of its kind
    - `example`: a value, as it stands in the file
    """

    argument: str
    fits: Callable[[object], bool]
    example: str


SETTINGS = {
    "columns": Setting(
        "columns", _table_of(_either(_is_name, _list_of(_is_name))), '{ position = "{name}_pos", torque = "i{}" }'
    ),
    "units": Setting("units", _table_of(_is_name), '{ position = "deg" }'),
    "torque_constants": Setting(
        "torque_constants", _either(_list_of(_is_number), _table_of(_is_number)), "{ shoulder = 9.6, elbow = 6.0 }"
    ),
    "rate": Setting("sample_rate_hz", _is_number, "250.0"),
    "rows": Setting("rows", _list_of(_is_whole, 2), "[635, 3510]"),
    "logged_joints": Setting("logged_names", _list_of(_is_name), '["axis1", "axis2"]'),
    "topics": Setting("topics", _list_of(_is_name), '["/joint_states"]'),
    "clock": Setting("clock", _is_clock, '"header", or "log"'),
    "recover": Setting("recover", _is_flag, "true"),
    "accept": Setting("accept", _list_of(_is_name), '["joints_by_order"]'),
    "trim": Setting("trim", _list_of(_is_number, 2), "[2.0, 30.0]"),
    "sort": Setting("sort", _is_flag, "true"),
    "drop_duplicates": Setting("drop_duplicates", _is_flag, "true"),
    "drop_not_finite": Setting("drop_not_finite", _is_flag, "true"),
    "replace_strays": Setting("replace_strays", _is_flag, "true"),
    "drop_repeated": Setting("drop_repeated", _is_flag, "true"),
    "unwrap": Setting("unwrap", _is_flag, "true"),
    "split_gaps": Setting("split_gaps", _is_number, "0.05"),
    "resample": Setting("resample", _is_rate, '250.0, or "median"'),
    "joints": Setting("joints", _list_of(_is_name), '["shoulder", "elbow"]'),
}

KEYS = {key: setting.argument for key, setting in SETTINGS.items()}
"""Key in the file -> argument of `sgpr.read` or `Recording.repair`."""

OF_PROJECT = ("robot", "train", "test", "effects", "steps", "current", "pinned")
"""What the workbench keeps here: files by their names from this folder, and models as steps that lead to them."""

OF_ONE_LOG = ("rows", "trim", "seconds")
"""What holds for the log that it was said of, not for others like it."""


def project_file(log: str) -> Path | None:
    """The file that holds for a log: beside it, or in the folder where the command runs."""
    for folder in (Path(log).parent, Path()):
        if (folder / NAME).is_file():
            return folder / NAME
    return None


def settings_of(log: str) -> tuple[dict[str, Any], Path | None]:
    """What the project says of a log, and where."""
    place = project_file(log)
    if place is None:
        return {}, None
    try:
        data = tomllib.loads(place.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{place}: {error}") from error
    for key in OF_PROJECT:
        data.pop(key, None)
    files = data.pop("files", {})
    if not isinstance(files, dict) or not all(isinstance(each, dict) for each in files.values()):
        raise BadData(f'{place}: `files` holds one table for each pattern of names: [files."day1_*.csv"]')
    found = _checked(place, data)
    for pattern, own in files.items():
        checked = _checked(place, own)
        if fnmatch(Path(log).name, pattern):
            found |= checked
    return found, place


def joints_of(robot: str, joints: list[str] | None, logs: Sequence[str]) -> list[str] | None:
    """The joints of a URDF to model: those that the command names, else those of the project of the logs."""
    if joints is not None or not logs or not Path(robot).exists() or kind_of(robot) != "robot" or not is_urdf(robot):
        return joints
    found: list[str] | None = settings_of(logs[0])[0].get("joints")
    return found


OF_PROJECT_FILE = "that of sgpr.toml"


@dataclass(frozen=True)
class RobotAndLogs:
    """Options of a command that fits: the arm, logs to learn from, and logs to judge by."""

    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="URDF, DH table (.toml, .json), puma560 or two_link.",
            show_default=OF_PROJECT_FILE,
        ),
    ] = None
    train: Annotated[
        list[str] | None,
        typer.Option("--train", metavar="FILE...", help="Logs to learn from.", show_default=OF_PROJECT_FILE),
    ] = None
    test: Annotated[
        list[str] | None,
        typer.Option(
            "--test",
            metavar="FILE...",
            help="Logs to judge by, not used to learn.",
            show_default="those of sgpr.toml with its --train",
        ),
    ] = None

    def project(self) -> "Project":
        """What the command line names; what it does not name is as in `sgpr.toml` of the folder where the command runs.

        The split of the project holds as a whole: who names logs to train names those to test as well.
        """
        data = _project() if self.robot is None or not self.train else {}
        robot = _robot(self.robot, data, "--robot")
        logs = {role: _names(data, role) for role in ("train", "test")}
        train = self.train or logs["train"]
        if not train:
            raise wrong_use(f"is missing: name logs, or have them in {NAME} here (sgpr workbench makes it)", "--train")
        test = self.test or ([] if self.train else logs["test"])
        both = sorted(set(train) & set(test))
        if both:
            raise wrong_use(f"{', '.join(both)}: a log that trains the model cannot test it", "--test")
        return Project(robot, list(train), list(test), None if self.robot else _effects(data))


@dataclass(frozen=True)
class ModelAndLogs(RobotAndLogs):
    """The same for a command that goes on from a model, too."""

    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT|MODEL",
            help="URDF, DH table, puma560 or two_link; or a model (.sgpr) that was identified from the training logs.",
            show_default=OF_PROJECT_FILE,
        ),
    ] = None


ModelArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="[MODEL]",
        help="A saved model (.sgpr), or a robot for its file's model.",
        show_default="the robot of sgpr.toml",
    ),
]


def model_and_logs(model: str | None, files: Sequence[str] | None) -> tuple[str, list[str]]:
    """What a command that judges a model names; what it does not name is as in `sgpr.toml` of the folder where it runs:
    the robot, and the logs to test, or to train if none tests.
    """
    files = list(files or [])
    if model is not None and kind_of(model) == "log":
        files = [model, *files]
        model = None
    data = _project() if model is None or not files else {}
    if model is None and not data.get("robot") and files:
        others = [name for name in files if Path(name).exists() and kind_of(name) != "log"]
        if others:
            raise wrong_use(f"`{files[0]}` is a log; first the model, then the logs: {others[0]} {files[0]}", "MODEL")
    robot = _robot(model, data, "MODEL")
    files = files or _names(data, "test") or _names(data, "train")
    if not files:
        raise wrong_use(f"is missing: name a log, or have logs in {NAME} here (sgpr workbench makes it)", "FILE")
    return robot, files


class Project(NamedTuple):
    """What a command works on.

    - `effects`: those of the fit that the current step of the project comes from; None where nothing says so
    """

    robot: str
    train: list[str]
    test: list[str]
    effects: list[str] | None


def _robot(named: str | None, data: Mapping[str, Any], option: str) -> str:
    found = named or data.get("robot")
    if found and not isinstance(found, str):
        raise BadData(f'{NAME}: robot = {_toml(found)} does not fit; write it like robot = "arm.urdf"')
    if not found:
        raise wrong_use(f"is missing: name a robot, or have one in {NAME} here (sgpr workbench makes it)", option)
    return found


def _project() -> dict[str, Any]:
    place = Path(NAME)
    if not place.is_file():
        return {}
    try:
        return tomllib.loads(place.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{place}: {error}") from error


def _names(data: Mapping[str, Any], key: str) -> list[str]:
    names = data.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadData(f"{NAME}: `{key}` is a list of names")
    return names


def _effects(data: Mapping[str, Any]) -> list[str] | None:
    steps = data.get("steps", [])
    if not isinstance(steps, list) or not all(isinstance(step, Mapping) and "id" in step for step in steps):
        raise BadData(f"{NAME}: `steps` is a list of tables with an `id`")
    by_id = {step["id"]: step for step in steps}
    name, seen = data.get("current"), set()
    while name in by_id and name not in seen:
        seen.add(name)
        step = by_id[name]
        if "after" not in step:
            return _names(step, "effects")
        name = step["after"]
    return None


def remember(log: str, settings: Mapping[str, Any]) -> Path:
    """Writes settings beside a log, those of one log under its name; what is there already stays if it is not named."""
    place = Path(log).parent / NAME
    known: dict[str, Any] = tomllib.loads(place.read_text(encoding="utf-8")) if place.is_file() else {}
    names = {argument: key for key, argument in KEYS.items()}
    for argument, value in settings.items():
        if argument in OF_ONE_LOG:
            known.setdefault("files", {}).setdefault(Path(log).name, {})[names[argument]] = value
        else:
            known[names[argument]] = value
    files = known.pop("files", {})
    lines = [f"{key} = {_toml(value)}" for key, value in known.items()]
    for name, own in files.items():
        lines += ["", f"[files.{_toml(name)}]", *(f"{key} = {_toml(value)}" for key, value in own.items())]
    write_page(place, "\n".join(lines) + "\n")
    return place


def _checked(place: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    unknown = sorted(set(data) - set(KEYS))
    if unknown:
        raise BadData(f'{place}: there is no setting `{unknown[0]}`; known are {", ".join(KEYS)} and [files."..."]')
    for key, value in data.items():
        if not SETTINGS[key].fits(value):
            raise BadData(
                f"{place}: {key} = {_toml(value)} does not fit; write it like {key} = {SETTINGS[key].example}"
            )
    return {KEYS[key]: tuple(value) if key in ("rows", "trim") else value for key, value in data.items()}


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case Mapping():
            return "{ " + ", ".join(f"{_key(str(key))} = {_toml(each)}" for key, each in value.items()) + " }"
        case str():
            escaped = value.replace("\\", "\\\\").replace('"', '\\"')
            return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04X}" for c in escaped) + '"'
        case list() | tuple():
            return "[" + ", ".join(map(_toml, value)) + "]"
    return str(value)
