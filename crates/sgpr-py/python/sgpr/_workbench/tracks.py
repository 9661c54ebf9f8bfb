"""The torque of a log and of every model as rows of numbers, and what of them a screen shows."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from tsdownsample import MinMaxDownsampler

from .. import Comparison, LogResidual, Recording
from ..cli.errors import BadData

Rows = NDArray[np.float32]
Times = NDArray[np.float64]

Line = tuple[Times, Rows]

MOST_POINTS = 4000
"""Of a line: more than a screen is wide."""


@dataclass
class Track:
    """A log at the samples of its comparison.

    - `t`: s since its first sample, `[N]`; `starts`: where a stretch begins, after the first
    - rows of `[n, N]`: `measured` and `predicted` as they are, `..._in_band` as the fit sees them, `q`, `dq`, `ddq`
    - `interval`: half the interval of 95 % of steps that know it, `[n, N]`
    """

    t: Times
    starts: list[int]
    counted: NDArray[np.bool_]
    rows: dict[str, Rows]
    predicted: dict[str, Rows] = field(default_factory=dict)
    predicted_in_band: dict[str, Rows] = field(default_factory=dict)
    interval: dict[str, Rows] = field(default_factory=dict)
    channels: dict[str, Times] = field(default_factory=dict)

    def residual(self, step: str) -> Rows:
        """Measured minus predicted torque as the fit sees it, `[n, N]`."""
        return np.asarray(self.rows["measured_in_band"] - self.predicted_in_band[step])

    def add(self, step: str, found: Comparison, interval: Sequence[Times] | None = None) -> None:
        """The prediction of a model, and half its interval of 95 %."""
        parts = found.logs
        if sum(len(part.time_ns) for part in parts) != len(self.t):
            raise BadData("the models are judged at different samples")
        self.predicted[step] = joined(parts, "predicted")
        self.predicted_in_band[step] = joined(parts, "predicted_in_band")
        if interval is not None:
            self.interval[step] = np.ascontiguousarray(np.concatenate(interval).T, dtype=np.float32)


def track_of(comparison: Comparison, recordings: Sequence[Recording]) -> Track:
    """The log without any prediction."""
    found = comparison.logs
    if not found:
        raise BadData("too short to be filtered")
    time = np.concatenate([part.time_ns for part in found])
    lengths = np.cumsum([len(part.time_ns) for part in found])[:-1]
    rows = {name: joined(found, name) for name in ("measured", "measured_in_band", "q", "dq", "ddq")}
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
    return Track(t, lengths.tolist(), counted, rows, channels=channels)


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
    joints = []
    for joint in range(len(track.rows["q"])):
        measured = track.rows["measured"][joint, first:last]
        lines = {"measured": measured} if kind == "torque" else {}
        for step in steps:
            if step in track.predicted:
                predicted = track.predicted[step][joint, first:last]
                lines[step] = predicted if kind == "torque" else measured - predicted
                if step in track.interval:
                    # About the prediction, or about zero: where the measured torque, or the residual, should be.
                    middle = predicted if kind == "torque" else np.zeros_like(predicted)
                    half = track.interval[step][joint, first:last]
                    lines |= {f"{step} low": middle - half, f"{step} high": middle + half}
        joints.append({name: _thinned(track, first, line, points) for name, line in lines.items()})
    return joints, last - first <= points


def _thinned(track: Track, first: int, line: Rows, points: int) -> Line:
    """The smallest and the largest of each group of samples, with a gap where a stretch ends: a line through it would
    be made up."""
    kept = np.arange(len(line))
    if len(line) > points:
        chosen = MinMaxDownsampler().downsample(np.nan_to_num(line), n_out=points - points % 2)
        kept = np.unique(np.concatenate([[0, len(line) - 1], chosen.astype(np.int64)]))
    t, y = track.t[kept + first], line[kept]
    places = np.searchsorted(kept + first, track.starts)
    places = np.unique(places[(places > 0) & (places < len(kept))])
    if len(places):
        t, y = np.insert(t, places, t[places - 1]), np.insert(y, places, np.nan)
    return t, y
