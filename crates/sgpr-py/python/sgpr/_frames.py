"""Tables in memory: pandas and polars frames, understood by the names of their columns as those of a CSV file."""

import csv
import io
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._sgpr import Recording, RecordingError, SgprError, read_columns

SOURCE = "table"

Column = NDArray[Any] | list[str]


def is_frame(value: object) -> bool:
    """Whether a value is a frame of pandas or polars."""
    kind = type(value)
    return kind.__name__ == "DataFrame" and kind.__module__.partition(".")[0] in ("pandas", "polars")


def read(frame: Any, joints: Sequence[str] | None = None, **options: Any) -> Recording:
    """Numbers and times go as they are, the rest as the text that a CSV file of it would have."""
    if not is_frame(frame):
        raise TypeError(f"frame: got {type(frame).__name__}, expected a DataFrame of pandas or polars")
    of_polars = type(frame).__module__.startswith("polars")
    if not of_polars:
        frame = _with_time_column(frame)
    names = [str(name) for name in frame.columns]
    series = [frame[name] if of_polars else frame.iloc[:, k] for k, name in enumerate(frame.columns)]
    values = [_of_polars(column) if of_polars else _of_pandas(column) for column in series]
    return read_columns(SOURCE, names, values, joints, **options)


def plain(values: NDArray[Any]) -> Column:
    """What the core takes for these values: float64, int64, timedelta64[ns] or datetime64[ns], or else text."""
    kind = values.dtype.kind
    if kind == "f":
        return np.ascontiguousarray(values, np.float64)
    if kind in "bi" or (kind == "u" and int(values.max(initial=0)) <= np.iinfo(np.int64).max):
        return np.ascontiguousarray(values, np.int64)
    if kind in "mM":
        return np.ascontiguousarray(values, f"{kind}8[ns]")
    # repr of a number is exact.
    return [repr(value) for value in values.tolist()]


def _of_pandas(series: Any) -> Column:
    kind, whole = getattr(series.dtype, "kind", "O"), not series.hasnans
    if kind == "f":
        return _shortest(series.to_numpy(f"f{series.dtype.itemsize}", na_value=np.nan))
    if kind == "m" or (kind in "biuM" and whole):
        numpy_kind = {"b": "bool", "m": "m8[ns]", "M": "M8[ns]"}.get(kind, f"{kind}{series.dtype.itemsize}")
        return plain(series.to_numpy(numpy_kind))
    return _cells(series.to_csv(index=False, header=False))


def _of_polars(series: Any) -> Column:
    kind, whole = series.dtype, series.null_count() == 0
    if kind.is_float():
        return _shortest(series.to_numpy())
    if whole and (kind.is_integer() or str(kind) == "Boolean"):
        return plain(series.to_numpy())
    if whole and str(kind).startswith("Datetime"):
        return np.ascontiguousarray(series.dt.epoch("ns").to_numpy()).view("M8[ns]")
    return _cells(series.to_frame().write_csv(include_header=False))


def _shortest(values: NDArray[Any]) -> NDArray[np.float64]:
    """The shortest decimals of the numbers, as text has them: 0.1 in 32 bits is 0.1."""
    return np.ascontiguousarray(values if values.dtype == np.float64 else values.astype(str), np.float64)


def _cells(text: str) -> list[str]:
    """The cells of a table of one column."""
    try:
        return [row[0] if row else "" for row in csv.reader(io.StringIO(text, newline=""))]
    except csv.Error as error:
        raise RecordingError(f"{SOURCE}: a column of text cannot be read: {error}") from None


def _with_time_column(frame: Any) -> Any:
    """A pandas frame whose index, if it is a time or has the name of one, is a column."""
    kind = type(frame.index).__name__
    if frame.index.name is not None or kind in ("DatetimeIndex", "TimedeltaIndex"):
        name = frame.index.name or "t"
        if name not in frame.columns:
            return frame.rename_axis(name).reset_index()
    return frame


def to_dataframe(recording: Recording) -> Any:
    """Time, joints and channels of a recording as a pandas frame."""
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise SgprError("a DataFrame needs pandas: pip install pandas") from None
    columns: dict[str, Any] = {"t_s": recording.t}
    for quantity, values in (("position", recording.q), ("velocity", recording.dq), ("torque", recording.tau)):
        if values is not None:
            columns |= {f"{name}_{quantity}": values[:, k] for k, name in enumerate(recording.joint_names)}
    channels = {name: values for name, values in recording.channels.items() if name not in columns}
    return pandas.DataFrame({**columns, **channels})
