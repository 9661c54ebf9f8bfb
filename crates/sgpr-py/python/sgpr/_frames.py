"""Tables in memory: pandas and polars frames, understood by the names of their columns as those of a CSV file."""

import csv
import tempfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._sgpr import Recording, RecordingError, SgprError, read_csv

SOURCE = "table"


def is_frame(value: object) -> bool:
    """Whether a value is a frame of pandas or polars."""
    kind = type(value)
    return kind.__name__ == "DataFrame" and kind.__module__.partition(".")[0] in ("pandas", "polars")


def read(frame: Any, joints: Sequence[str] | None = None, **options: Any) -> Recording:
    """Goes through a temporary CSV file, every number exact: one set of rules for all tables."""
    if not is_frame(frame):
        raise TypeError(f"frame: got {type(frame).__name__}, expected a DataFrame of pandas or polars")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table.csv"
        if type(frame).__module__.startswith("polars"):
            frame.write_csv(copy)
        else:
            _with_time_column(frame).to_csv(copy, index=False)
        try:
            recording = read_csv(copy, joints, **options)
        except RecordingError as error:
            raise type(error)(str(error).replace(str(copy), SOURCE)) from None
    return recording._from_source(SOURCE, [])


def read_columns(
    table: Mapping[str, NDArray[Any]], source: str, joints: Sequence[str] | None, **options: Any
) -> Recording:
    """The same of columns of numbers, all of one length."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table.csv"
        with copy.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(table)
            # repr of a float is exact.
            writer.writerows(zip(*(map(repr, values.tolist()) for values in table.values()), strict=True))
        try:
            recording = read_csv(copy, joints, **options)
        except RecordingError as error:
            raise type(error)(str(error).replace(str(copy), source)) from None
    return recording._from_source(source, [])


def _with_time_column(frame: Any) -> Any:
    """A pandas frame whose index, if it is a time or has the name of one, is a column; durations are seconds."""
    kind = type(frame.index).__name__
    if frame.index.name is not None or kind in ("DatetimeIndex", "TimedeltaIndex"):
        name = frame.index.name or "t"
        if name not in frame.columns:
            frame = frame.rename_axis(name).reset_index()
    durations = [name for name in frame.columns if frame[name].dtype.kind == "m"]
    if durations:
        seconds = {
            name: [_seconds(int(ns)) for ns in frame[name].to_numpy("timedelta64[ns]").astype(np.int64)]
            for name in durations
        }
        frame = frame.assign(**seconds)
    return frame


def _seconds(nanoseconds: int) -> str:
    sign = "-" if nanoseconds < 0 else ""
    whole, part = divmod(abs(nanoseconds), 10**9)
    return f"{sign}{whole}.{part:09d}"


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
