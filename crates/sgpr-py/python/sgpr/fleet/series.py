"""From the records of an arm to its parameters over sessions."""

import json
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._sgpr import Model, Record, Robot, SgprError, compare_records, deviations, identify_records
from .screening import LogFinding

if TYPE_CHECKING:
    from .alarms import Alarm

Array = NDArray[np.float64]

BASELINE_SHARE, FEWEST_OF_BASELINE, MOST_OF_BASELINE = 0.2, 5, 20
RIGID = ("Ia",)
"""Parameters of effects that do not change while an arm works."""
NAMES = {"Fv": "viscous friction", "Fc": "Coulomb friction", "tau0": "torque offset", "gain": "torque gain"}
TOOL = "tool"
"""The parameter that is the mass at the last link."""
NOTHING, SUSPICIOUS = 1.0, 0.5
"""Error as a share of the torque, of the median joint, at which a model explains nothing of a session, and from which
on those that a reference is fitted to are looked at one by one."""
LARGEST_DEVIATION = 0.25
"""Sessions that know a parameter less well than to this share of its scale say nothing of it."""


@dataclass
class Series:
    """A parameter of an arm over its sessions, as a share of `scale` off the reference.

    - `std`: of single sessions, from the residual and its memory
    - `gain`: squares of the residual that a change of the parameter alone explains, (N·m)² ((N)²)
    - `unsure`: standard deviation of the value that the reference of each session has, from the fit of all of it
    - `scatter`: of one session beyond `std`, from what neighbouring sessions differ by
    - `factor`: on both, from all sessions
    - `slope`: per °C, from all arms of the type; 0 where temperature is not logged or explains nothing
    - `jumps`: sessions at which it changed, and `told`: after which of them each was sure
    - `shows`: smallest change that two more sessions would be sure of; infinite if it is not watched, because sessions
      know it too roughly or are too few
    """

    joint: str
    parameter: str
    unit: str
    reference: float
    scale: float
    change: Array
    std: Array
    gain: Array
    unsure: Array
    scatter: float = 0.0
    factor: float = 1.0
    slope: float = 0.0
    jumps: list[int] = field(default_factory=list)
    told: list[int] = field(default_factory=list)
    shows: float = math.inf

    @property
    def watched(self) -> bool:
        """Whether a change could be seen."""
        return math.isfinite(self.shows)

    @property
    def name(self) -> str:
        """What the parameter is called."""
        return NAMES.get(self.parameter, self.parameter)

    @property
    def deviation(self) -> Array:
        """Standard deviation of each session."""
        return np.asarray(self.factor * np.sqrt(self.scatter**2 + self.std**2))


@dataclass
class ArmHistory:
    """An arm over time.

    - `time`: start of each session, ns; `error`: residual of the reference as a share of the torque, `residual` itself,
      and `tool_gain`, the squares of it that a tool at the last link explains, (N·m)² ((N)²), `(sessions, joints)`
    - `tools`: declared tool of each session
    - `baseline`: sessions that the first reference is made of; `borrowed`: whether those of its sisters
    - `referred`: whether a session is one of those that its reference is made of
    - `findings`: what a look at its logs found
    - `left_out`: sessions that do not count, with the reasons; `mixed`: sentences on two tools under one name
    - `foreign`: sessions of whose torque the reference explains nothing: of another robot, or with other columns or
      units; they are left out of everything else
    """

    robot: str
    type: str
    joints: list[str]
    units: list[str]
    sessions: list[str]
    time: list[int]
    tools: list[str]
    hours: float
    baseline: int
    borrowed: bool
    referred: NDArray[np.bool_]
    temperature: Array
    error: Array
    residual: Array
    tool_gain: Array
    series: list[Series]
    alarms: list["Alarm"] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    outliers: list[dict[str, Any]] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    findings: list[LogFinding] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    mixed: list[str] = field(default_factory=list)

    @property
    def recorded(self) -> int:
        """Sessions with a record, foreign ones included."""
        return len(self.sessions) + len(self.foreign) + len(self.left_out)

    def find(self, joint: str, parameter: str) -> Series | None:
        """A parameter over the sessions."""
        return next((one for one in self.series if (one.joint, one.parameter) == (joint, parameter)), None)

    def without_temperature(self, one: Series) -> Array:
        """A parameter over the sessions, less what temperature explains."""
        if one.slope == 0.0:
            return one.change
        mean = np.nanmean(self.temperature)
        shift = np.where(np.isfinite(self.temperature), self.temperature - mean, 0.0)
        return np.asarray(one.change - one.slope * shift)


def by_arm(records: Iterable[Record]) -> dict[tuple[str, str], list[Record]]:
    """Records by type and arm in the order of time, copies once."""
    arms: dict[tuple[str, str], list[Record]] = {}
    for one in records:
        arms.setdefault((one.labels.get("type", ""), one.labels.get("robot", "")), []).append(one)
    for key, own in arms.items():
        own.sort(key=lambda one: (start_of(one), one.source))
        first: dict[Any, Record] = {}
        for one in own:
            first.setdefault((one.content_hash, one.counted), one)
        arms[key] = list(first.values())
    return arms


def history_of(
    kind: str,
    name: str,
    arms: Mapping[tuple[str, str], Sequence[Record]],
    robot: Robot | Model,
    temperature: str,
) -> ArmHistory:
    """An arm over its sessions, against its reference: the model that is given, or its own first sessions.

    Sessions with another declared tool are measured by a reference of their own, of the first ones with that tool.
    """
    own = list(arms[kind, name])
    references, borrowed = _references(robot, own, [theirs for (other, _), theirs in arms.items() if other == kind])
    first = references[tool_of(own[0])]
    assert first is not None
    joints = first.robot.joint_names
    foreign = [one for one in own if _is_foreign(references[tool_of(one)], one)]
    own = [one for one in own if one not in foreign]
    if not own:
        raise SgprError(f"{foreign[0].source}: the model explains nothing of the torque of any log of {name}")
    found = [_deviation(references[tool_of(one)], one) for one in own]
    unsure = {tool: _standard_deviations(reference) for tool, reference in references.items()}
    columns: dict[tuple[str, str], dict[str, Any]] = {}
    error, residual, tool_gain = np.full((3, len(own), len(joints)), np.nan)
    mass = np.full((4, len(own)), np.nan)
    for k, deviation in enumerate(found):
        if deviation is None:
            continue
        mass[:, k] = deviation["tool_mass"], deviation["tool_mass_standard_deviation"], deviation["tool_share"], 0.0
        for joint in deviation["joints"]:
            place = k, joints.index(joint["joint"])
            error[place], residual[place] = joint["error"] / max(joint["torque"], 1e-300), joint["error"]
            tool_gain[place] = joint["error"] ** 2 - joint["error_with_tool"] ** 2
            for parameter in joint["parameters"]:
                _enter(columns, joint, parameter, unsure[tool_of(own[k])].get(parameter["name"], 0.0), k, len(own))
    series = [
        Series(joint, symbol, column["unit"], column["reference"], _scale(joint, symbol, columns), *column["values"])
        for (joint, symbol), column in columns.items()
    ]
    series.append(Series("", TOOL, "kg", 0.0, 1.0, *mass))
    for one in series:
        # Sessions that do not determine a parameter say nothing of it.
        one.change, one.std, one.unsure = one.change / one.scale, one.std / one.scale, one.unsure / one.scale
        one.change = np.where(one.std < LARGEST_DEVIATION, one.change, np.nan)
    return ArmHistory(
        robot=name,
        type=kind,
        joints=joints,
        units=first.robot.torque_units,
        sessions=[session_of(one) for one in own],
        time=[start_of(one) for one in own],
        tools=[tool_of(one) for one in own],
        hours=sum((one.end_time - one.start_time) / 3600e9 for one in own),
        baseline=_baseline(own),
        borrowed=borrowed,
        referred=_referred(own),
        temperature=np.array([_temperature(one, temperature) for one in own]),
        error=error,
        residual=residual,
        tool_gain=tool_gain,
        series=series,
        foreign=[session_of(one) for one in foreign],
    )


def _enter(
    columns: dict[tuple[str, str], dict[str, Any]], joint: Any, parameter: Any, unsure: float, k: int, sessions: int
) -> None:
    symbol = parameter["name"].rpartition(".")[2]
    if symbol in RIGID:
        return
    start = {
        "unit": parameter["unit"],
        "reference": parameter["reference"],
        "values": np.full((4, sessions), np.nan),
    }
    column = columns.setdefault((joint["joint"], symbol), start)
    # Counted from one reference, whatever the tool.
    change = parameter["change"] + parameter["reference"] - column["reference"]
    explained = joint["error"] ** 2 - parameter["error_alone"] ** 2
    column["values"][:, k] = change, parameter["standard_deviation"], explained, unsure


def _standard_deviations(reference: Model | None) -> dict[str, float]:
    """Of the parameters of a reference, those that its sessions determine."""
    if reference is None:
        return {}
    names, values = reference.parameters.names, reference.parameters.standard_deviations
    return {name: float(value) for name, value in zip(names, values, strict=True) if math.isfinite(value)}


def _deviation(reference: Model | None, one: Record) -> dict[str, Any] | None:
    return None if reference is None else deviations(reference, one)[0]


def _unexplained(model: Model, one: Record) -> float:
    """Error of a model on a session as a share of the torque, of the median joint that moves."""
    moved = [joint for joint in compare_records(model, [one]) if joint["torque"] > 0.0]
    return float(np.median([joint["rmse"] / joint["torque"] for joint in moved])) if moved else 0.0


def _is_foreign(reference: Model | None, one: Record) -> bool:
    return reference is not None and _unexplained(reference, one) >= NOTHING


def session_of(one: Record) -> str:
    """Name of a session."""
    return one.labels.get("session", one.source)


def tool_of(one: Record) -> str:
    """The declared tool of a session."""
    return one.labels.get("tool", "")


def with_tool(one: Record, tool: str) -> Record:
    """The same with another declared tool."""
    if tool == tool_of(one):
        return one
    head, numbers = one.to_parts()
    data = json.loads(head)
    data["labels"]["tool"] = tool
    return Record.from_parts(json.dumps(data), numbers)


def start_of(one: Record) -> int:
    """Start of the log, ns: that of the table if it says so, as stamps may count from the start of the log."""
    start = one.labels.get("start")
    if start:
        try:
            return int(np.datetime64(start.removesuffix("Z"), "ns").astype(np.int64))
        except ValueError:
            raise SgprError(f"{one.source}: `start` is {start}, expected a date such as 2026-03-04T08:00:00") from None
    return one.start_time


def _baseline(own: Sequence[Record]) -> int:
    wanted = min(max(math.ceil(BASELINE_SHARE * len(own)), FEWEST_OF_BASELINE), MOST_OF_BASELINE)
    return min(wanted, len(own))


def _referred(own: Sequence[Record]) -> NDArray[np.bool_]:
    found = np.zeros(len(own), dtype=bool)
    for tool in {tool_of(one) for one in own}:
        theirs = [k for k, one in enumerate(own) if tool_of(one) == tool]
        found[theirs[: _baseline([own[k] for k in theirs])]] = True
    return found


def _references(
    robot: Robot | Model, own: Sequence[Record], sisters: Sequence[Sequence[Record]]
) -> tuple[dict[str, Model | None], bool]:
    """The model of each tool that sessions are measured by, none where too few have it, and whether the first is that
    of the sisters. A model that is given is that of the tool that the arm has first.

    Only the first can be that of the sisters: between one of the arm and one of them friction and offsets would step by
    as much as the arms differ, in the session in which the tool changes.
    """
    found: dict[str, Model | None] = {}
    borrowed = False
    for one in own:
        tool = tool_of(one)
        if tool in found:
            continue
        if not found and isinstance(robot, Model):
            found[tool] = robot
            continue
        body = robot.robot if isinstance(robot, Model) else robot
        model, of_sisters = _identified(body, tool, own, [] if found else sisters)
        borrowed |= of_sisters
        if model is None and not found:
            raise SgprError(f"{one.source}: this arm and its sisters have too few sessions for a reference model")
        found[tool] = model
    return found, borrowed


def _identified(
    robot: Robot, tool: str, own: Sequence[Record], sisters: Sequence[Sequence[Record]]
) -> tuple[Model | None, bool]:
    """The model of a tool from the first sessions with it, of the arm or of its sisters, and whether it is theirs.

    - `sisters`: none for a tool after the first
    """

    def first(records: Sequence[Record]) -> list[Record]:
        theirs = [one for one in records if tool_of(one) == tool]
        return theirs[: _baseline(theirs)]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if len(first(own)) >= FEWEST_OF_BASELINE or len(sisters) == 1:
            try:
                return _fitted(robot, first(own)), False
            except SgprError:
                pass
        if not sisters:
            return None, False
        try:
            return _fitted(robot, [one for theirs in sisters for one in first(theirs)]), True
        except SgprError:
            return None, True


def _fitted(robot: Robot, records: Sequence[Record]) -> Model:
    """The model of records, without those of whose torque the model of the others explains nothing."""
    left = list(records)
    model = identify_records(robot, left, prior=None)
    while 2 < len(left) <= MOST_OF_BASELINE and max(_unexplained(model, one) for one in left) >= SUSPICIOUS:
        without = [identify_records(robot, left[:k] + left[k + 1 :], prior=None) for k in range(len(left))]
        shares = [_unexplained(other, one) for other, one in zip(without, left, strict=True)]
        worst = int(np.argmax(shares))
        if shares[worst] < NOTHING:
            break
        del left[worst]
        model = without[worst]
    return model


def _scale(joint: str, symbol: str, columns: Mapping[tuple[str, str], Mapping[str, Any]]) -> float:
    """What a change is a share of: the parameter, of a torque offset the Coulomb friction."""
    own = "Fc" if symbol == "tau0" else symbol
    column = columns.get((joint, own))
    value = abs(column["reference"]) if column is not None else 1.0
    return value if value > 0.0 else 1.0


def _temperature(one: Record, name: str) -> float:
    values = [
        mean
        for block in one.blocks
        for channel, mean in block["channels"].items()
        if name.lower() in channel.lower() and math.isfinite(mean)
    ]
    return float(np.mean(values)) if values else math.nan
