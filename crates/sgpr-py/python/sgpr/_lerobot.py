"""Episodes of LeRobot data sets: Parquet files with a list of numbers per sample, and JSON that names them."""

import json
import re
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._frames import read_columns
from ._parquet import is_list, rows_of
from ._sgpr import Recording, RecordingError, SgprError

_DEFAULT_LIMIT = 4 << 30
_MOST_JSON = 16 << 20

QUANTITIES = {
    "observation.state": "position",
    "observation.position": "position",
    "observation.velocity": "velocity",
    "observation.effort": "torque",
    "observation.torque": "torque",
    "observation.current": "current",
}
"""Feature -> what its numbers are, unless their names say otherwise."""

SAME_TIME = 1e-4
"""Stamps that are this near to equal steps, s, are equal steps: they are kept as numbers of 32 bits."""


class Episode(NamedTuple):
    """A path in a data set.

    - `root`: the folder with `meta/info.json`
    - `number`: the episode, if the path says which
    - `file`: the file that holds it, if the path is one
    """

    root: Path
    number: int | None
    file: Path | None


def episode_of(path: Path) -> Episode | None:
    """What a path is in a data set: its folder, `FOLDER/episode_3`, or a Parquet file of it; None elsewhere."""
    if _is_root(path):
        return Episode(path, None, None)
    number = re.fullmatch(r"episode_(\d{1,9})", path.name)
    if number and not path.exists() and _is_root(path.parent):
        return Episode(path.parent, int(number[1]), None)
    if path.suffix == ".parquet" and path.is_file():
        root = next((folder for folder in path.resolve().parents[:4] if _is_root(folder)), None)
        return None if root is None else Episode(root, None, path)
    return None


def _is_root(folder: Path) -> bool:
    return (folder / "meta" / "info.json").is_file()


def read(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Reads one episode through the reader of tables."""
    found = episode_of(path)
    assert found is not None, "asked before"
    info = _info(found.root)
    rows, skipped = _rows(path, found, _DEFAULT_LIMIT if limit_bytes is None else limit_bytes)
    columns: dict[str, NDArray[Any]] = {}
    if "sample_rate_hz" not in options:
        columns["timestamp_s"] = _time(path, rows, info)
    for feature, values in rows.items():
        if values.ndim == 2:
            names = _names(info, feature, values.shape[1])
            columns |= {_column(feature, name): values[:, k] for k, name in enumerate(names)}
    recording = read_columns(columns, str(path), joints, **options)
    notes = ["skipped columns that hold no rows of numbers: " + ", ".join(skipped)] if skipped else []
    return recording._from_source(str(path), notes)


def _info(root: Path) -> dict[str, Any]:
    place = root / "meta" / "info.json"
    try:
        if place.stat().st_size > _MOST_JSON:
            raise RecordingError(f"{place}: larger than any description of a data set")
        info = json.loads(place.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"{place}: not JSON: {error}") from None
    if not isinstance(info, dict) or not isinstance(info.get("features", {}), dict):
        raise RecordingError(f"{place}: expected `features`, one entry for each column")
    return info


def _rows(path: Path, wanted: Episode, limit: int) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Numbers of one episode by feature, and what was skipped."""
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise SgprError(f"{path}: LeRobot data sets need PyArrow: pip install sgpr[parquet]") from None
    places: dict[int, Path] = {}
    try:
        for place in _files(wanted):
            with parquet.ParquetFile(place) as file:
                places |= dict.fromkeys(_episodes(place, file), place)
            if wanted.number in places:
                break
        number = _chosen(path, wanted, places)
        with parquet.ParquetFile(places[number]) as file:
            kinds = {field.name: field.type for field in file.schema_arrow}
            known = [name for name, kind in kinds.items() if _is_numeric(arrow.types, kind)]
            unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups))
            if unpacked > limit:
                raise RecordingError(
                    f"{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes`"
                )
            table = file.read(columns=known)
        if "episode_index" in known:
            table = table.filter(import_module("pyarrow.compute").equal(table["episode_index"], number))
    except arrow.ArrowException as error:
        raise RecordingError(f"{path}: not a LeRobot data set, or damaged: {error}") from None
    return {name: rows_of(path, name, table[name]) for name in known}, [name for name in kinds if name not in known]


def _chosen(path: Path, wanted: Episode, places: dict[int, Path]) -> int:
    """The episode that the path means."""
    if wanted.number in places:
        return wanted.number
    if wanted.number is None and len(places) == 1:
        return next(iter(places))
    if not places:
        raise RecordingError(f"{path}: a LeRobot data set without Parquet files in its folder `data`")
    first, last = wanted.root / f"episode_{min(places)}", wanted.root / f"episode_{max(places)}"
    what = f"{len(places)} episodes" if wanted.number is None else f"there is no episode {wanted.number}"
    raise RecordingError(f"{path}: {what}; each is a log of its own, from {first} to {last}")


def _files(wanted: Episode) -> Iterator[Path]:
    """Files that may hold an episode, the likeliest first."""
    if wanted.file is not None:
        yield wanted.file
        return
    files = sorted((wanted.root / "data").rglob("*.parquet"))
    own = f"episode_{wanted.number:06d}" if wanted.number is not None else None
    yield from sorted(files, key=lambda place: place.stem != own)


def _episodes(place: Path, file: Any) -> list[int]:
    """The episodes of a file, by their column or by its name."""
    if "episode_index" in file.schema_arrow.names:
        return [int(number) for number in file.read(columns=["episode_index"])["episode_index"].unique().to_pylist()]
    named = re.search(r"(\d+)$", place.stem)
    return [int(named[1]) if named else 0]


def _is_numeric(types: Any, kind: Any) -> bool:
    return is_list(types, kind) or bool(types.is_integer(kind) or types.is_floating(kind))


def _time(path: Path, rows: dict[str, NDArray[Any]], info: dict[str, Any]) -> NDArray[Any]:
    stamps, frames, rate = rows.get("timestamp"), rows.get("frame_index"), info.get("fps")
    even: NDArray[Any] | None = None
    if frames is not None and frames.ndim == 1 and isinstance(rate, int | float) and rate > 0:
        even = frames / rate
    if stamps is None:
        if even is None:
            raise RecordingError(f"{path}: neither `timestamp` nor `frame_index` with `fps`; give `sample_rate_hz`")
        return even
    own = stamps[:, 0] if stamps.ndim > 1 else stamps
    return own if even is None or _differ(own, even) else even


def _differ(stamps: NDArray[Any], even: NDArray[Any]) -> bool:
    return len(stamps) > 0 and float(np.abs(stamps - stamps[0] - even + even[0]).max()) > SAME_TIME


def _names(info: dict[str, Any], feature: str, count: int) -> list[str]:
    """The names of the numbers of a feature: a list, or the only list in a table; else numbers."""
    found = info.get("features", {}).get(feature)
    names = found.get("names") if isinstance(found, dict) else None
    if isinstance(names, dict):
        names = next(iter(names.values()), None) if len(names) == 1 else list(names)
    if isinstance(names, list) and len(names) == count and all(isinstance(name, str) for name in names):
        return names if len(set(names)) == count else [f"{name} {k + 1}" for k, name in enumerate(names)]
    return [f"{k + 1}" for k in range(count)]


def _column(feature: str, name: str) -> str:
    """What a table would call it: `shoulder_pan.pos` as it is, `shoulder_pan` with what the feature holds."""
    quantity = QUANTITIES.get(feature)
    if quantity is None:
        return f"{feature} command {name}"
    says = re.search(r"[._/](pos|position|vel|velocity|tau|torque|effort|current)$", name)
    return name if says else f"{name}_{quantity}"
