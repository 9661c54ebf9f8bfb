"""Logs against the physics of their robot, before anyone believes an estimate from them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import LogSet, Model, Robot, SgprError, repeated_share, shared_samples
from .. import identify as identify_from
from .. import screen as screen_with
from ..report.numbers import counted, percent, significant
from .console import ProgressCallback
from .effects import fitted_effects
from .findings import Found, of_result
from .reading import Log, stretches

GOOD, POOR = 100.0, 500.0
"""Condition numbers, columns scaled, up to which a motion excites the parameters well, and above which badly."""

REPEATED = 0.5
"""Share of a test log: motions of their own reach a third, as arms start at the same pose."""


def screened(
    robot: Robot, log: Log, effects: list[str] | None, progress: ProgressCallback | None = None
) -> dict[str, Any]:
    """What the physics of a robot says of a log: how well it excites the parameters, and what is suspicious."""
    wanted = fitted_effects(effects)
    found: dict[str, Any] = {"refused": None, "excitation": None, "condition": None, "findings": []}
    found["how_much_data"] = None
    try:
        own = LogSet(log.stretches, whole=True)
        model = identify_from(robot, own, effects=wanted, forecast=True, progress=progress)
    except SgprError as error:
        return {**found, "refused": str(error)}
    assert model.fit is not None and model.report is not None, "just identified"
    condition = model.fit["scaled_condition"]
    return {
        **found,
        "condition": condition if np.isfinite(condition) else None,
        "excitation": excitation(condition, len(model.parameters), model.fit["undetermined"]),
        "findings": [*model.report.warnings, *unsaid(model, own)],
        "how_much_data": how_much_data(robot, model.report.forecast or {}),
    }


def unsaid(model: Model, logs: LogSet) -> list[str]:
    """What is suspicious in the logs of a model, and its report does not say."""
    said = [] if model.report is None else model.report.warnings
    return [text for text in screen_with(model, logs) if text not in said]


def doubts(
    robot: Robot, logs: Sequence[Log], options: dict[str, Any], progress: ProgressCallback | None = None
) -> list[Found]:
    """What is wrong with logs, and what the physics of their robot finds suspicious in them.

    For commands whose own result does not tell. Of logs that nothing can be identified from only what is wrong with
    them: the command itself says why.
    """
    texts: list[str] = []
    try:
        own = LogSet(stretches(logs), whole=True)
        model = identify_from(robot, own, progress=progress, **options)
        assert model.report is not None, "just identified"
        texts = [*model.report.warnings, *unsaid(model, own)]
    except SgprError:
        pass
    return of_result(texts, logs)


def how_much_data(robot: Robot, forecast: dict[str, Any]) -> dict[str, Any]:
    """Whether a log is enough, in words, and what uncertain parameters bring to the torque of each joint."""
    seconds, deviation, noise = (forecast[key] for key in ("seconds", "standard_deviation", "noise"))
    to_go, advice = forecast["seconds_to_go"], forecast["advice"]
    names = robot.joint_names
    if to_go == 0.0:
        answer = "enough data: at every joint uncertain parameters add less than a third of the noise to the torque"
    elif to_go is not None:
        worst = int(np.argmax(deviation[0] / np.where(noise > 0.0, noise, np.inf)))
        times = deviation[0][worst] / noise[worst]
        answer = (
            f"record another {_rounded_up(to_go)} s of motion like this: until then uncertain parameters add up to "
            f"{significant(times, 2)} times the noise to the torque ({names[worst]})"
        )
    else:
        short = [name for name, at in zip(names, forecast["enough_at"], strict=True) if at is None]
        answer = (
            f"more of this motion is not enough: after {significant(seconds[-1], 2)} s uncertain parameters would "
            f"still add more than a third of the noise to the torque of {', '.join(short)}; record another motion"
        ) + (f": {'; '.join(advice)}" if advice else "")
    return _amounts(robot, forecast, answer)


def how_much_to_record(robot: Robot, forecast: dict[str, Any]) -> dict[str, Any]:
    """How much of a motion to record, in words, and what uncertain parameters bring to the torque of each joint."""
    once, last = forecast["seconds"][0], forecast["seconds"][-1]
    enough = [at for at in forecast["enough_at"] if at is not None]
    if len(enough) < robot.dof:
        short = [name for name, at in zip(robot.joint_names, forecast["enough_at"], strict=True) if at is None]
        answer = (
            f"{significant(last, 2)} s of this motion would not be enough for {', '.join(short)}: uncertain parameters "
            "would still add more than a third of what the model leaves to the torque of other motion of its kind"
        )
    else:
        times = math.ceil(max(enough) / once - 1e-6)
        answer = (
            f"record {_rounded_up(max(enough))} s, {counted(times, 'repetition')} of the motion: then uncertain "
            "parameters add less than a third of what the model leaves to the torque of other motion of its kind"
        )
    return _amounts(robot, forecast, answer)


def _amounts(robot: Robot, forecast: dict[str, Any], answer: str) -> dict[str, Any]:
    joints = zip(
        robot.joint_names, forecast["noise"], forecast["standard_deviation"].T, forecast["enough_at"], strict=True
    )
    return {
        "answer": answer,
        "seconds_to_go": forecast["seconds_to_go"],
        "seconds": forecast["seconds"].tolist(),
        "joints": [
            {"name": name, "noise": float(left), "standard_deviations": own.tolist(), "enough_at_s": at}
            for name, left, own, at in joints
        ],
    }


def _rounded_up(seconds: float) -> str:
    """Seconds with two digits, not fewer than there are."""
    step = 10.0 ** (np.floor(np.log10(max(seconds, 1.0))) - 1.0)
    return significant(float(np.ceil(seconds / step) * step), 2)


def excitation(condition: float, count: int, undetermined: Sequence[str]) -> str:
    """How well a motion excites the base parameters, in words."""
    if undetermined:
        return f"the motion excites {count - len(undetermined)} of {counted(count, 'base parameter')}"
    word = "well" if condition <= GOOD else "fairly" if condition <= POOR else "badly"
    return (
        f"the motion excites all {counted(count, 'base parameter')}, {word}: the condition number is "
        f"{significant(condition, 3)} (columns scaled; up to {significant(GOOD, 3)} is good, above "
        f"{significant(POOR, 3)} is poor)"
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
