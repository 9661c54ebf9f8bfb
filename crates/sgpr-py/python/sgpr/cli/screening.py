"""Logs against the physics of their robot, before anyone believes an estimate from them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import Robot, SgprError, repeated_share, shared_samples
from .. import identify as identify_from
from .. import screen as screen_with
from ..report.numbers import counted, percent, significant
from .console import ProgressCallback
from .effects import fitted_effects
from .reading import Log, stretches

GOOD, POOR = 100.0, 500.0
"""Condition numbers, columns scaled: optimised excitations reach 50 to 100."""

REPEATED = 0.5
"""Share of a test log: motions of their own reach a third, as arms start at the same pose."""


def screened(
    robot: Robot, log: Log, effects: list[str] | None, progress: ProgressCallback | None = None
) -> dict[str, Any]:
    """What the physics of a robot says of a log: how well it excites the parameters, and what is suspicious."""
    wanted = fitted_effects(effects)
    found: dict[str, Any] = {"refused": None, "excitation": None, "condition": None, "findings": []}
    try:
        model = identify_from(robot, log.stretches, effects=wanted, progress=progress)
    except SgprError as error:
        return {**found, "refused": str(error)}
    assert model.fit is not None and model.report is not None, "just identified"
    said = model.report.warnings
    more = [text for text in screen_with(model, log.stretches) if text not in said]
    condition = model.fit["scaled_condition"]
    return {
        **found,
        "condition": condition if np.isfinite(condition) else None,
        "excitation": excitation(condition, len(model.parameters), model.fit["undetermined"]),
        "findings": [*said, *more],
    }


def excitation(condition: float, count: int, undetermined: Sequence[str]) -> str:
    """How well a motion excites the base parameters, in words."""
    if undetermined:
        return f"the motion excites {count - len(undetermined)} of {counted(count, 'base parameter')}"
    word = "well" if condition <= GOOD else "fairly" if condition <= POOR else "badly"
    return (
        f"the motion excites all {counted(count, 'base parameter')}, {word}: the condition number is "
        f"{significant(condition, 3)} (columns scaled; optimised motions reach 50 to 100)"
    )


def repeated(train: Sequence[Log], test: Sequence[Log]) -> list[str]:
    """Test logs with samples or motions of training logs."""
    training = stretches(train)
    paths = [log.path for log in train for _ in log.stretches]
    texts = []
    for log in test:
        shared: dict[str, int] = {}
        for part in log.stretches:
            for known, first, end in shared_samples(training, part):
                shared[str(paths[known])] = shared.get(str(paths[known]), 0) + end - first
        if shared:
            texts += [_shares(log, path, count) for path, count in shared.items()]
            continue
        found = [share for part in log.stretches if (share := repeated_share(training, part)) is not None]
        if found and max(found) > REPEATED:
            texts.append(
                f"{log.path} repeats motions of the training logs for {percent(100.0 * max(found))} % of the time it "
                "moves: its error says how well the model repeats what it was fitted to, not how it predicts a new "
                "motion. Test with another motion"
            )
    return texts


def _shares(log: Log, path: str, count: int) -> str:
    whole = sum(len(part) for part in log.stretches)
    return (
        f"{count} of {whole} samples of the test log {log.path} are in the training log {path}: its error there is "
        "that of the fit, not one on unseen data. Test with another log"
    )
