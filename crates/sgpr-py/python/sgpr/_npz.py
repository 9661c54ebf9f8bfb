"""NumPy archives: arrays by name. Nothing in them is run, and sizes are known before memory is taken."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._sgpr import Recording, RecordingError

_DEFAULT_LIMIT = 4 << 30

NAMES = {
    "t": ("t", "time", "time_ns"),
    "q": ("q", "position"),
    "dq": ("dq", "velocity"),
    "tau": ("tau", "torque", "effort"),
}


def read(path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None) -> Recording:
    """Reads an archive with `t`, `q` and, if logged, `dq`, `tau`, `joint_names`; other columns become channels."""
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = _Archive(path, archive, limit).read()
    except (zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise RecordingError(f"{path}: not a NumPy archive, or damaged: {error}") from None
    except OSError as error:
        if error.filename is not None:  # The file could not be opened; else an offset in it leads nowhere.
            raise
        raise RecordingError(f"{path}: not a NumPy archive, or damaged: {error}") from None
    return recording_of(path, arrays, joints)


def recording_of(path: Path, arrays: dict[str, NDArray[Any]], joints: Sequence[str] | None) -> Recording:
    """A recording of `t`, `q` and, if logged, `dq`, `tau`, `joint_names`; other columns become channels."""
    chosen = {role: _one_of(path, arrays, names) for role, names in NAMES.items()}
    for role, expected in (("t", "(N,)"), ("q", "(N, n)")):
        if chosen[role] is None:
            wanted = " or ".join(f"`{name}`" for name in NAMES[role])
            found = ", ".join(f"`{name}`" for name in arrays) or "none"
            raise RecordingError(f"{path}: no array {wanted} of shape {expected}; the arrays are {found}")
    time, position = arrays[chosen["t"] or ""], arrays[chosen["q"] or ""]
    used = {name for name in chosen.values() if name} | {"joint_names"}
    channels = {name: values for name, values in arrays.items() if name not in used and _is_channel(values, time)}
    skipped = [name for name in arrays if name not in used and name not in channels]
    try:
        recording = Recording(
            time,
            position,
            arrays[chosen["dq"]] if chosen["dq"] else None,
            arrays[chosen["tau"]] if chosen["tau"] else None,
            joint_names=_joint_names(path, arrays, position, joints),
            channels=channels,
            source=str(path),
        )
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    if skipped:
        recording = recording._from_source(str(path), ["skipped arrays: " + ", ".join(skipped)])
    return recording if joints is None else recording.select(joints)


def _one_of(path: Path, arrays: dict[str, NDArray[Any]], names: tuple[str, ...]) -> str | None:
    found = [name for name in names if name in arrays]
    if len(found) > 1:
        raise RecordingError(f"{path}: the arrays {' and '.join(found)} mean the same: leave one")
    return found[0] if found else None


def _is_channel(values: NDArray[Any], time: NDArray[Any]) -> bool:
    return values.shape == time.shape and values.dtype.kind in "fiu"


def _joint_names(
    path: Path, arrays: dict[str, NDArray[Any]], position: NDArray[Any], joints: Sequence[str] | None
) -> list[str] | None:
    """Those of the archive; else those that are asked for, if there are as many."""
    count = position.shape[1] if position.ndim == 2 else 0
    if "joint_names" in arrays:
        names = arrays["joint_names"]
        if names.dtype.kind != "U" or names.ndim != 1:
            raise RecordingError(f"{path}: joint_names: got {names.dtype} of shape {names.shape}, expected text (n,)")
        return [str(name) for name in names]
    if joints is None:
        return None
    if len(joints) != count:
        raise RecordingError(
            f"{path}: {len(joints)} joints are wanted of {count} without names: add an array `joint_names`"
        )
    return list(joints)


class _Archive:
    """The arrays of an archive, within a limit."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, limit: int) -> None:
        self.path = path
        self.archive = archive
        self.limit = limit

    def read(self) -> dict[str, NDArray[Any]]:
        members = [info for info in self.archive.infolist() if info.filename.endswith(".npy")]
        if sum(info.file_size for info in members) > self.limit:
            raise RecordingError(
                f"{self.path}: more than {self.limit} bytes of unpacked data; if that is right, raise `limit_bytes`"
            )
        return {info.filename.removesuffix(".npy"): self._array(info) for info in members}

    def _array(self, info: zipfile.ZipInfo) -> NDArray[Any]:
        """The header is believed only as far as the archive says that there are data."""
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise RecordingError(f"{self.path}: `{info.filename}` is packed as NumPy packs nothing: save it with NumPy")
        with self.archive.open(info) as stream:
            try:
                version = np.lib.format.read_magic(stream)
                readers = {
                    (1, 0): np.lib.format.read_array_header_1_0,
                    (2, 0): np.lib.format.read_array_header_2_0,
                }
                if version not in readers:
                    raise ValueError(f"version {version} of the format is not known")
                shape, fortran_order, dtype = readers[version](stream)
            except ValueError as error:
                raise RecordingError(f"{self.path}: `{info.filename}`: {error}") from None
            if dtype.hasobject:
                raise RecordingError(
                    f"{self.path}: `{info.filename}` holds Python objects, which could run code: save numbers only"
                )
            size = dtype.itemsize
            for length in shape:
                size *= length
            if size != info.file_size - stream.tell():
                raise RecordingError(
                    f"{self.path}: `{info.filename}` should hold {size} bytes for {shape}, "
                    f"there are {info.file_size - stream.tell()}"
                )
            data = stream.read()
        if len(data) != size:
            raise RecordingError(f"{self.path}: `{info.filename}` is truncated")
        return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran_order else "C")
