"""Measured and predicted torque over time, log by log, joint by joint."""

import base64
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import LogResidual
from .colours import AFTER, BEFORE, INTERVAL, MEASURED, NOT_COUNTED
from .figures import TOOLS, axis, layout
from .markup import Html, choice, element, join, legend, paragraph, plot

Array = NDArray[np.float64]
Pieces = Sequence[LogResidual]

# Numbers of the page's plots of torque, of four bytes (and a third for text): some 6 MB.
BUDGET = 1_100_000
LEAST_POINTS = 2000
MOST_BANDS = 200
HEIGHT = 450


def torque_section(
    models: Mapping[str, Sequence[Pieces]],
    logs: Sequence[str],
    joints: Sequence[tuple[str, str]],
    intervals: Sequence[Sequence[Array]] | None = None,
) -> tuple[Html, dict[str, Any]]:
    """The plots, and their data.

    - `models`: label -> residuals of each log; one or two, the last one in the foreground
    - `joints`: name and unit of the torque
    - `intervals`: half the interval of 95 % of the last model at the samples of each stretch of each log
    """
    colours = (AFTER,) if len(models) == 1 else (BEFORE, AFTER)
    pieces = [list(parts) for parts in zip(*models.values(), strict=True)]
    shown = [k for k, parts in enumerate(pieces) if parts[0]]
    if not shown:
        return paragraph("No log has a stretch that is long enough."), {}
    budget = max(LEAST_POINTS, BUDGET // (len(shown) * len(joints) * (2 + 2 * len(models))))
    keys = [("━", MEASURED, "measured, as logged")]
    keys += [("━", colour, label) for label, colour in zip(models, colours, strict=True)]
    if intervals is not None:
        keys.append(("■", INTERVAL, "predicted interval of 95 % of the residual"))
    body = [
        paragraph(
            "Above, the torque as it was logged and as predicted; below, measured minus predicted in the band that the "
            "figures are for. Drag over a plot to zoom all joints, double-click to go back."
        ),
        legend([*keys, ("■", "#cccccc", "not counted: joint at rest, or ends of a stretch")]),
        choice("torque-choice", "Log", [logs[k] for k in shown]),
    ]
    for index, (name, unit) in enumerate(joints):
        body += [
            element("h3", name),
            plot(f"torque-{index}", HEIGHT, f"Measured and predicted torque of {name}, {unit}"),
        ]
    payload = {
        "logs": [_log(pieces[k], budget, None if intervals is None else intervals[k]) for k in shown],
        "models": [{"label": label, "colour": colour} for label, colour in zip(models, colours, strict=True)],
        "layouts": [_layout(unit) for _, unit in joints],
        "measured_colour": MEASURED,
        "not_counted_colour": NOT_COUNTED,
        "interval_colour": INTERVAL,
    }
    return join(body), payload


def _layout(unit: str) -> dict[str, Any]:
    return layout(
        xaxis=axis("time since the first sample [s]", anchor="y2"),
        yaxis=axis(f"torque [{unit}]", domain=[0.40, 1.0]),
        yaxis2=axis(f"residual [{unit}]", domain=[0.0, 0.32]),
        hovermode="x",
        margin={"l": 68, "r": 12, "t": TOOLS, "b": 44},
        showlegend=False,
    )


def _log(models: Sequence[Pieces], budget: int, intervals: Sequence[Array] | None) -> dict[str, Any]:
    """One log; stretches are separated by a sample that is not a number."""
    first = models[0]
    start = int(first[0].time_ns[0])
    time = _gapped([(piece.time_ns - start).astype(np.float64) * 1e-9 for piece in first])
    measured = _gapped([piece.measured for piece in first])
    counted = np.concatenate([np.vstack([piece.counted, piece.counted[-1:]]) for piece in first])[:-1]
    predicted = [_gapped([piece.predicted for piece in pieces]) for pieces in models]
    residual = [_gapped([piece.measured_in_band - piece.predicted_in_band for piece in pieces]) for pieces in models]
    interval = None if intervals is None else _gapped(intervals)
    joints = []
    for k in range(measured.shape[1]):
        columns = [measured[:, k], *(p[:, k] for p in predicted), *(r[:, k] for r in residual)]
        keep = kept_samples([columns[0], columns[-1]], budget)
        joints.append(
            {
                "time": packed(time[keep]),
                "measured": packed(measured[keep, k]),
                "predicted": [packed(p[keep, k]) for p in predicted],
                "residual": [packed(r[keep, k]) for r in residual],
                "not_counted": uncounted(time, counted[:, k]),
                **({} if interval is None else {"interval": packed(interval[keep, k])}),
            }
        )
    return {"joints": joints, "duration": round(float(np.nanmax(time)), 6)}


def kept_samples(columns: Sequence[Array], budget: int) -> NDArray[np.int64]:
    """Samples to keep: all, or where each column is least and largest in each of many intervals, and gaps."""
    samples = len(columns[0])
    if samples <= budget:
        return np.arange(samples)
    intervals = np.linspace(0, samples, budget // (2 * len(columns)) + 1).astype(int)
    keep: list[int] = [*intervals[:-1].tolist(), samples - 1]
    for column in columns:
        missing = ~np.isfinite(column)
        keep += np.flatnonzero(missing).tolist()
        low, high = np.where(missing, np.inf, column), np.where(missing, -np.inf, column)
        for begin, end in pairwise(intervals.tolist()):
            keep += [begin + int(low[begin:end].argmin()), begin + int(high[begin:end].argmax())]
    return np.unique(keep)


def _gapped(parts: Sequence[Array]) -> Array:
    """Stretches with a row between them that is not a number; times get one too, to be filled."""
    rows: list[Array] = []
    for index, part in enumerate(parts):
        if index:
            gap = part[:1] if part.ndim == 1 else np.full_like(part[:1], np.nan)
            rows.append(gap)
        rows.append(part)
    return np.concatenate(rows)


def uncounted(time: Array, counted: NDArray[np.bool_]) -> list[list[float]]:
    """Times of the first and the last of samples that are not counted; the longest stretches, if there are many.

    The times have four bytes as those of the samples have, so that the page finds them equal.
    """
    change = np.flatnonzero(np.diff(np.concatenate([[True], counted, [True]]).astype(int)))
    shown = time.astype(np.float32).astype(np.float64)
    bands = [[float(shown[a]), float(shown[b - 1])] for a, b in change.reshape(-1, 2)]
    return sorted(sorted(bands, key=lambda band: band[0] - band[1])[:MOST_BANDS])


def packed(values: Array) -> str:
    """Numbers of four bytes as text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")
