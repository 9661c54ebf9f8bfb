"""MATLAB and HDF5 files: arrays by name, as in a NumPy archive, or one vector per column, as in a table."""

import struct
import zlib
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._arrays import chosen, listed, recording_of, with_unit
from ._frames import read_columns
from ._sgpr import Recording, RecordingError, SgprError

_DEFAULT_LIMIT = 4 << 30
_HDF5_BEGINNING = b"\x89HDF\r\n\x1a\n"
_MOST_ARRAYS = 10_000
# Of a MATLAB file: type of an element that is packed, and bytes that are unpacked at once.
_PACKED = 15
_PIECE = 1 << 20

Arrays = dict[str, NDArray[Any]]


def read_mat(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Reads a MATLAB file, those of version 7.3 through the HDF5 that they are."""
    with path.open("rb") as stream:
        beginning = stream.read(520)
    if _HDF5_BEGINNING in (beginning[:8], beginning[512:520]):
        return read_hdf5(path, joints, limit_bytes=limit_bytes, **options)
    try:
        scipy = import_module("scipy.io")
    except ImportError:
        raise SgprError(f"{path}: MATLAB files need SciPy: pip install sgpr[matlab]") from None
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    try:
        _require_fits(path, beginning, limit)
        content = scipy.loadmat(path, struct_as_record=False, squeeze_me=True)
    except (OSError, SgprError, MemoryError):
        raise
    except Exception as error:
        # A damaged file surfaces as whatever the parts of SciPy raise.
        raise RecordingError(f"{path}: not a MATLAB file, or damaged: {error}") from None
    found: Arrays = {}
    _collect({key: value for key, value in content.items() if not key.startswith("__")}, "", found)
    return recording_of_arrays(path, found, joints, options)


def _require_fits(path: Path, beginning: bytes, limit: int) -> None:
    """Unpacks what a MATLAB file holds, structures and objects included, as far as it fits."""
    order = {b"IM": "<", b"MI": ">"}.get(beginning[126:128])
    total = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(128)
        while order and len(tag := stream.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            end = stream.tell() + size
            unpacker = zlib.decompressobj()
            while kind == _PACKED and stream.tell() < end and (piece := stream.read(min(_PIECE, end - stream.tell()))):
                while piece and total <= limit:
                    total += len(unpacker.decompress(piece, _PIECE))
                    piece = unpacker.unconsumed_tail
            if total > limit:
                raise _too_large(path, limit)
            stream.seek(end)


def _collect(content: Mapping[str, Any], prefix: str, found: Arrays) -> None:
    """Arrays of numbers and texts, those in structures under their own names."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            _collect({field: getattr(value, field) for field in value._fieldnames}, f"{prefix}{name}.", found)
        else:
            array = np.asarray(value)
            if array.dtype.kind == "O" and array.ndim == 1 and all(isinstance(each, str) for each in array):
                array = array.astype(str)
            if array.dtype.kind in "fiubU" and len(found) < _MOST_ARRAYS:
                found[f"{prefix}{name}"] = array


def read_hdf5(
    path: Path, joints: Sequence[str] | None = None, *, limit_bytes: int | None = None, **options: Any
) -> Recording:
    """Reads an HDF5 file."""
    try:
        hdf5 = import_module("h5py")
    except ImportError:
        raise SgprError(f"{path}: HDF5 files need h5py: pip install sgpr[hdf5]") from None
    limit = _DEFAULT_LIMIT if limit_bytes is None else limit_bytes
    found: Arrays = {}
    total = 0
    try:
        with hdf5.File(path, "r") as file:
            chosen: dict[str, Any] = {}

            def visit(name: str, thing: Any) -> None:
                if isinstance(thing, hdf5.Dataset) and thing.shape is not None and len(chosen) < _MOST_ARRAYS:
                    chosen[name] = thing

            file.visititems(visit)
            for name, data in chosen.items():
                text = hdf5.check_string_dtype(data.dtype) is not None
                if not text and data.dtype.kind not in "fiub":
                    continue
                total += data.size * max(data.dtype.itemsize, 1)
                if total > limit:
                    raise _too_large(path, limit)
                # MATLAB writes columns first.
                array = np.asarray(data.asstr()[()] if text else data[()])
                of_matlab = "MATLAB_class" in data.attrs and array.ndim == 2
                said = data.attrs.get("units", data.attrs.get("unit"))
                found[with_unit(name.replace("/", "."), said)] = np.atleast_1d(
                    (array.T if of_matlab else array).squeeze()
                )
    except (SgprError, MemoryError):
        raise
    except OSError as error:
        if error.errno is not None and error.filename is not None:
            raise
        raise RecordingError(f"{path}: not an HDF5 file, or damaged: {error}") from None
    except Exception as error:
        raise RecordingError(f"{path}: not an HDF5 file, or damaged: {error}") from None
    texts = {name: array.astype(str) for name, array in found.items() if array.dtype.kind in "OS"}
    return recording_of_arrays(path, found | texts, joints, options)


def _too_large(path: Path, limit: int) -> RecordingError:
    return RecordingError(f"{path}: more than {limit} bytes of unpacked data; if that is right, raise `limit_bytes`")


def recording_of_arrays(path: Path, found: Arrays, joints: Sequence[str] | None, options: dict[str, Any]) -> Recording:
    """Of arrays with a column per joint if there are such, else of vectors with one value per sample."""
    # A number alone is a setting.
    short = _short_names({name: array for name, array in found.items() if array.size > 1 or array.dtype.kind == "U"})
    roles = chosen(path, short, options.get("columns") or {})
    position = short.get(roles["position"] or "")
    if position is not None and (position.ndim == 2 or options.get("sample_rate_hz") or roles["time"]):
        if position.ndim == 1:
            short |= {name: short[name][:, None] for key, name in roles.items() if key != "time" and name}
        return recording_of(path, short, joints, options)
    lengths = [len(array) for array in short.values() if array.ndim == 1 and array.dtype.kind in "fiub"]
    samples = max(lengths, key=lengths.count, default=0)
    tables = [max(array.shape) for array in short.values() if array.ndim == 2 and array.dtype.kind in "fiub"]
    columns = {
        name: array
        for name, array in short.items()
        if array.ndim == 1 and len(array) == samples and array.dtype.kind in "fiub"
    }
    # Vectors beside longer tables are settings: one value per joint, not per sample.
    if samples < max([2, *tables]):
        raise RecordingError(
            f"{path}: no time and positions among the arrays {listed(short)}: name them `t` and `q`, or say which "
            "they are with `columns.time` and `columns.position`"
        )
    return read_columns(columns, str(path), joints, **options)


def _short_names(found: Arrays) -> Arrays:
    """Names without the structures or groups around them, where no other array is then called the same."""
    short = [name[name.rfind(".", 0, name.find(" [") if " [" in name else None) + 1 :] for name in found]
    names = [own if short.count(own) == 1 else whole for own, whole in zip(short, found, strict=True)]
    return dict(zip(names, found.values(), strict=True))
