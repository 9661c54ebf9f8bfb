"""Parquet files: columns of numbers, understood by their names as those of a CSV file."""

import tempfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

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
            skipped = [field.name for field in schema if not _is_number(arrow.types, field.type)]
            wanted = [field.name for field in schema if _is_number(arrow.types, field.type)]
            rows = file.metadata.num_rows
            unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups))
            if max(8 * rows * len(wanted), unpacked) > limit:
                raise RecordingError(
                    f"{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes`"
                )
            table = file.read(columns=wanted)
    except arrow.ArrowException as error:
        raise RecordingError(f"{path}: not a Parquet file, or damaged: {error}") from None
    table = arrow.table({name: _plain(arrow, table[name]) for name in wanted})
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table.csv"
        arrow_csv.write_csv(table, copy, arrow_csv.WriteOptions(quoting_style="none", quoting_header="needed"))
        try:
            # The text of a number is up to three times as long as the number.
            recording = read_csv(copy, joints, limit_bytes=4 * limit, **options)
        except RecordingError as error:
            raise type(error)(str(error).replace(str(copy), str(path))) from None
    notes = ["skipped columns that hold no numbers: " + ", ".join(skipped)] if skipped else []
    return recording._from_source(str(path), notes)


def _is_number(types: Any, kind: Any) -> bool:
    tests = (types.is_integer, types.is_floating, types.is_boolean, types.is_decimal, types.is_timestamp)
    return any(test(kind) for test in tests) or bool(types.is_duration(kind))


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
