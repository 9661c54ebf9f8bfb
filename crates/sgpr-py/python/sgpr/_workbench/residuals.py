"""The residual against anything, its spectrum and autocorrelation, and what is different in a picked region."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cli.errors import BadData
from ..report.colours import AFTER, BEFORE, INTERVAL, LINES, MEASURED
from ..report.figures import axis, layout, plain, rounded
from ..report.numbers import percent, significant
from .bench import Bench
from .tracks import Track

Array = NDArray[np.float64]

SHOWN_POINTS = 2500
DENSE = 20_000
"""More samples than this are drawn as density: dots would hide each other."""
BINS = 50
FEWEST = 8
GAP = 0.05
"""Of the range of a variable: a stretch without samples that is longer is left open."""
PICKED = "#cc79a7"
LONGEST_LAG = 2.0
"""s"""

QUANTITIES = {"q": "position", "dq": "speed", "ddq": "acceleration", "tau": "model torque", "measured": "torque"}


@dataclass(frozen=True)
class Region:
    """A rectangle in a plot of the residual against a variable."""

    variable: str
    x: tuple[float, float]
    y: tuple[float, float]


class Samples:
    """The residual of one joint over some logs, those samples that the fit counts."""

    def __init__(self, bench: Bench, logs: Sequence[str], joint: str, step: str) -> None:
        if bench.robot is None or joint not in bench.robot.joint_names:
            raise BadData(f"there is no joint {joint}")
        self.robot = bench.robot
        self.names = bench.robot.joint_names
        self.joint, self.k, self.step = joint, self.names.index(joint), step
        self.logs = list(logs)
        self.tracks: list[Track] = [bench.track(name) for name in logs]
        if not self.tracks or any(step not in track.predicted for track in self.tracks):
            raise BadData("there is no prediction of this model yet")
        self.masks = [track.counted[self.k] & np.isfinite(track.residual(step, self.k)) for track in self.tracks]
        self.residual = self._all(lambda track: track.residual(step, self.k))
        self.log = np.repeat(np.arange(len(logs)), [int(mask.sum()) for mask in self.masks])

    def _all(self, take: Any) -> Array:
        parts = [
            np.asarray(take(track), dtype=float)[mask] for track, mask in zip(self.tracks, self.masks, strict=True)
        ]
        return np.concatenate(parts)

    def variables(self) -> dict[str, str]:
        """What the residual can be drawn against: key and title with unit, those of the joint itself first."""
        found = {"t": "time [s]"}
        for k in [self.k, *(k for k in range(len(self.names)) if k != self.k)]:
            position, torque = self.robot.position_units[k], self.robot.torque_units[k]
            units = {"q": position, "dq": f"{position}/s", "ddq": f"{position}/s²", "tau": torque, "measured": torque}
            found |= {f"{key}:{k}": f"{word} of {self.names[k]} [{units[key]}]" for key, word in QUANTITIES.items()}
        for name in self.tracks[0].channels:
            if all(name in track.channels for track in self.tracks):
                found[f"channel:{name}"] = name
        return found

    def values(self, variable: str) -> Array:
        """A variable at the samples."""
        kind, _, which = variable.partition(":")
        if variable not in self.variables():
            raise BadData(f"there is nothing called {variable} in these logs")
        if kind == "t":
            return self._all(lambda track: track.t)
        if kind == "channel":
            return self._all(lambda track: track.channels[which])
        if kind == "tau":
            return self._all(lambda track: track.in_band(self.step, int(which)))
        if kind == "measured":
            return self._all(lambda track: track.in_band("measured", int(which)))
        return self._all(lambda track: track.rows[kind][int(which)])

    def gain(self, other: str) -> Array:
        """What another model predicts more."""
        return self._all(lambda track: track.in_band(other, self.k) - track.in_band(self.step, self.k))

    def inside(self, region: Region) -> NDArray[np.bool_]:
        """Which samples are in a region."""
        x = self.values(region.variable)
        (x0, x1), (y0, y1) = sorted(region.x), sorted(region.y)
        return (x >= x0) & (x <= x1) & (self.residual >= y0) & (self.residual <= y1)


def against(
    samples: Samples, variable: str, colour: str = "", other: str = "", region: Region | None = None
) -> dict[str, Any]:
    """The residual against a variable: dots or density, mean and spread, what another model explains, what is picked.

    - `colour`: "" for none, "log", or a variable
    - `other`: a step whose gain over this one is drawn through
    """
    x, y = samples.values(variable), samples.residual
    title, unit = samples.variables()[variable], samples.robot.torque_units[samples.k]
    keep = np.unique(np.linspace(0, len(x) - 1, min(SHOWN_POINTS, len(x))).astype(int))
    traces = _cloud(samples, x, y, keep, colour)
    centre, mean, low, high = averages(x, y)
    around = outline(centre, low, high)
    traces += [
        {**_line("two thirds of the samples", *around, INTERVAL), "line": {"width": 0}, "fill": "toself",
         "fillcolor": "rgba(86,180,233,.30)", "hoverinfo": "skip"},
        _line("mean", centre, mean, "#000000"),
    ]  # fmt: skip
    if other:
        centre, more, _, _ = averages(x, samples.gain(other))
        traces.append(
            {
                **_line("the other model explains", centre, more, AFTER),
                "line": {"color": AFTER, "dash": "dash", "width": 2.5},
            }
        )
    if region is not None:
        chosen = np.flatnonzero(samples.inside(region))
        chosen = (
            chosen[np.unique(np.linspace(0, len(chosen) - 1, min(1000, len(chosen))).astype(int))]
            if len(chosen)
            else chosen
        )
        traces.append(_dots("picked", x[chosen], y[chosen], {"color": PICKED, "size": 5, "symbol": "diamond"}))
    return _drawn(traces, axis(title), axis(f"residual of {samples.joint} [{unit}]"), dragmode="select")


def _cloud(samples: Samples, x: Array, y: Array, keep: NDArray[np.int64], colour: str) -> list[dict[str, Any]]:
    if colour == "log":
        return [
            _dots(name, x[part], y[part], {"color": LINES[number % len(LINES)], "size": 3, "opacity": 0.5})
            for number, name in enumerate(samples.logs)
            if len(part := keep[samples.log[keep] == number])
        ]
    if colour:
        if colour not in samples.variables():
            raise BadData(f"there is nothing called {colour} in these logs")
        bar = {"title": {"text": plain(samples.variables()[colour]), "side": "right"}, "thickness": 12}
        marker = {"size": 4, "color": rounded(samples.values(colour)[keep]), "colorscale": "Cividis", "colorbar": bar}
        return [_dots("samples", x[keep], y[keep], marker)]
    if len(x) > DENSE:
        count, edges_x, edges_y = np.histogram2d(x, y, bins=(90, 60))
        z = np.log10(np.where(count > 0, count, np.nan)).T
        bar = {"title": {"text": "samples (log10)", "side": "right"}, "thickness": 12}
        return [
            {"type": "heatmap", "name": "density", "x": rounded((edges_x[1:] + edges_x[:-1]) / 2), "hoverinfo": "skip",
             "y": rounded((edges_y[1:] + edges_y[:-1]) / 2), "z": [rounded(row, 3) for row in z], "colorscale": "Greys",
             "reversescale": True, "colorbar": bar},
            _dots("samples", x[keep], y[keep], {"color": BEFORE, "size": 3, "opacity": 0.01}) | {"showlegend": False},
        ]  # fmt: skip
    return [_dots("samples", x[keep], y[keep], {"color": BEFORE, "size": 3, "opacity": 0.35})]


def over_two(samples: Samples, first: str, second: str) -> dict[str, Any]:
    """Mean residual over two variables."""
    # Loaded when it is needed: it takes longer than all the rest of the program.
    stats = import_module("scipy.stats")

    x, y = samples.values(first), samples.values(second)
    if first == second:
        raise BadData("the map needs two different variables")
    mean, edges_x, edges_y, _ = stats.binned_statistic_2d(x, y, samples.residual, statistic="mean", bins=40)
    count = stats.binned_statistic_2d(x, y, None, statistic="count", bins=[edges_x, edges_y]).statistic
    z = np.where(count >= FEWEST // 2, mean, np.nan).T
    limit = float(np.nanquantile(np.abs(z), 0.98)) if np.isfinite(z).any() else 1.0
    titles, unit = samples.variables(), samples.robot.torque_units[samples.k]
    trace = {
        "type": "heatmap",
        "x": rounded((edges_x[1:] + edges_x[:-1]) / 2),
        "y": rounded((edges_y[1:] + edges_y[:-1]) / 2),
        "z": [rounded(row, 4) for row in z],
        "zmin": -limit,
        "zmax": limit,
        "colorscale": [[0, LINES[0]], [0.5, "#ffffff"], [1, BEFORE]],
        "colorbar": {"title": {"text": f"mean residual [{unit}]", "side": "right"}, "thickness": 12},
    }
    return _drawn([trace], axis(titles[first]), axis(titles[second]))


def whiteness(samples: Samples, decimation: int) -> list[dict[str, Any]]:
    """Spectrum and autocorrelation of the residual in its longest stretch, with what noise alone would give.

    Every `decimation`-th sample is taken, as the fit does: those between them are not independent after its filter.
    """
    # Loaded when it is needed: it takes longer than all the rest of the program.
    signal, stats = import_module("scipy.signal"), import_module("scipy.stats")

    y, rate = _longest(samples, decimation)
    if len(y) < 64:
        raise BadData("no stretch is long enough for a spectrum")
    y = y - y.mean()
    segment = min(len(y) // 4, 1024)
    frequency, density = signal.welch(y, fs=rate, nperseg=segment)
    free = 2.0 * (2 * len(y) / segment - 1) * 0.9
    white = 2.0 * float(y.var()) / rate
    low, high = (white * stats.chi2.ppf(p, free) / free for p in (0.025, 0.975))
    unit = samples.robot.torque_units[samples.k]
    spectrum = [
        _band("white noise, 95 %", frequency[1:], low, high),
        _line(f"residual of {samples.joint}", frequency[1:], density[1:], AFTER),
    ]
    lags = min(int(LONGEST_LAG * rate), len(y) // 3)
    correlation = signal.correlate(y, y, method="fft")[len(y) - 1 :][: lags + 1]
    correlation = correlation / correlation[0]
    bound = float(stats.norm.ppf(0.975)) / np.sqrt(len(y))
    times = np.arange(1, lags + 1) / rate
    correlogram = [
        _band("white noise, 95 %", times, -bound, bound),
        _line(f"residual of {samples.joint}", times, correlation[1:], AFTER),
    ]
    return [
        _drawn(spectrum, axis("frequency [Hz]"), axis(f"density [({unit})²/Hz]", type="log", exponentformat="power")),
        _drawn(correlogram, axis("lag [s]"), axis("autocorrelation")),
    ]


def _longest(samples: Samples, decimation: int) -> tuple[Array, float]:
    best: tuple[Array, float] = (np.zeros(0), 1.0)
    for track in samples.tracks:
        residual = track.residual(samples.step, samples.k)
        for first, last in pairwise([0, *track.starts, len(track.t)]):
            y = np.asarray(residual[first : last : max(1, decimation)], dtype=float)
            if len(y) > max(1, len(best[0])) and np.isfinite(y).all():
                t = track.t[first : last : max(1, decimation)]
                best = (y, float(1.0 / np.median(np.diff(t))))
    return best


def difference(samples: Samples, region: Region) -> dict[str, Any]:
    """What is different in a picked region: one sentence, and a table of the variables that differ most."""
    # Loaded when it is needed: it takes longer than all the rest of the program.
    from scipy import stats  # type: ignore[import-untyped]

    inside = samples.inside(region)
    count = int(inside.sum())
    if count == 0 or count == len(inside):
        return {
            "sentence": "No sample is in this region." if count == 0 else "All samples are in it.",
            "rows": [],
            "logs": [],
        }
    square = samples.residual**2
    share = 100.0 * float(square[inside].sum() / max(square.sum(), 1e-300))
    rows = []
    thin = slice(None, None, max(1, len(inside) // 20_000))
    for key, title in samples.variables().items():
        if key == region.variable or not np.isfinite(values := samples.values(key)).all():
            continue
        here, elsewhere = values[inside], values[~inside][thin]
        rows.append(
            (
                float(stats.ks_2samp(here[:20_000], elsewhere, method="asymp").statistic),
                title,
                _range(here),
                _range(elsewhere),
            )
        )
    rows.sort(reverse=True)
    logs = []
    time = samples.values("t")
    for number, name in enumerate(samples.logs):
        of_log = samples.log == number
        if (both := of_log & inside).any():
            shares = [100.0 * float(both.sum()) / whole for whole in (count, of_log.sum())]
            ends = [significant(float(end), 4) for end in (time[both].min(), time[both].max())]
            logs.append([name, *map(percent, shares), *ends])
    most = max(logs, key=lambda row: float(row[1]))
    best = rows[0]
    sentence = (
        f"{count} samples ({percent(100.0 * count / len(inside))} %) hold {percent(share)} % of the squared error of "
        f"{samples.joint}; besides what you picked they differ most in {best[1]}: {best[2]} here, {best[3]} elsewhere; "
        f"{most[1]} % of them come from {most[0]}, from {most[3]} s on."
    )
    return {"sentence": sentence, "rows": [[r[1], r[2], r[3], significant(r[0], 2)] for r in rows[:8]], "logs": logs}


def averages(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Mean, and the bounds of two thirds, of y over bins of x with equally many samples.

    Where x has a gap there is a bin without numbers: a line through it would be made up.
    """
    order = np.argsort(x)
    x, y = x[order], y[order]
    if len(x) < FEWEST or x[0] == x[-1]:
        nothing = np.zeros(0)
        return nothing, nothing, nothing, nothing
    gaps = np.flatnonzero(np.diff(x) > GAP * (x[-1] - x[0])) + 1
    found: list[tuple[float, ...]] = []
    for start, end in pairwise([0, *gaps.tolist(), len(x)]):
        bins = max(1, round(BINS * (end - start) / len(x)))
        for part in np.array_split(np.arange(start, end), bins):
            if len(part) >= FEWEST:
                low, high = np.quantile(y[part], [1 / 6, 5 / 6])
                found.append((float(x[part].mean()), float(y[part].mean()), float(low), float(high)))
        found.append((np.nan,) * 4)
    centre, mean, low, high = np.array(found[:-1]).T
    return centre, mean, low, high


def outline(x: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The line around a band, piece by piece where it has gaps: there and back, with no number between two pieces."""
    known = np.isfinite(x)
    ends = np.flatnonzero(np.diff(known.astype(int), prepend=0, append=0))
    pieces = [slice(first, last) for first, last in ends.reshape(-1, 2)]
    gap = np.full(1, np.nan)
    around = [(np.concatenate([x[p], x[p][::-1], gap]), np.concatenate([low[p], high[p][::-1], gap])) for p in pieces]
    if not around:
        return np.zeros(0), np.zeros(0)
    xs, ys = zip(*around, strict=True)
    return np.concatenate(xs)[:-1], np.concatenate(ys)[:-1]


def _range(values: Array) -> str:
    low, high = np.quantile(values, [0.1, 0.9])
    return f"{significant(float(low))} … {significant(float(high))}"


def _dots(name: str, x: Array, y: Array, marker: dict[str, Any]) -> dict[str, Any]:
    return {"type": "scatter", "mode": "markers", "name": name, "x": rounded(x), "y": rounded(y), "marker": marker}


def _line(name: str, x: Array, y: Array, colour: str) -> dict[str, Any]:
    style = {"color": colour, "width": 2}
    return {"type": "scatter", "mode": "lines", "name": name, "x": rounded(x), "y": rounded(y), "line": style}


def _band(name: str, x: Array, low: float, high: float) -> dict[str, Any]:
    ends = [x[0], x[-1], x[-1], x[0]]
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": rounded(ends), "y": rounded([low, low, high, high]),
        "fill": "toself", "fillcolor": "rgba(154,154,154,.30)", "line": {"color": MEASURED, "width": 1, "dash": "dot"},
        "hoverinfo": "skip",
    }  # fmt: skip


def _drawn(traces: list[dict[str, Any]], x: dict[str, Any], y: dict[str, Any], **settings: Any) -> dict[str, Any]:
    for trace in traces:
        # What a file calls something is text: Plotly would take some of it for markup.
        if trace.get("name"):
            trace["name"] = plain(trace["name"])
    for each in (x, y):
        each["title"]["text"] = plain(each["title"]["text"])
    return {"data": traces, "layout": layout(xaxis=x, yaxis=y, height=380, **settings)}
