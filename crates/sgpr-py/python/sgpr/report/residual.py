"""The residual against a variable that the reader chooses."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import LogResidual, Robot
from .colours import AFTER, BEFORE
from .markup import Html, choice, element, join, legend, paragraph, plot
from .torque import Array, packed

SAMPLES = 3000
"""Of the page, evenly over all logs: some 0.7 MB for seven joints."""
HEIGHT = 420
PLOT = "residual-plot"

KINDS = (("q", "position"), ("dq", "speed"), ("ddq", "acceleration"), ("tau", "model torque"))


def residual_section(
    models: Mapping[str, Sequence[Sequence[LogResidual]]], logs: Sequence[str], robot: Robot
) -> tuple[Html, dict[str, Any]]:
    """The plot with its selections, and its data.

    - `models`: label -> residuals of each log; one or two, the last one in the foreground
    """
    pieces = [[piece for log in parts for piece in log] for parts in models.values()]
    if not pieces[0]:
        return paragraph("No log has a stretch that is long enough."), {}
    colours = (AFTER,) if len(models) == 1 else (BEFORE, AFTER)
    variables = ["time since the first sample [s]", *(title for title, _ in _variables(robot, pieces[-1]))]
    names = robot.joint_names
    body = [
        paragraph(
            "Measured minus predicted torque in the band of the model, where the joint moves. The line is the mean of "
            "groups of equally many samples, the band holds two thirds of them: a mean off zero is what a term in "
            "this variable could take."
        ),
        legend([("━", colour, label) for label, colour in zip(models, colours, strict=True)]),
        element(
            "div",
            join(
                [
                    choice("residual-joint", "Residual of", names, keep=True),
                    choice("residual-x", "against", variables, keep=True),
                    choice("residual-log", "in", ["all logs", *(logs if len(logs) > 1 else [])]),
                ]
            ),
            class_="choices",
        ),
        plot(PLOT, HEIGHT, "Residual torque against the chosen variable"),
    ]
    payload = {
        "models": [{"label": label, "colour": colour} for label, colour in zip(models, colours, strict=True)],
        "joints": [f"residual of {name} [{unit}]" for name, unit in zip(names, robot.torque_units, strict=True)],
        "variables": variables,
        "start": _weakest(pieces[-1]),
        **_samples(list(models.values()), robot),
    }
    return join(body), payload


def _variables(robot: Robot, pieces: Sequence[LogResidual]) -> list[tuple[str, Array]]:
    """Title with unit, and values at all samples of the stretches."""
    found = []
    for k, name in enumerate(robot.joint_names):
        position, torque = robot.position_units[k], robot.torque_units[k]
        units = {"q": position, "dq": f"{position}/s", "ddq": f"{position}/s²", "tau": torque}
        for kind, word in KINDS:
            row = "predicted_in_band" if kind == "tau" else kind
            values = np.concatenate([getattr(piece, row)[:, k] for piece in pieces])
            found.append((f"{word} of {name} [{units[kind]}]", values))
    return found


def _weakest(pieces: Sequence[LogResidual]) -> int:
    """The joint whose residual is largest beside its torque."""
    measured, predicted, counted = (
        np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("measured_in_band", "predicted_in_band", "counted")
    )
    square = [np.where(counted, rows, 0.0) ** 2 for rows in (measured - predicted, measured)]
    sums = [np.nan_to_num(rows).sum(axis=0) for rows in square]
    return int(np.argmax(sums[0] / np.maximum(sums[1], 1e-300)))


def _samples(models: Sequence[Sequence[Sequence[LogResidual]]], robot: Robot) -> dict[str, Any]:
    last = models[-1]
    flat = [piece for log in last for piece in log]
    count = sum(len(piece.time_ns) for piece in flat)
    keep = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int))
    starts = [log[0].time_ns[0] for log in last if log]
    logs = [number for number, log in enumerate(last) for _ in log]
    first = dict(zip([number for number, log in enumerate(last) if log], starts, strict=True))
    time = np.concatenate([(piece.time_ns - first[number]) * 1e-9 for number, piece in zip(logs, flat, strict=True)])
    log = np.concatenate([np.full(len(piece.time_ns), number) for number, piece in zip(logs, flat, strict=True)])
    counted = np.concatenate([piece.counted for piece in flat])
    residuals = []
    for model in models:
        rows = np.concatenate([p.measured_in_band - p.predicted_in_band for each in model for p in each])
        rows = np.where(counted, rows, np.nan)[keep]
        residuals.append([packed(rows[:, k]) for k in range(rows.shape[1])])
    return {
        "values": [packed(time[keep]), *(packed(values[keep]) for _, values in _variables(robot, flat))],
        "residuals": residuals,
        "log": packed(log[keep]),
    }
