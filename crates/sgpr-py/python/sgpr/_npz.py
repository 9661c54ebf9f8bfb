"""NumPy archives: arrays by name. Nothing in them is run, and sizes are known before memory is taken."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._arrays import recording_of
from ._sgpr import Recording, RecordingError

_DEFAULT_LIMIT = 4 << 30


def read(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
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
    return recording_of(path, arrays, joints, options)


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
