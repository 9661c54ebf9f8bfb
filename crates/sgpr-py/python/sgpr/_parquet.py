"""Parquet files: columns of numbers, understood by their names as those of a CSV file, or lists, one per sample."""

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._containers import recording_of_arrays
from ._frames import Column, plain
from ._sgpr import Recording, RecordingError, SgprError, read_columns

_DEFAULT_LIMIT = 4 << 30


def read(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Reads the columns of numbers as arrays, by the rules of all tables."""
    arrow, arrow_parquet = _packages(path)
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    try:
        with arrow_parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
            lists, wanted = _columns(arrow, schema)
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
    recording = _recording(arrow, path, table, joints, {**options, "limit_bytes": 4 * limit})
    return recording._from_source(str(path), notes) if notes else recording


def read_pieces(path: Path, joints: Sequence[str] | None, samples: int, options: dict[str, Any]) -> Iterator[Recording]:
    """The rows of a file in pieces of so many, one in memory at a time."""
    arrow, arrow_parquet = _packages(path)
    try:
        with arrow_parquet.ParquetFile(path) as file:
            lists, wanted = _columns(arrow, file.schema_arrow)
            if lists:
                raise RecordingError(f"{path}: holds lists ({', '.join(lists)}), which are read whole: sgpr.read")
            for batch in file.iter_batches(batch_size=samples, columns=wanted):
                yield _recording(arrow, path, arrow.Table.from_batches([batch]), joints, options)
    except arrow.ArrowException as error:
        raise RecordingError(f"{path}: not a Parquet file, or damaged: {error}") from None


def _columns(arrow: Any, schema: Any) -> tuple[list[str], list[str]]:
    """Columns of lists of numbers, and all that hold numbers."""
    lists = [field.name for field in schema if is_list(arrow.types, field.type)]
    return lists, [field.name for field in schema if field.name in lists or _is_number(arrow.types, field.type)]


def _packages(path: Path) -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise SgprError(f"{path}: Parquet files need PyArrow: pip install sgpr[parquet]") from None


def _recording(arrow: Any, path: Path, table: Any, joints: Sequence[str] | None, options: dict[str, Any]) -> Recording:
    try:
        values = [_values(arrow, column) for column in table.itercolumns()]
    except arrow.ArrowException as error:
        raise RecordingError(f"{path}: {error}") from None
    return read_columns(str(path), table.column_names, values, joints, **options)


def _values(arrow: Any, column: Any) -> Column:
    """A column as the core takes it; whole numbers and times with holes as text, in which both are exact."""
    kind = column.type
    is_time = arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind)
    if column.null_count and not (arrow.types.is_floating(kind) or arrow.types.is_decimal(kind)):
        return [text or "" for text in _plain(arrow, column).cast(arrow.string()).to_pylist()]
    if is_time:
        return plain(_nanoseconds(arrow, column).to_numpy().view("m8[ns]"))
    return plain(np.asarray(_plain(arrow, column).to_numpy()))


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
    compute = import_module("pyarrow.compute")
    try:
        if is_list(import_module("pyarrow.types"), column.type) and len(column) and not column.null_count:
            lengths = compute.list_value_length(column)
            if compute.min(lengths) == compute.max(lengths):
                flat = compute.list_flatten(column).cast("float64").to_numpy()
                return np.ascontiguousarray(flat).reshape(len(column), -1)
        return np.array(column.to_pylist(), dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(f"{path}: `{name}` has samples of unequal length, or without numbers") from None


def _numbers(arrow: Any, name: str, column: Any) -> tuple[str, NDArray[Any]]:
    """A column of numbers under its name; a time in nanoseconds, which its name then says."""
    kind = column.type
    if arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        return f"{name}_ns", np.asarray(_nanoseconds(arrow, column).to_numpy())
    return name, np.asarray(_plain(arrow, column).to_numpy())


def _nanoseconds(arrow: Any, column: Any) -> Any:
    """Times as whole ns."""
    exact = arrow.timestamp("ns") if arrow.types.is_timestamp(column.type) else arrow.duration("ns")
    return column.cast(exact).cast(arrow.int64())


def _plain(arrow: Any, column: Any) -> Any:
    """Numbers as they are, times as the text of decimal seconds, exact."""
    types, kind = arrow.types, column.type
    if types.is_timestamp(kind) or types.is_duration(kind):
        nanoseconds = _nanoseconds(arrow, column).cast(arrow.decimal128(19, 0))
        billionth = arrow.scalar("0.000000001").cast(arrow.decimal128(10, 9))
        return import_module("pyarrow.compute").multiply(nanoseconds, billionth).cast(arrow.string())
    if types.is_boolean(kind):
        return column.cast(arrow.int8())
    if types.is_floating(kind) or types.is_decimal(kind):
        return column.cast(arrow.float64())
    return column
