"""How logs are read and repaired: the options that all commands with logs share."""

import glob
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import Recording, RecordingError, read
from ..loading import load as load_either
from ..reading import copies_of, options_of
from ..report.numbers import counted
from . import project
from .console import Output
from .errors import BadData, of_command_line, one_of, wrong_use

READING = "Reading logs"
NO_LOGS = (".urdf", ".xacro", ".sgpr")
REPAIR = "Repairing logs (nothing is changed unless asked for)"
REPAIRS = (
    "trim",
    "sort",
    "drop_duplicates",
    "drop_not_finite",
    "replace_strays",
    "drop_repeated",
    "unwrap",
    "split_gaps",
    "resample",
)
"""What `Recording.repair` takes."""


def reading(*names: str, **settings: Any) -> Any:
    """An option of the first group."""
    return typer.Option(*names, rich_help_panel=READING, **settings)


def repairing(*names: str, **settings: Any) -> Any:
    """An option of the second group."""
    return typer.Option(*names, rich_help_panel=REPAIR, **settings)


@dataclass(frozen=True)
class ReadingOptions:
    """Options for reading and repairing logs."""

    columns: Annotated[
        list[str] | None,
        reading(
            "--columns",
            metavar="KEY=COLUMN...",
            help="Columns of a table, for time, position, velocity, torque: a pattern, {} for the number of the joint "
            "and {name} for its name, or names with commas: position=q{} torque=i{}_A.",
        ),
    ] = None
    units: Annotated[
        list[str] | None,
        reading(
            "--units",
            metavar="KEY=UNIT...",
            help="Units of time, position, velocity, torque, if not SI and not in the column names: "
            "position=deg velocity=rpm torque=mNm time=ms.",
        ),
    ] = None
    torque_constants: Annotated[
        list[str] | None,
        reading(
            "--torque-constants",
            metavar="K...",
            help="N·m per A: torque = constant · current. One per joint in the order of the robot, or by the names of "
            "the joints, elbow=9.6 wrist=2.5.",
        ),
    ] = None
    accept: Annotated[
        list[str] | None,
        reading(
            "--accept",
            metavar="FINDING...",
            help="Findings that stop a command although they are right: joints_by_order (joints with names are columns "
            "with numbers, in the order of the robot), position_in_degrees, unlikely_rate, torque_scale, stray_sample.",
        ),
    ] = None
    like: Annotated[
        str | None,
        reading("--like", metavar="MODEL", help="Read the logs as those that this model was identified from."),
    ] = None
    remember: Annotated[
        bool,
        reading("--remember", help="Write these options to sgpr.toml beside the logs, where all commands find them."),
    ] = False
    rate: Annotated[
        float | None, reading("--rate", metavar="HZ", help="Sampling rate of tables without a time column.")
    ] = None
    rows: Annotated[
        tuple[int, int] | None, reading("--rows", metavar="FIRST LAST", help="Data rows of tables to read, from 1.")
    ] = None
    logged_joints: Annotated[
        list[str] | None,
        reading(
            "--logged-joints", metavar="JOINT...", help="What a bag or MCAP file calls the joints, in their order."
        ),
    ] = None
    topics: Annotated[
        list[str] | None, reading("--topics", metavar="TOPIC...", help="Topics of a bag or MCAP file to read.")
    ] = None
    clock: Annotated[str, reading("--clock", metavar="header|log", help="Which time of a bag or MCAP file counts.")] = (
        "header"
    )
    recover: Annotated[bool, reading("--recover", help="Read what is intact of a truncated or damaged MCAP file.")] = (
        False
    )
    trim: Annotated[
        tuple[float, float] | None,
        repairing("--trim", metavar="FROM TO", help="Keep this part of each log, s since its first sample."),
    ] = None
    sort: Annotated[bool, repairing("--sort", help="Bring samples into the order of their time.")] = False
    drop_duplicates: Annotated[
        bool, repairing("--drop-duplicates", help="Of samples with the same time, keep the first.")
    ] = False
    drop_not_finite: Annotated[
        bool, repairing("--drop-not-finite", help="Drop samples with NaN or infinite values.")
    ] = False
    replace_strays: Annotated[
        bool,
        repairing("--replace-strays", help="Replace samples that leave their neighbours by what lies between."),
    ] = False
    drop_repeated: Annotated[
        bool, repairing("--drop-repeated", help="Drop samples that repeat the one before while the arm moves.")
    ] = False
    unwrap: Annotated[
        bool, repairing("--unwrap", help="Take back jumps by a full turn, of joints whose position is wrapped to one.")
    ] = False
    split_gaps: Annotated[
        float | None, repairing("--split-gaps", metavar="S", help="Cut where time steps by more than this, s.")
    ] = None
    resample: Annotated[
        str | None,
        repairing("--resample", metavar="HZ|median", help="Bring samples to equal steps, of this rate."),
    ] = None

    def read(self, path: str, joints: Sequence[str] | None, like: Mapping[str, Any] | None = None) -> Recording:
        """The log as it is in the file."""
        settings = self.settings(path, like)
        of_project = settings.pop("joints", None)
        wanted = of_project if joints is None else joints
        arguments = {key: value for key, value in settings.items() if key not in REPAIRS}
        try:
            return read(path, wanted, **arguments)
        except RecordingError as error:
            if "there is no column" in str(error) and (whose := self._inherited("columns", path, like)):
                raise BadData(f"{error}; the name is one of {whose}: give those of this log, `--columns`") from error
            raise

    def _inherited(self, option: str, path: str, like: Mapping[str, Any] | None) -> str | None:
        """What says an option that the command does not."""
        of_project, _ = project.settings_of(path)
        if option in self.to_dict():
            return None
        of_model = (like or {}) if self.like is None else self._like()
        return "sgpr.toml" if option in of_project else "the logs of the model" if option in of_model else None

    def settings(self, path: str, like: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """All that is to be done with a log: as asked for, else as in sgpr.toml, else as with the logs of a model.

        - `like`: how the logs of the command's model were read
        """
        of_project, _ = project.settings_of(path)
        of_model = dict(like or {}) if self.like is None else self._like()
        inherited = {**of_model, **of_project}
        if any(key not in REPAIRS for key in inherited):
            known = options_of(path) | set(REPAIRS) | {"joints"}
            inherited = {key: value for key, value in inherited.items() if key in known}
        own = self.to_dict()
        if "accept" in own:
            own["accept"] = sorted({*own["accept"], *inherited.get("accept", ())})
        return {**inherited, **own}

    def _like(self) -> dict[str, Any]:
        assert self.like is not None, "asked before"
        model = load_either(self.like)
        physics: Any = getattr(model, "physics_", model)
        if physics.reading is None:
            raise BadData(f"{self.like}: this model does not say how its logs were read; identify it again")
        return dict(physics.reading)

    def lasting(self, paths: Sequence[str]) -> dict[str, Any] | None:
        """What to note in a model of logs like these, for others to come."""
        found = self.settings(paths[0]) if paths else {}
        return {key: value for key, value in found.items() if key not in (*project.OF_ONE_LOG, "joints")}

    def arguments(self) -> dict[str, Any]:
        """What `sgpr.read` takes, as far as it is not left to itself."""
        keys = ("time", "position", "velocity", "torque")
        columns = {key: _columns(value) for key, value in _pairs(self.columns, "--columns", keys).items()}
        wishes: dict[str, Any] = {
            "columns": columns or None,
            "units": _pairs(self.units, "--units", keys) or None,
            "torque_constants": _constants(self.torque_constants),
            "accept": self.accept,
            "sample_rate_hz": self.rate,
            "rows": self.rows,
            "logged_names": self.logged_joints,
            "topics": self.topics,
            "clock": one_of(self.clock, ("header", "log"), "--clock", "clock"),
            "recover": self.recover,
        }
        defaults = {"clock": "header", "recover": False}
        return {key: value for key, value in wishes.items() if value != defaults.get(key)}

    def repairs(self) -> dict[str, Any]:
        """What `Recording.repair` takes, as far as it is asked for."""
        wishes = {
            "trim": self.trim,
            "sort": self.sort,
            "drop_duplicates": self.drop_duplicates,
            "drop_not_finite": self.drop_not_finite,
            "replace_strays": self.replace_strays,
            "drop_repeated": self.drop_repeated,
            "unwrap": self.unwrap,
            "split_gaps": self.split_gaps,
            "resample": self._rate(),
        }
        return {key: value for key, value in wishes.items() if value is not None and value is not False}

    def to_dict(self) -> dict[str, Any]:
        """All that was asked for, for the record."""
        return {**self.arguments(), **self.repairs()}

    def words(self) -> list[str]:
        """The same options for the next command, unless they are remembered in a file."""
        words: list[str] = []
        for field in () if self.remember else fields(self):
            value, option = getattr(self, field.name), f"--{field.name.replace('_', '-')}"
            match value:
                case None | False:
                    continue
                case True:
                    words.append(option)
                case list() | tuple():
                    words += [option, *map(str, value)]
                case _ if value != field.default:
                    words += [option, str(value)]
        return words

    def _rate(self) -> float | str | None:
        if self.resample is None or self.resample == "median":
            return self.resample
        try:
            rate = float(self.resample)
        except ValueError:
            rate = 0.0
        if not rate > 0.0:
            raise wrong_use(f"`{self.resample}` is neither a rate in Hz nor `median`", "--resample")
        return rate


@dataclass(frozen=True)
class Log:
    """A log as read, and the stretches that remain after what the user asked to repair.

    - `actions`: what was done, in sentences
    - `is_resampled`: whether the samples of the stretches are others than those of the log
    """

    path: str
    raw: Recording
    stretches: list[Recording]
    actions: list[str]
    is_resampled: bool = False

    def tell(self, output: Output) -> None:
        """Says what was assumed of the log, and what was done to it."""
        for said in [*self.raw.notes, *self.actions]:
            output.note(f"{self.path}: {of_command_line(said)}")


def read_log(
    path: str, options: ReadingOptions, joints: Sequence[str] | None, like: Mapping[str, Any] | None = None
) -> Log:
    """Reads and repairs one log.

    - `like`: how the logs of the command's model were read
    """
    if Path(path).is_file() and path.lower().endswith(NO_LOGS):
        raise BadData(f"{path}: this is a robot or a model, not a log")
    raw = options.read(path, joints, like)
    repairs = {key: value for key, value in options.settings(path, like).items() if key in REPAIRS}
    if not repairs:
        return Log(path, raw, [raw], [])
    repaired = raw.repair(**repairs)
    actions = [action.removeprefix(f"{raw.source}: ") for action in repaired.actions]
    return Log(path, raw, repaired.recordings, actions, "resample" in repairs)


def read_logs(
    paths: Sequence[str],
    options: ReadingOptions,
    joints: Sequence[str] | None,
    output: Output,
    like: Mapping[str, Any] | None = None,
) -> list[Log]:
    """Reads and repairs logs, telling what was changed; copies are left out.

    - `like`: how the logs of the command's model were read
    """
    paths = expand_patterns(paths)
    logs: list[Log] = []
    with output.progress() as progress:
        for index, path in enumerate(paths):
            if progress:
                progress("read", index, len(paths))
            logs.append(read_log(path, options, joints, like))
    if options.remember:
        for path in paths:
            place = project.remember(path, options.to_dict())
            output.note(f"{place}: written; commands on logs in this folder read them the same way")
    logs = _without_copies(logs, output)
    for log in logs:
        log.tell(output)
    return logs


def _without_copies(logs: Sequence[Log], output: Output) -> list[Log]:
    """Of logs with the same content the first."""
    copies = copies_of((log.path, log.raw.content_hash) for log in logs)
    for copy, first in copies.items():
        output.warning(f"{copy} is a copy of {first} and is left out: the same samples would count twice")
    return [log for log in logs if log.path not in copies]


def tell_layouts(logs: Sequence[Log], output: Output, *, of_all: bool = False) -> None:
    """Says in one line which column became which joint in which unit; logs of one layout share it.

    - `of_all`: whether the joints are all that the robot has, so that a log of more joints may be one of another robot
    """
    groups: dict[str, list[Log]] = {}
    for log in logs:
        if log.raw.layout is not None:
            groups.setdefault(log.raw.layout["text"], []).append(log)
    for text, alike in groups.items():
        more = f" and {len(alike) - 1} more" if len(alike) > 1 else ""
        output.line(f"columns of {alike[0].path}{more}: {text}")
        if of_all and (others := other_joints(alike[0].raw)):
            output.warning(
                f"{alike[0].path}{more}: position and torque of {counted(len(others), 'more joint')} "
                f"({', '.join(others)}) are not used, as the robot has only {', '.join(alike[0].raw.joint_names)}: "
                "if this is not a log of this robot, the result means nothing"
            )


def other_joints(log: Recording) -> list[str]:
    """Columns of position, numbered as those of the joints are, that a column of torque belongs to, and no joint."""
    layout = log.layout
    if layout is None:
        return []
    numbers: dict[str, dict[str, str]] = {}
    for what in ("position", "torque"):
        used = [joint[what]["column"] for joint in layout["joints"] if joint.get(what)]
        parts = [re.fullmatch(r"(.*?)(\d+)(\D*)", column) for column in used]
        forms = {(part[1], part[3]) for part in parts if part}
        found = numbers.setdefault(what, {})
        for channel in log.channels:
            part = re.fullmatch(r"(.*?)(\d+)(\D*)", channel)
            if part and (part[1], part[3]) in forms:
                found[part[2]] = channel
    return [column for number, column in numbers["position"].items() if number in numbers["torque"]]


def stretches(logs: Sequence[Log]) -> list[Recording]:
    """The recordings of all logs."""
    return [stretch for log in logs for stretch in log.stretches]


def expand_patterns(paths: Sequence[str]) -> list[str]:
    """File names, those with * in the place of files that were not expanded by a shell; each file once."""
    found: list[str] = []
    for path in paths:
        matches = sorted(glob.glob(path)) if "*" in path and not Path(path).exists() else [path]
        if not matches:
            raise BadData(f"{path}: no file fits this pattern")
        found += [match for match in matches if match not in found]
    return found


def _pairs(values: Sequence[str] | None, option: str, keys: Sequence[str]) -> dict[str, str]:
    pairs = {}
    for value in values or ():
        key, equals, text = value.partition("=")
        if not (equals and text):
            raise wrong_use(f"`{value}` is not of the form KEY=VALUE, with a KEY of {', '.join(keys)}", option)
        pairs[one_of(key, keys, option, "quantity")] = text
    return pairs


def _constants(values: Sequence[str] | None) -> list[float] | dict[str, float] | None:
    """Torque constants in the order of the joints, or by their names."""
    if values is None:
        return None
    named: dict[str, float] = {}
    listed: list[float] = []
    for value in values:
        name, _, text = value.rpartition("=")
        try:
            number = float(text)
        except ValueError:
            raise wrong_use(f"`{value}` is neither a number nor JOINT=NUMBER", "--torque-constants") from None
        if name:
            named[name] = number
        else:
            listed.append(number)
    if named and listed:
        raise wrong_use("give all constants in the order of the joints, or all by name", "--torque-constants")
    return named or listed


def _columns(text: str) -> str | list[str]:
    return text.split(",") if "," in text else text
