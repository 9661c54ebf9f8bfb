"""Records in Parquet files: one row per record, the numbers of its factors as one list."""

import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from .._files import make_folder_of
from .._sgpr import Record, SgprError

FORMAT = "sgpr records"
_DEFAULT_LIMIT = 4 << 30
_ROWS_AT_ONCE = 64


def save_records(path: str | os.PathLike[str], records: Iterable[Record]) -> None:
    """Write records to one Parquet file, which is complete or not there. Needs `pip install sgpr[fleet]`.

    Columns besides `head` (JSON) and `factors` (numbers) are for people and queries: `source`, `robot` (fingerprint),
    `content_hash`, `start_time`, `end_time` (ns), `samples`, `rows`, and `labels` (JSON).

    Parameters
    ----------
    path : path
        Of the file; its folder is made if need be, an older file is replaced.
    records : iterable of Record
        Written as they come: the memory that is needed does not grow with their number.

    Raises
    ------
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    >>> sgpr.fleet.save_records("records.parquet", [sgpr.record(robot, log)])
    >>> [record.source for record in sgpr.fleet.load_records("records.parquet")]
    ['train.csv.gz']
    """
    arrow, parquet = _arrow(path)
    schema = arrow.schema(
        [
            ("source", arrow.string()),
            ("robot", arrow.string()),
            ("content_hash", arrow.string()),
            ("start_time", arrow.int64()),
            ("end_time", arrow.int64()),
            ("samples", arrow.int64()),
            ("rows", arrow.int64()),
            ("labels", arrow.string()),
            ("head", arrow.string()),
            ("factors", arrow.large_list(arrow.float64())),
        ],
        metadata={"format": FORMAT},
    )
    make_folder_of(path)
    place = Path(path)
    handle, beside = tempfile.mkstemp(dir=place.parent, prefix=f".{place.name}-")
    os.close(handle)
    try:
        # Numbers of factors do not repeat: dictionaries and byte streams would only cost time.
        writer = parquet.ParquetWriter(beside, schema, compression="zstd", use_dictionary=False)
        with writer:
            for part in _parts(records, _ROWS_AT_ONCE):
                writer.write_table(arrow.Table.from_pylist([_row(record) for record in part], schema=schema))
        os.chmod(beside, 0o666 & ~_umask())
        os.replace(beside, place)
    finally:
        Path(beside).unlink(missing_ok=True)


def load_records(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], *, limit_bytes: int = _DEFAULT_LIMIT
) -> list[Record]:
    """Read the records of one file or of several. Safe with files of strangers: nothing in them is run.

    Parameters
    ----------
    path : path, or list of path
        Files that `save_records` or `sgpr fleet run` wrote; a folder stands for all `.parquet` files in it.
    limit_bytes : int
        Files whose records would take more memory are refused.

    Returns
    -------
    list of Record

    Raises
    ------
    SgprError
        If a file holds no records, is damaged, or too large.
    OSError
        If a file cannot be read.
    """
    return list(iterate_records(path, limit_bytes=limit_bytes))


def iterate_records(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], *, limit_bytes: int = _DEFAULT_LIMIT
) -> Iterator[Record]:
    """As `load_records`, one after the other: memory holds a few of them."""
    given = [path] if isinstance(path, str | os.PathLike) else list(path)
    for one in given:
        place = Path(one)
        files = sorted(place.rglob("*.parquet")) if place.is_dir() else [place]
        if not files:
            raise SgprError(f"{place}: a folder without a .parquet file")
        for file in files:
            yield from _of_file(file, limit_bytes)


def list_records(files: Iterable[Path]) -> Iterator[dict[str, Any]]:
    """`source`, `content_hash` and `labels` of the records in files, without their numbers."""
    for path in files:
        arrow, parquet = _arrow(path)
        try:
            rows = parquet.read_table(path, columns=["source", "content_hash", "labels"]).to_pylist()
        except arrow.ArrowException as error:
            raise SgprError(f"{path}: not a file of records, or damaged: {error}") from None
        for row in rows:
            yield {**row, "labels": json.loads(row["labels"])}


def _of_file(path: Path, limit_bytes: int) -> Iterator[Record]:
    arrow, parquet = _arrow(path)
    if not path.exists():
        raise FileNotFoundError(2, os.strerror(2), str(path))
    try:
        with parquet.ParquetFile(path) as file:
            names = set(file.schema_arrow.names)
            if not {"head", "factors"} <= names:
                raise SgprError(f"{path}: holds no records: the columns `head` and `factors` are missing")
            unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups))
            if unpacked > limit_bytes:
                raise SgprError(
                    f"{path}: {unpacked} bytes of records are more than {limit_bytes}; if that is right, raise "
                    "`limit_bytes`"
                )
            row = 0
            for batch in file.iter_batches(batch_size=_ROWS_AT_ONCE, columns=["head", "factors"]):
                heads, factors = batch.column("head"), batch.column("factors")
                for head, numbers in zip(heads, factors, strict=True):
                    yield _record(head, numbers, f"{path}, row {row}")
                    row += 1
    except (arrow.ArrowException, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise SgprError(f"{path}: not a Parquet file, or damaged: {error}") from None


def _record(head: Any, numbers: Any, where: str) -> Record:
    try:
        values = numbers.values.to_numpy(zero_copy_only=False)
        return Record.from_parts(head.as_py(), values)
    except (SgprError, TypeError, AttributeError) as error:
        raise SgprError(f"{where}: {error}") from None


def _row(record: Record) -> dict[str, Any]:
    head, numbers = record.to_parts()
    return {
        "source": record.source,
        "robot": record.robot,
        "content_hash": record.content_hash,
        "start_time": record.start_time,
        "end_time": record.end_time,
        "samples": record.samples,
        "rows": record.rows,
        "labels": json.dumps(record.labels, sort_keys=True),
        "head": head,
        "factors": numbers,
    }


def _parts(records: Iterable[Record], size: int) -> Iterator[list[Record]]:
    part: list[Record] = []
    for record in records:
        part.append(record)
        if len(part) == size:
            yield part
            part = []
    if part:
        yield part


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _arrow(path: str | os.PathLike[str]) -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise SgprError(f"{path}: files of records need PyArrow: pip install sgpr[fleet]") from None
