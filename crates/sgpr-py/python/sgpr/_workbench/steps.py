"""Models as steps: a fit, and effects added one after the other; several steps may start from the same one."""

import hashlib
import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .. import Comparison, Model, Recording, Robot, SemiParametricModel, __version__, compare, diagnose, identify
from ..cli.errors import BadData
from .work import Progress

ROBOT_FILE = "robot"
"""The step that every project has: what the robot file says, without any fit."""

LONGEST_NAME = 80

Known = Model | SemiParametricModel


@dataclass
class Step:
    """A model, and how it came about.

    - `after`: the step that it starts from, None for a fit
    - `effects`: of a fit; `add`: `effect@joint`, of a step that adds; `rest`: whether it learns the rest
    - `model`: None while it is to be computed; `errors` are those of `errors_of`
    """

    id: str
    name: str
    after: str | None = None
    effects: list[str] = field(default_factory=list)
    add: list[str] = field(default_factory=list)
    rest: bool = False
    shown: bool = True
    model: Known | None = None
    problem: str | None = None
    errors: dict[str, Any] = field(default_factory=dict)

    def to_toml(self) -> dict[str, Any]:
        """For the project file."""
        data: dict[str, Any] = {"id": self.id, "name": self.name}
        if self.after is None:
            data["effects"] = self.effects
        else:
            data |= {"after": self.after} | ({"rest": True} if self.rest else {"add": self.add})
        if not self.shown:
            data["shown"] = False
        return data

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        return {
            "id": self.id,
            "name": self.name,
            "after": self.after,
            "effects": self.effects,
            "add": self.add,
            "rest": self.rest,
            "shown": self.shown,
            "ready": self.model is not None,
            "problem": self.problem,
            "errors": self.errors,
            "history": [] if self.model is None else physics_of(self.model).history,
        }


class Ladder:
    """All steps by their names, in the order in which they were made; `current` is the one that is worked on."""

    def __init__(self) -> None:
        self.steps: dict[str, Step] = {ROBOT_FILE: Step(ROBOT_FILE, "robot file", shown=False)}
        self.current = ROBOT_FILE
        self.pinned: str | None = None

    def __getitem__(self, name: object) -> Step:
        step = self.steps.get(str(name))
        if step is None:
            raise BadData(f"there is no step {name}; it was removed, perhaps in another tab")
        return step

    def new(self, name: str, **how: Any) -> Step:
        """Another step, which becomes the current one."""
        number = 1 + max([int(one[1:]) for one in self.steps if one[1:].isdigit()], default=0)
        step = Step(f"m{number}", name[:LONGEST_NAME], **how)
        self.steps[step.id] = step
        self.current = step.id
        return step

    def chain(self, name: str) -> list[Step]:
        """The steps that lead to one, the fit first."""
        found = [self[name]]
        while found[0].after is not None:
            found.insert(0, self[found[0].after])
        return found

    def remove(self, name: str) -> None:
        """Takes a step away, with those that start from it."""
        if name == ROBOT_FILE:
            raise BadData("the robot file stays")
        parent = self[name].after
        gone = {one for one in self.steps if any(step.id == name for step in self.chain(one))}
        self.steps = {key: step for key, step in self.steps.items() if key not in gone}
        if self.current in gone:
            self.current = parent or next((key for key in reversed(self.steps) if key != ROBOT_FILE), ROBOT_FILE)
        if self.pinned in gone:
            self.pinned = None

    def load(self, data: Mapping[str, Any]) -> None:
        """The steps of a project file; those that make no sense are an error that names them."""
        for number, row in enumerate(data.get("steps", []), start=1):
            if not isinstance(row, Mapping) or not isinstance(row.get("id"), str):
                raise BadData(f"steps: entry {number} has no `id`")
            after = row.get("after")
            if after is not None and after not in self.steps:
                raise BadData(f"steps: `{row['id']}` starts from `{after}`, which is not among those before it")
            effects, add = ([str(each) for each in row.get(key, [])] for key in ("effects", "add"))
            name = str(row.get("name", row["id"]))[:LONGEST_NAME]
            shown, rest = bool(row.get("shown", True)), bool(row.get("rest", False))
            self.steps[row["id"]] = Step(row["id"], name, after, shown=shown, rest=rest, effects=effects, add=add)
        self.current = str(data["current"]) if data.get("current") in self.steps else next(reversed(self.steps))
        self.pinned = data.get("pinned") if data.get("pinned") in self.steps else None

    def to_toml(self) -> dict[str, Any]:
        """The entries of the project file."""
        kept = [step.to_toml() for step in self.steps.values() if step.id != ROBOT_FILE]
        return {"current": self.current, "pinned": self.pinned, "steps": kept or None}


def physics_of(model: Known) -> Model:
    """A model without what was learned of the rest."""
    found: Model = model.physics_ if isinstance(model, SemiParametricModel) else model
    return found


def computed(step: Step, before: Known | None, robot: Robot, train: Sequence[Recording], progress: Progress) -> Known:
    """The model of a step."""
    if step.id == ROBOT_FILE:
        return Model.nominal(robot)
    if step.after is None:
        with warnings.catch_warnings():
            # The page shows findings with their ranks.
            warnings.simplefilter("ignore", UserWarning)
            return identify(robot, train, effects=step.effects, progress=progress)
    if not isinstance(before, Model):
        raise BadData(f"{step.name}: the step before it has no model of physics alone")
    if step.rest:
        return SemiParametricModel(before.robot, physics=before, progress=progress).fit(train)
    return diagnose(before, train, add=step.add, progress=progress).model


def compared(model: Known, recordings: Sequence[Recording], like: Model) -> Comparison:
    """The model against logs, through the filters of another one as far as it is physics."""
    if isinstance(model, SemiParametricModel):
        return model.compare(recordings)
    return compare(model, recordings, processing=like)


def key_of(robot: Robot, train: Iterable[Recording], chain: Sequence[Step], reading: object) -> str:
    """What a model follows from, as a name of a file: another robot, log or step gives another one."""
    about = [
        __version__,
        robot.joint_names,
        robot.standard_parameters.tolist(),
        robot.gravity.tolist(),
        [(log.source, log.content_hash) for log in train],
        [(step.effects, step.add, step.rest) for step in chain],
        repr(reading),
    ]
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()[:24]


def errors_of(
    model: Known,
    logs: Mapping[str, Sequence[Recording]],
    roles: Mapping[str, str],
    like: Model,
    each: Mapping[str, dict[str, Any]],
) -> dict[str, Any]:
    """Errors per joint over all training logs and all test logs, and per log.

    - `each`: those of each log alone
    """
    result: dict[str, Any] = {"logs": dict(each)}
    for role in ("train", "test"):
        names = [name for name in logs if roles[name] == role]
        if len(names) == 1:
            result[role] = each[names[0]]
        elif names:
            result[role] = figures_of(compared(model, [part for name in names for part in logs[name]], like))
    return result


def figures_of(found: Comparison) -> dict[str, Any]:
    """Figures of a comparison, those that a table shows."""
    rows = [
        {
            "joint": one.joint,
            "unit": one.unit,
            "rmse": _number(one.rmse),
            "fit": _number(one.fit_percent),
            "relative": _number(one.relative_error_percent),
            "zero": _number(one.rmse_zero),
            "gravity": _number(one.rmse_gravity),
        }
        for one in found.joints
    ]
    return {"relative": _number(found.relative_error_percent), "joints": rows}


def _number(value: float) -> float | None:
    return float(value) if value == value and abs(value) != float("inf") else None
