"""Predictions sample by sample: as a table, and as topics of an MCAP file."""

import csv
import gzip
import io
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Comparison, LogResidual, Recording, write_mcap
from .reading import Log

Array = NDArray[np.float64]

BEFORE, AFTER = "before", "after"
"""The models that `identify` and `diagnose` compare: the one given and the new one."""

STD, INTERVAL = "std", "interval_95"
"""How sure a prediction is: its standard deviation, and half its interval of 95 %."""

NANOSECONDS = 9
CHUNK = 10_000
DIGITS = "%.9g"


@dataclass(frozen=True)
class Prediction:
    """Torques at the samples of one log, `[samples, n]`."""

    path: str
    time_ns: NDArray[np.int64]
    q: Array
    dq: Array
    measured: Array
    predicted: dict[str, Array]
    left_out: int


@dataclass(frozen=True)
class Piece:
    """Other numbers than torques at the samples of a stretch, `[samples, n]`, kept like predictions."""

    source: str
    time_ns: NDArray[np.int64]
    predicted: Array


@dataclass(frozen=True)
class Pieces:
    """Such numbers in the order of a comparison's logs."""

    logs: list[Piece]


def beside(comparison: Comparison, values: Sequence[Array]) -> Pieces:
    """Numbers for the samples of a comparison's logs, to be written beside its predictions."""
    pairs = zip(comparison.logs, values, strict=True)
    return Pieces([Piece(log.source, log.time_ns, own) for log, own in pairs])


def spread_of(comparison: Comparison, spread: Sequence[Sequence[Array]]) -> dict[str, Pieces]:
    """Standard deviations and intervals of a comparison's logs."""
    return {name: beside(comparison, [own[k] for own in spread]) for k, name in enumerate((STD, INTERVAL))}


def predictions(
    logs: Sequence[Log], comparisons: Mapping[str, Comparison | Pieces], joints: Sequence[str]
) -> list[Prediction]:
    """What each model predicts at the samples of each log; the first one of `comparisons` is a comparison.

    A log that was resampled is predicted at its new samples; the predictions are brought back to its own by linear
    interpolation. Samples of stretches that are too short to be filtered are left out, and those that a log before has.
    """
    grouped = {name: residuals_by_log(logs, comparison) for name, comparison in comparisons.items()}
    result = []
    for index, log in enumerate(logs):
        pieces = {name: groups[index] for name, groups in grouped.items()}
        # All that it holds is in logs before it.
        if not any(pieces.values()):
            continue
        result.append(_at_own_samples(log, pieces, joints) if log.is_resampled else _as_compared(log, pieces))
    return result


def residuals_by_log(logs: Sequence[Log], comparison: Comparison | Pieces) -> list[list[Any]]:
    """The residuals of each log, stretch after stretch. They come in the order of the stretches that were compared."""
    remaining: list[Any] = list(comparison.logs)
    groups = []
    for log in logs:
        group: list[Any] = []
        for stretch in log.stretches:
            first, last = int(stretch.time_ns[0]), int(stretch.time_ns[-1])
            while remaining and remaining[0].source == stretch.source and first <= int(remaining[0].time_ns[0]) <= last:
                group.append(remaining.pop(0))
        groups.append(group)
    assert not remaining, "every residual belongs to a stretch of a log"
    return groups


def _as_compared(log: Log, pieces: Mapping[str, list[LogResidual]]) -> Prediction:
    first = next(iter(pieces.values()))
    time_ns = np.concatenate([piece.time_ns for piece in first])
    return Prediction(
        path=log.path,
        time_ns=time_ns,
        q=np.concatenate([piece.q for piece in first]),
        dq=np.concatenate([piece.dq for piece in first]),
        measured=np.concatenate([piece.measured for piece in first]),
        predicted={name: np.concatenate([piece.predicted for piece in group]) for name, group in pieces.items()},
        left_out=len(log.raw) - len(time_ns),
    )


def _at_own_samples(log: Log, pieces: Mapping[str, list[LogResidual]], joints: Sequence[str]) -> Prediction:
    raw = log.raw if log.raw.joint_names == list(joints) else log.raw.select(joints)
    time_ns, unique = np.unique(raw.time_ns, return_index=True)
    measured = raw.tau[unique] if raw.tau is not None else np.full((len(unique), raw.dof), np.nan)
    finite = np.isfinite(measured).all(axis=1) & np.isfinite(raw.q[unique]).all(axis=1)
    first = next(iter(pieces.values()))
    # The new samples end up to one step before the old ones.
    ends = [2 * piece.time_ns[-1] - piece.time_ns[-2] for piece in first]
    inside = [finite & (time_ns >= p.time_ns[0]) & (time_ns < end) for p, end in zip(first, ends, strict=True)]
    times = [time_ns[mask] for mask in inside]

    def join(arrays: Sequence[Array], group: Sequence[LogResidual]) -> Array:
        return np.concatenate([_interpolate(t, p.time_ns, a) for t, p, a in zip(times, group, arrays, strict=True)])

    return Prediction(
        path=log.path,
        time_ns=np.concatenate(times),
        q=join([piece.q for piece in first], first),
        dq=join([piece.dq for piece in first], first),
        measured=np.concatenate([measured[mask] for mask in inside]),
        predicted={name: join([piece.predicted for piece in group], group) for name, group in pieces.items()},
        left_out=len(log.raw) - sum(map(len, times)),
    )


def _interpolate(wanted_ns: NDArray[np.int64], time_ns: NDArray[np.int64], values: Array) -> Array:
    start = time_ns[0]
    wanted, known = (wanted_ns - start) * 1e-9, (time_ns - start) * 1e-9
    return np.column_stack([np.interp(wanted, known, column) for column in values.T])


def write_table(
    path: Path,
    rows: Sequence[Prediction],
    joints: Sequence[str],
    columns: Mapping[str, str],
    *,
    with_file: bool,
    with_measured: bool = True,
) -> None:
    """Writes a CSV file, packed if the name ends in .gz.

    Its columns are the time, then for each joint the measured torque and the predictions. The same predictions make
    the same bytes.

    - `columns`: model in the predictions -> ending of its columns
    """
    with ExitStack() as stack:
        target: Any = stack.enter_context(path.open("wb"))
        if path.suffix == ".gz":
            target = stack.enter_context(gzip.GzipFile(filename="", mode="wb", fileobj=target, mtime=0))
        text = stack.enter_context(io.TextIOWrapper(target, encoding="utf-8", newline=""))
        endings = [*(["measured"] if with_measured else []), *columns.values()]
        header = ["t", *(f"{joint}_{ending}" for joint in joints for ending in endings)]
        text.write(_line(["file", *header] if with_file else header))
        for row in rows:
            torques = [*([row.measured] if with_measured else []), *(row.predicted[model] for model in columns)]
            values = np.stack(torques, axis=2).reshape(len(row.time_ns), -1)
            name = _line([row.path]).rstrip("\n") + "," if with_file else ""
            line = f"{name.replace('%', '%%')}%s,{','.join([DIGITS] * values.shape[1])}\n"
            for start in range(0, len(values), CHUNK):
                chunk = slice(start, start + CHUNK)
                moments = map(decimal_seconds, row.time_ns[chunk].tolist())
                numbers = values[chunk].tolist()
                text.writelines(line % (moment, *each) for moment, each in zip(moments, numbers, strict=True))


def decimal_seconds(nanoseconds: int) -> str:
    """Seconds, every digit of them: 60.004, 1700000000.123456789."""
    sign = "-" if nanoseconds < 0 else ""
    whole, part = divmod(abs(nanoseconds), 10**NANOSECONDS)
    return f"{sign}{whole}.{part:0{NANOSECONDS}d}".rstrip("0").rstrip(".")


def write_before_and_after(path: Path, rows: Sequence[Prediction], joints: Sequence[str]) -> None:
    """Writes what the models before and after predict for logs: `file, t`, then three columns per joint."""
    write_table(path, rows, joints, {BEFORE: BEFORE, AFTER: AFTER}, with_file=True)


def left_out(rows: Sequence[Prediction]) -> dict[str, int]:
    """Samples without a prediction, by log; only logs that have some."""
    return {row.path: row.left_out for row in rows if row.left_out}


def write_topics(
    path: Path, rows: Sequence[Prediction], joints: Sequence[str], model: str, *, with_measured: bool = True
) -> None:
    """Measured, predicted and residual torque of logs as topics of joint states.

    With several logs, the topics of each carry its number: /log_2/measured.
    """
    topics = {}
    for number, row in enumerate(rows, start=1):
        prefix = f"/log_{number}" if len(rows) > 1 else ""
        predicted = row.predicted[model]
        torques = {"predicted": predicted}
        if with_measured:
            torques = {"measured": row.measured, **torques, "residual": row.measured - predicted}
        for name, torque in torques.items():
            topics[f"{prefix}/{name}"] = Recording(
                row.time_ns, row.q, row.dq, torque, joint_names=list(joints), source=row.path
            )
    write_mcap(path, topics)


def _line(cells: Sequence[str]) -> str:
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()
