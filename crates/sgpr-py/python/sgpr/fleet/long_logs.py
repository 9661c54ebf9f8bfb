"""Logs longer than memory: a record for each piece, as if the log had been whole."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .._sgpr import Model, Processing, Record, Recording, Robot, SgprError, read_parquet_pieces, record

# As the core has it: periods of the log.
_GAP = 5.0
_OPTIONS_OF_PIECES = ("columns", "units", "torque_constants", "accept")


def record_pieces(
    robot: Robot,
    pieces: Iterable[Recording],
    *,
    processing: Model | Processing,
    effects: Sequence[str] | None = None,
    blocks: int = 1,
    lags: bool = True,
    labels: Mapping[str, str] | None = None,
) -> Iterator[Record]:
    """Records of a long log that comes in consecutive pieces, one record for each; memory holds two pieces.

    Filters work as if the log were whole: each piece is processed together with as much of its neighbours as the
    filters remember to fifteen digits, which does not count. `sgpr.identify_records` finds in these records what it
    finds in the record of the whole log, to rounding, if the stamps of the log are regular: the sampling rate is that
    of a piece with its neighbours. Standard deviations are those of logs of the pieces: what the residual remembers
    across the end of a piece is not seen (two fifths of a deviation where pieces of 230 rows meet a memory of 150).

    Parameters
    ----------
    robot : Robot
    pieces : iterable of Recording
        In the order of time, each going on where the one before ended. A piece shorter than the filters remember is put
        together with the next.
    processing : Model or Processing
        As in `record`.
    effects, blocks, lags, labels
        As in `record`, for each piece.

    Returns
    -------
    iterator of Record

    Raises
    ------
    SgprError
        If a piece does not go on where the one before ended, or has other joints.

    Examples
    --------
    >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    >>> processing = sgpr.choose_processing(robot, [log])
    >>> parts = [sgpr.read("train.csv.gz", seconds=(0.0, 7.998)), sgpr.read("train.csv.gz", seconds=(8.0, 20.0))]
    >>> records = list(sgpr.fleet.record_pieces(robot, parts, processing=processing))
    >>> sum(record.samples for record in records) == len(log)
    True
    """
    options: dict[str, Any] = {"processing": processing, "effects": effects, "blocks": blocks, "lags": lags}
    options["labels"] = labels
    chosen = processing if isinstance(processing, Processing) else processing.processing
    if chosen is None:
        raise SgprError("processing: the model was not identified, so it does not say how logs are processed")
    window = _Window(chosen)
    for piece in pieces:
        whole = window.take(piece)
        if whole is not None:
            yield record(robot, whole, counted=window.counted, **options)
    last = window.finish()
    if last is not None:
        yield record(robot, last, counted=window.counted, **options)


def read_pieces(
    path: str | os.PathLike[str], joints: Sequence[str] | None = None, *, samples: int = 50_000, **options: Any
) -> Iterator[Recording]:
    """A long Parquet log as consecutive pieces for `record_pieces`; one of them is in memory at a time.

    Parameters
    ----------
    path : str or os.PathLike
        A Parquet file with columns of numbers.
    joints : list of str, optional
        As in `sgpr.read`.
    samples : int, default 50000
        Rows of a piece.
    **options
        `columns`, `units`, `torque_constants` and `accept`, as in `sgpr.read`. Each piece is understood by itself:
        state the unit of a time whose size is to tell it.

    Returns
    -------
    iterator of Recording

    Raises
    ------
    RecordingError
        As `sgpr.read`, and if the file holds lists.

    Examples
    --------
    >>> log = sgpr.read("train.csv.gz")
    >>> log.to_dataframe().to_parquet("train.parquet")
    >>> [len(piece) for piece in sgpr.fleet.read_pieces("train.parquet", samples=2000)]
    [2000, 2000, 1001]
    """
    if samples < 1:
        raise SgprError(f"samples: got {samples}, expected at least 1 in a piece")
    for name in options:
        if name not in _OPTIONS_OF_PIECES:
            raise TypeError(f"read_pieces() has no option `{name}`; those are {', '.join(_OPTIONS_OF_PIECES)}")
    return read_parquet_pieces(path, samples, joints, **options)


class _Window:
    """A piece that waits for the beginning of the next, with the end of the one before."""

    def __init__(self, processing: Processing) -> None:
        self._processing = processing
        # Samples that are done with but still settle filters, and samples that wait.
        self._held: Recording | None = None
        self._done = 0
        # Index in the stretch between gaps of the first sample held.
        self._place = 0
        self.counted: tuple[int, int] | None = None

    def take(self, piece: Recording) -> Recording | None:
        """Adds a piece; what now can be recorded, if anything."""
        before = self._held
        self._held = piece if before is None else _joined(before, piece)
        held = self._held
        waiting = len(before) - self._done if before is not None else 0
        reach = self._reach()
        if before is None or waiting <= reach or len(piece) < reach:
            return None
        cut = len(before)
        return self._recorded(cut, min(cut + reach, len(held)), reach)

    def finish(self) -> Recording | None:
        """What is left."""
        if self._held is None or self._done >= len(self._held):
            return None
        return self._recorded(len(self._held), len(self._held), self._reach())

    def _recorded(self, cut: int, end: int, reach: int) -> Recording:
        held = self._held
        assert held is not None
        time = held.time_ns
        after = int(time[cut]) if cut < len(held) else int(time[-1]) + 1
        self.counted = (int(time[self._done]), after)
        whole = _part(held, 0, end)
        # The next piece begins at a row of the decimated equation, counted from the last gap.
        keep = max(cut - reach, 0)
        gaps = np.flatnonzero(np.diff(time[: keep + 1]) > _GAP * np.median(np.diff(time))) + 1
        start = (int(gaps[-1]), 0) if len(gaps) else (0, self._place)
        step = self._processing.decimation
        keep -= (start[1] + keep - start[0]) % step
        keep = max(keep, start[0])
        self._place = start[1] + keep - start[0]
        self._held, self._done = _part(held, keep, len(held)), cut - keep
        return whole

    def _reach(self) -> int:
        held = self._held
        assert held is not None
        rate = held.sample_rate_hz
        return len(held) if rate is None else self._processing.reach(rate)


def _joined(before: Recording, after: Recording) -> Recording:
    if before.joint_names != after.joint_names:
        raise SgprError(f"{after.source}: a piece with other joints than the one before")
    if len(before) and len(after) and after.time_ns[0] <= before.time_ns[-1]:
        raise SgprError(f"{after.source}: the piece begins before the one before it ends")
    if (before.tau is None) != (after.tau is None):
        raise SgprError(f"{after.source}: only one of two pieces has torques")
    channels = {
        name: np.concatenate([values, after.channels[name]])
        for name, values in before.channels.items()
        if name in after.channels
    }
    return Recording(
        np.concatenate([before.time_ns, after.time_ns]),
        np.concatenate([before.q, after.q]),
        tau=None if before.tau is None else np.concatenate([before.tau, after.tau]),
        joint_names=before.joint_names,
        channels=channels,
        source=after.source,
    )


def _part(log: Recording, start: int, end: int) -> Recording:
    part = slice(start, end)
    return Recording(
        log.time_ns[part],
        log.q[part],
        tau=None if log.tau is None else log.tau[part],
        joint_names=log.joint_names,
        channels={name: values[part] for name, values in log.channels.items()},
        source=log.source,
    )
