"""The torque of a log and of every model as rows of numbers, and what of them a screen shows."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tsdownsample import MinMaxDownsampler

from .. import Comparison, LogResidual, Processing, Recording
from ..cli.errors import BadData

Rows = NDArray[np.float32]
Times = NDArray[np.float64]

Line = tuple[Times, Rows]
Places = NDArray[np.int64]

MOST_POINTS = 4000
"""Of a line: more than a screen is wide."""

MOST_BANDS = 6
"""Torques of a joint in the band of the fit that are kept: a look at a joint asks for some of them again and again."""

BLOCK = 128
"""Samples of which the smallest and the largest are known in advance: a look at all of a long log need not go through
all of it."""


@dataclass
class Track:
    """A log at the samples of its comparison.

    - `t`: s since its first sample, `[N]`; `starts`: where a stretch begins, after the first; `rates`: of each, Hz
    - rows of `[n, N]`: `measured` and `predicted` as they are, `q`, `dq`, `ddq`
    - `processing`: with the filter of the fit, through which torques go when they are asked for; None for none
    - `interval`: half the interval of 95 % of steps that know it, `[n, N]`
    """

    t: Times
    starts: list[int]
    rates: list[float]
    processing: Processing | None
    counted: NDArray[np.bool_]
    rows: dict[str, Rows]
    predicted: dict[str, Rows] = field(default_factory=dict)
    interval: dict[str, Rows] = field(default_factory=dict)
    channels: dict[str, Times] = field(default_factory=dict)
    peaks: dict[tuple[str, str, int], Places] = field(default_factory=dict)
    bands: dict[tuple[str, int], Rows] = field(default_factory=dict)

    def line(self, kind: str, name: str, joint: int, at: Any = slice(None)) -> Rows:
        """What is drawn of a joint at some samples: `measured`, or a step: its torque, or measured minus that."""
        measured: Rows = self.rows["measured"][joint, at]
        if name == "measured":
            return measured
        predicted: Rows = self.predicted[name][joint, at]
        return predicted if kind == "torque" else measured - predicted

    def peaks_of(self, kind: str, name: str, joint: int) -> Places:
        """Where each block of such a line is smallest and largest, in order."""
        key = (kind, name, joint)
        if key not in self.peaks:
            self.peaks[key] = peaks_in(self.line(kind, name, joint))
        return self.peaks[key]

    def forget(self, steps: set[str]) -> None:
        """All of these steps."""
        for table in (self.predicted, self.interval):
            for step in steps & set(table):
                del table[step]
        self.peaks = {key: found for key, found in self.peaks.items() if key[1] not in steps}
        self.bands = {key: found for key, found in self.bands.items() if key[0] not in steps}

    def in_band(self, name: str, joint: int) -> Rows:
        """The torque of a joint as the fit sees it, `measured` or that of a step, `[N]`; the last few are kept."""
        key = (name, joint)
        line = self.bands.get(key)
        if line is None:
            line = self.line("torque", name, joint)
            if self.processing is not None:
                ends = [0, *self.starts, len(line)]
                parts = zip(pairwise(ends), self.rates, strict=True)
                pieces = [self.processing.in_band(line[first:last], rate) for (first, last), rate in parts]
                line = np.concatenate(pieces).astype(np.float32)
            self.bands = dict([*self.bands.items(), (key, line)][-MOST_BANDS:])
        return line

    def residual(self, step: str, joint: int) -> Rows:
        """Measured minus predicted torque of a joint as the fit sees it, `[N]`."""
        return np.asarray(self.in_band("measured", joint) - self.in_band(step, joint))

    def add(self, step: str, found: Comparison, interval: Sequence[Times] | None = None) -> None:
        """The prediction of a model, and half its interval of 95 %."""
        parts = found.logs
        if sum(len(part.time_ns) for part in parts) != len(self.t):
            raise BadData("the models are judged at different samples")
        self.predicted[step] = joined(parts, "predicted")
        if interval is not None:
            self.interval[step] = np.ascontiguousarray(np.concatenate(interval).T, dtype=np.float32)


def track_of(comparison: Comparison, recordings: Sequence[Recording], processing: Processing | None) -> Track:
    """The log without any prediction, to be judged in the band of a processing."""
    found = comparison.logs
    if not found:
        raise BadData("too short to be filtered")
    time = np.concatenate([part.time_ns for part in found])
    lengths = np.cumsum([len(part.time_ns) for part in found])[:-1]
    rows = {name: joined(found, name) for name in ("measured", "q", "dq", "ddq")}
    counted = np.concatenate([part.counted for part in found]).T.copy()
    t = (time - time[0]) * 1e-9
    channels = {}
    for name in recordings[0].channels:
        parts = [part for part in recordings if name in part.channels]
        at = np.concatenate([part.time_ns for part in parts])
        values = np.concatenate(
            [np.asarray(part.channels[name], dtype=float).reshape(len(part), -1)[:, 0] for part in parts]
        )
        channels[name] = np.interp((time - time[0]) * 1e-9, (at - time[0]) * 1e-9, values)
    rates = [part.rate_hz for part in found]
    return Track(t, lengths.tolist(), rates, processing, counted, rows, channels=channels)


def joined(parts: Sequence[LogResidual], name: str) -> Rows:
    """An array of all stretches, `[n, N]`: a row is in one piece of memory, and no copy is made on the way."""
    arrays = [getattr(part, name) for part in parts]
    rows = np.empty((arrays[0].shape[1], sum(map(len, arrays))), dtype=np.float32)
    end = 0
    for array in arrays:
        rows[:, end : end + len(array)] = array.T
        end += len(array)
    return rows


def piece(
    track: Track, steps: Sequence[str], kind: str, bounds: tuple[float, float], points: int
) -> tuple[list[dict[str, Line]], bool]:
    """What is drawn of each joint between two times, and whether it is every sample.

    - `kind`: "torque" or "residual"
    - returns per joint the lines by name, `measured` if torque is shown and one per step, each with times [s]
    """
    first, last = np.searchsorted(track.t, bounds)
    # One more at each side: a line goes on to the edge of the picture.
    first, last = max(0, int(first) - 1), min(len(track.t), int(last) + 1)
    points = min(points, MOST_POINTS)
    names = (["measured"] if kind == "torque" else []) + [step for step in steps if step in track.predicted]
    joints = []
    for joint in range(len(track.rows["q"])):
        lines = {}
        for name in names:
            lines[name] = _line(track, (first, last), points, (kind, name, joint))
            if name in track.interval:
                # About the prediction, or about zero: where the measured torque, or the residual, should be.
                half = track.interval[name][joint, first:last]
                middle = track.predicted[name][joint, first:last] if kind == "torque" else np.zeros_like(half)
                for end, values in (("low", middle - half), ("high", middle + half)):
                    lines[f"{name} {end}"] = _with_gaps(track, _thinned(values, points) + first, values, first)
        joints.append(lines)
    return joints, last - first <= points


def peaks_in(line: Rows) -> Places:
    """Where each block is smallest and largest, in order; the rest that fills no block, sample by sample."""
    whole = len(line) // BLOCK * BLOCK
    blocks = line[:whole].reshape(-1, BLOCK)
    if np.isnan(line.sum()):
        blocks = np.nan_to_num(blocks)
    ends = np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1)
    ends.sort(axis=1)
    places = (ends + np.arange(0, whole, BLOCK)[:, None]).ravel()
    return np.concatenate([np.unique(places), np.arange(whole, len(line))])


def _line(track: Track, bounds: tuple[int, int], points: int, which: tuple[str, str, int]) -> Line:
    """A line between two samples; of many blocks only where they are smallest and largest is looked at."""
    first, last = bounds
    if last - first <= BLOCK * points:
        values = track.line(*which, slice(first, last))
        return _with_gaps(track, _thinned(values, points) + first, values, first)
    peaks = track.peaks_of(*which)
    start, end = np.searchsorted(peaks, bounds)
    places = np.concatenate([[first], peaks[start:end], [last - 1]])
    places = places[np.diff(places, prepend=-1) > 0]
    values = track.line(*which, places)
    kept = _thinned(values, points)
    return _with_gaps(track, places[kept], values[kept])


def _thinned(line: Rows, points: int) -> Places:
    """Where each group of samples is smallest and largest, and the ends."""
    if len(line) <= points:
        return np.arange(len(line))
    known = np.nan_to_num(line) if np.isnan(line.sum()) else np.ascontiguousarray(line)
    downsampler: Any = MinMaxDownsampler
    chosen = downsampler().downsample(known, n_out=points - points % 2)
    return np.unique(np.concatenate([[0, len(line) - 1], chosen.astype(np.int64)]))


def _with_gaps(track: Track, kept: Places, line: Rows, first: int | None = None) -> Line:
    """Samples of a log with a gap where a stretch ends: a line through it would be made up.

    - `line`: their values, or, from the sample `first` on, those of all
    """
    t, y = track.t[kept], line if first is None else line[kept - first]
    places = np.searchsorted(kept, track.starts)
    places = np.unique(places[(places > 0) & (places < len(kept))])
    if len(places):
        t, y = np.insert(t, places, t[places - 1]), np.insert(y, places, np.nan)
    return t, y
