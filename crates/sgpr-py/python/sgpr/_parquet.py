"""Parquet files: columns of numbers, understood by their names as those of a CSV file, or lists, one per sample."""

import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._containers import recording_of_arrays
from ._sgpr import Recording, RecordingError, SgprError, read_csv

_DEFAULT_LIMIT = 4 << 30


def read(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Goes through a temporary CSV file, every number exact: one set of rules for all tables."""
    try:
        arrow, arrow_csv, arrow_parquet = (
            import_module(name) for name in ("pyarrow", "pyarrow.csv", "pyarrow.parquet")
        )
    except ImportError:
        raise SgprError(f"{path}: Parquet files need PyArrow: pip install sgpr[parquet]") from None
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    try:
        with arrow_parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
            lists = [field.name for field in schema if is_list(arrow.types, field.type)]
            wanted = [field.name for field in schema if field.name in lists or _is_number(arrow.types, field.type)]
            skipped = [field.name for field in schema if field.name not in wanted]
            rows = file.metadata.num_rows
            unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups))
            if max(8 * rows * len(wanted), unpacked) > limit:
                raise RecordingError(
                    f"{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes`"
                )
            table = file.read(columns=wanted)
    except arrow.ArrowException as error:
        raise RecordingError(f"{path}: not a Parquet file, or damaged: {error}") from None
    notes = ["skipped columns that hold no numbers: " + ", ".join(skipped)] if skipped else []
    if lists:
        arrays = {name: rows_of(path, name, table[name]) for name in lists}
        arrays |= dict(_numbers(arrow, name, table[name]) for name in wanted if name not in lists)
        return recording_of_arrays(path, arrays, joints, {**options, "limit_bytes": 4 * limit})._from_source(
            str(path), notes
        )
    table = arrow.table({name: _plain(arrow, table[name]) for name in wanted})
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table.csv"
        arrow_csv.write_csv(table, copy, arrow_csv.WriteOptions(quoting_style="none", quoting_header="needed"))
        try:
            # The text of a number is up to three times as long as the number.
            recording = read_csv(copy, joints, limit_bytes=4 * limit, **options)
        except RecordingError as error:
            raise type(error)(str(error).replace(str(copy), str(path))) from None
    return recording._from_source(str(path), notes)


def _is_number(types: Any, kind: Any) -> bool:
    tests = (types.is_integer, types.is_floating, types.is_boolean, types.is_decimal, types.is_timestamp)
    return any(test(kind) for test in tests) or bool(types.is_duration(kind))


def is_list(types: Any, kind: Any) -> bool:
    """Whether a column holds a list of numbers in each row."""
    if not (types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind)):
        return False
    return bool(types.is_integer(kind.value_type) or types.is_floating(kind.value_type))


def rows_of(path: Path, name: str, column: Any) -> NDArray[np.float64]:
    """A column of numbers or of lists of one length."""
    try:
        return np.array(column.to_pylist(), dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(f"{path}: `{name}` has samples of unequal length, or without numbers") from None


def _numbers(arrow: Any, name: str, column: Any) -> tuple[str, NDArray[Any]]:
    """A column of numbers under its name; a time in nanoseconds, which its name then says."""
    kind = column.type
    if arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        exact = arrow.timestamp("ns") if arrow.types.is_timestamp(kind) else arrow.duration("ns")
        return f"{name}_ns", np.asarray(column.cast(exact).cast(arrow.int64()).to_numpy())
    return name, np.asarray(_plain(arrow, column).to_numpy())


def _plain(arrow: Any, column: Any) -> Any:
    """What a CSV file can hold: numbers as they are, times as decimal seconds, exact."""
    types, kind = arrow.types, column.type
    if types.is_timestamp(kind) or types.is_duration(kind):
        exact = arrow.timestamp("ns") if types.is_timestamp(kind) else arrow.duration("ns")
        nanoseconds = column.cast(exact).cast(arrow.int64()).cast(arrow.decimal128(19, 0))
        billionth = arrow.scalar("0.000000001").cast(arrow.decimal128(10, 9))
        return import_module("pyarrow.compute").multiply(nanoseconds, billionth).cast(arrow.string())
    if types.is_boolean(kind):
        return column.cast(arrow.int8())
    if types.is_floating(kind) or types.is_decimal(kind):
        return column.cast(arrow.float64())
    return column
