"""Models of all steps, from the cache if nothing has changed, and their torque and errors on the logs."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import Model, Recording, Robot, SemiParametricModel, SgprError, load
from ..cli.errors import BadData
from .memory import give_back
from .steps import ROBOT_FILE, Known, Ladder, Step, compared, computed, errors_of, figures_of, key_of
from .tracks import Track, track_of
from .work import Progress

CACHE = ".sgpr-workbench"


@dataclass(frozen=True)
class Data:
    """What models follow from and are judged by.

    - `train`: stretches that models are fitted to; `reading`: how they were read
    - `judged`: stretches of every log in use, `roles` what each is for
    """

    robot: Robot
    train: Sequence[Recording]
    reading: dict[str, Any] | None
    judged: Mapping[str, list[Recording]]
    roles: Mapping[str, str]

    def of_role(self, role: str) -> list[Recording]:
        """Judged stretches of a role."""
        return [part for name, parts in self.judged.items() if self.roles[name] == role for part in parts]


class Models:
    """Models of a ladder, and what they predict.

    - `place`: where models are kept to open faster; it can be deleted at any time
    """

    def __init__(self, root: Path, ladder: Ladder) -> None:
        self.place = root / CACHE
        self.ladder = ladder
        self.tracks: dict[str, Track] = {}

    def reference(self) -> Model:
        """The model whose filters all are judged with: the first fit, so that errors can be compared."""
        fits = [s.model for s in self.ladder.steps.values() if s.after is None and s.id != ROBOT_FILE and s.model]
        if not fits or not isinstance(fits[0], Model):
            raise BadData("there is no fit yet")
        return fits[0]

    def file(self, data: Data, step: Step, suffix: str, more: Sequence[Recording] = ()) -> Path:
        """Where something that follows from a step and its logs is kept."""
        chain = self.ladder.chain(step.id)
        return self.place / f"{key_of(data.robot, [*data.train, *more], chain, data.reading)}{suffix}"

    def make(self, step: Step, data: Data, progress: Progress) -> None:
        """The model of a step, if it is missing; one that cannot be made has its reason in `problem`."""
        chain = self.ladder.chain(step.id)
        before = chain[-2].model if len(chain) > 1 else None
        place = self.file(data, step, ".sgpr")
        if place.is_file():
            with contextlib.suppress(SgprError, OSError):
                step.model = load(place)
                return
        model = computed(step, before, data.robot, data.train, progress)
        # A search leaves hundreds of columns behind, and errors on long logs follow.
        give_back()
        if isinstance(model, Model):
            model = model.with_reading(data.reading)
        # A cache that cannot be written costs time, nothing else.
        with contextlib.suppress(OSError, SgprError):
            place.parent.mkdir(exist_ok=True)
            model.save(place)
        step.model = model

    def judge(self, step: Step, model: Known, data: Data) -> None:
        """Errors of a model, and its torque, which is kept for the plots."""
        like = self.reference()
        each = {}
        for name, stretches in data.judged.items():
            # What a comparison holds is larger than the log: one at a time.
            each[name] = self._predicted(step, model, name, stretches, like)
        errors = errors_of(model, data.judged, data.roles, like, each)
        if isinstance(model, SemiParametricModel):
            unseen = data.of_role("test")
            errors["coverage"] = [
                {"joint": one["joint"], "percent_95": one["percent_95"]}
                for one in (model.coverage(unseen) if unseen else [])
            ]
        step.errors = errors

    def _predicted(
        self, step: Step, model: Known, name: str, stretches: list[Recording], like: Model
    ) -> dict[str, Any]:
        interval = None
        if isinstance(model, SemiParametricModel):
            found, spread = model.compare_with_spread(stretches)
            interval = [half for _, half, _ in spread]
        else:
            found = compared(model, stretches, like)
        if name not in self.tracks:
            self.tracks[name] = track_of(found, stretches, like.processing)
        self.tracks[name].add(step.id, found, interval)
        return figures_of(found)

    def forget(self) -> None:
        """Everything that follows from logs."""
        self.tracks.clear()
        for step in self.ladder.steps.values():
            step.model, step.errors, step.problem = None, {}, None

    def forget_removed(self) -> None:
        """The torque of steps that are gone."""
        for track in self.tracks.values():
            track.forget({name for name in track.predicted if name not in self.ladder.steps})
