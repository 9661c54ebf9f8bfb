"""What the models lack: diagnoses by step, kept beside the models."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import Model, compare, diagnose, residual_structure
from .._pages import write_page
from .models import Data, Models
from .motions import next_motion
from .steps import ROBOT_FILE, Step
from .work import Progress


class Missing:
    """Diagnoses of steps.

    - `found`: as in diagnosis.json, with the plot of the next experiment; `motions`: that motion as a table
    - `tell`: called when something is known before the end
    - `hints`: sentences on what the error depends on, known before the search ends, and after one that was cancelled
    - `ranked`: candidates as in diagnosis.json, known before the search ends as well, without their probabilities
    """

    def __init__(self, models: Models, tell: Callable[[], None]) -> None:
        self.models, self.tell = models, tell
        self.found: dict[str, dict[str, Any]] = {}
        self.motions: dict[str, str] = {}
        self.hints: dict[str, list[str]] = {}
        self.ranked: dict[str, list[dict[str, Any]]] = {}

    def forget(self) -> None:
        """Everything: the logs are others."""
        self.found.clear()
        self.motions.clear()
        self.hints.clear()
        self.ranked.clear()

    def look(self, step: Step, model: Model, data: Data, progress: Progress) -> None:
        """Looks for what a model lacks; what the error depends on is there before the search begins."""
        progress("what the error depends on", 0, 0)
        structure = residual_structure(model, compare(model, data.of_role("train")))
        self.hints[step.id] = [joint["summary"] for joint in structure]
        self.tell()

        def heard(candidates: list[dict[str, Any]]) -> None:
            self.ranked[step.id] = candidates
            self.tell()

        found = diagnose(model, data.train, data.of_role("test"), progress=progress, ranked=heard)
        result = found.to_dict()
        motion = next_motion(found, model.robot)
        if motion is not None:
            result["next_figure"] = motion.figure
            self.motions[step.id] = motion.table
        self.found[step.id] = result
        place = self._file(step, data)
        with contextlib.suppress(OSError):
            place.parent.mkdir(exist_ok=True)
            write_page(place, json.dumps(result))
            if motion is not None:
                write_page(place.with_suffix(".csv"), motion.table)

    def restore(self, step: Step, data: Data) -> None:
        """What was found before, if nothing has changed since."""
        if step.id == ROBOT_FILE or step.id in self.found:
            return
        with contextlib.suppress(OSError, ValueError):
            place = self._file(step, data)
            self.found[step.id] = json.loads(place.read_text(encoding="utf-8"))
            self.motions[step.id] = place.with_suffix(".csv").read_text(encoding="utf-8")

    def _file(self, step: Step, data: Data) -> Path:
        return self.models.file(data, step, ".json", data.of_role("test"))
