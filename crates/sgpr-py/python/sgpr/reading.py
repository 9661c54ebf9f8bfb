"""Logs of any format: `read` looks at the file and hands it to the reader that understands it."""

import errno
import os
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from . import _bags, _containers, _frames, _lerobot, _npz, _parquet
from ._sgpr import Recording, RecordingError, read_csv, read_mcap


class _Format(NamedTuple):
    """A kind of file, its reader, and the options that apply to it."""

    name: str
    read: Callable[..., Recording]
    options: frozenset[str]


_TABLE_OPTIONS = frozenset(
    {"columns", "units", "torque_constants", "rows", "seconds", "sample_rate_hz", "limit_bytes"},
)
_TOPIC_OPTIONS = frozenset({"logged_names", "topics", "clock", "limit_bytes"})

_CSV = _Format("CSV", read_csv, _TABLE_OPTIONS)
_PARQUET = _Format("Parquet", _parquet.read, _TABLE_OPTIONS)
_MCAP = _Format("MCAP", read_mcap, _TOPIC_OPTIONS | {"recover"})
_BAG = _Format("ROS bag", _bags.read, _TOPIC_OPTIONS)
_NPZ = _Format("NumPy archive", _npz.read, _TABLE_OPTIONS)
_LEROBOT = _Format("LeRobot", _lerobot.read, _TABLE_OPTIONS)
_MAT = _Format("MATLAB", _containers.read_mat, _TABLE_OPTIONS)
_HDF5 = _Format("HDF5", _containers.read_hdf5, _TABLE_OPTIONS)

_SUFFIXES = {
    ".csv": _CSV,
    ".csv.gz": _CSV,
    ".txt": _CSV,
    ".txt.gz": _CSV,
    ".tsv": _CSV,
    ".tsv.gz": _CSV,
    ".parquet": _PARQUET,
    ".mcap": _MCAP,
    ".bag": _BAG,
    ".db3": _BAG,
    ".npz": _NPZ,
    ".mat": _MAT,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
}

_BEGINNINGS = {
    b"\x89MCAP": _MCAP,
    b"#ROSBAG V2": _BAG,
    b"SQLite format 3\0": _BAG,
    b"PAR1": _PARQUET,
    b"MATLAB 5.0 MAT": _MAT,
    b"\x89HDF\r\n\x1a\n": _HDF5,
    b"\x1f\x8b": _CSV,
}


def read(path: str | os.PathLike[str] | Any, joints: Sequence[str] | None = None, **options: Any) -> Recording:
    """Reads a log: CSV, MCAP, ROS bag, NumPy archive, Parquet, MATLAB or HDF5 file, LeRobot episode, or a DataFrame.

    Parameters
    ----------
    path : str or os.PathLike, or DataFrame
        A DataFrame of pandas or polars is read by the names of its columns, as a CSV file. A file by its name: `.csv`,
        `.csv.gz`, `.txt`, `.tsv` as in `read_csv`; `.mcap` as in `read_mcap`; `.bag` (ROS 1), `.db3` or the folder of a
        ROS 2 bag with `sensor_msgs/JointState` (needs `pip install sgpr[bags]`); `.npz` with the arrays `t`, `q`, `dq`,
        `tau` (or `time`, `position`, `velocity`, `torque` or `effort`) and `joint_names`; `.mat` (needs
        `pip install sgpr[matlab]`) and `.h5`, `.hdf5` (needs `pip install sgpr[hdf5]`) with such arrays, also in a
        structure or group, or with one vector per column as in a CSV file; `.parquet` with columns as in a CSV file
        (needs `pip install sgpr[parquet]`); an episode of a LeRobot data set, `FOLDER/episode_3` or its Parquet file
        (the same). By its beginning if the name does not tell.
    joints : list of str, optional
        Joints wanted, in order, e.g. `robot.joint_names`; by default those that the log names.
    **options
        Tables and arrays: `columns`, `units`, `torque_constants`, `rows`, `seconds`, `sample_rate_hz`, see `read_csv`.
        MCAP and bags: `logged_names`, `topics`, `clock`, and for MCAP `recover`, see `read_mcap`. All: `limit_bytes`,
        and `accept`, findings that are right, see `Recording.accept`. An option that does not apply to the format is an
        error.

    Returns
    -------
    Recording
        What was assumed or left out is in its `notes`, what is wrong with the log in its `issues`.

    Raises
    ------
    RecordingError
        If the file is of another kind, damaged or too large, or its joints cannot be told.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> log = sgpr.read("train.csv.gz")
    >>> log.dof, log.sample_rate_hz
    (6, 250.0)
    """
    if _frames.is_frame(path):
        return _frames.read(path, joints, **options)
    file = Path(path)
    accept = options.pop("accept", None)
    if not is_log(file):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(path))
    chosen = _format_of(file)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in _TABLE_OPTIONS | _MCAP.options:
            known = ", ".join(sorted(_TABLE_OPTIONS | _MCAP.options | {"accept"}))
            raise TypeError(f"read() got an unexpected keyword argument '{name}'; options are {known}")
        if name not in chosen.options:
            allowed = ", ".join(f"`{option}`" for option in sorted(chosen.options - {"limit_bytes"}))
            raise RecordingError(
                f"{file}: the option `{name}` does not apply to {chosen.name} files; those that do: {allowed}"
            )
    if accept is None:
        return chosen.read(file, joints, **given)
    if "columns" in chosen.options:
        return chosen.read(file, joints, accept=accept, **given)
    return chosen.read(file, joints, **given).accept(accept)


def copies_of(logs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Which logs are copies of one before them, and of which: by the hashes of their content.

    - `logs`: name and hash of each
    """
    first: dict[str, str] = {}
    copies = {}
    for name, content in logs:
        if content in first:
            copies[name] = first[content]
        else:
            first[content] = name
    return copies


def suffixes() -> tuple[str, ...]:
    """Ends of the names of files that can be read."""
    return tuple(_SUFFIXES)


def options_of(path: str | os.PathLike[str]) -> frozenset[str]:
    """Options that apply to the format of a file."""
    return _format_of(Path(path)).options | {"accept"}


def is_log(path: str | os.PathLike[str]) -> bool:
    """Whether there is something to read: a file, a folder, or an episode in a LeRobot data set."""
    return Path(path).exists() or _lerobot.episode_of(Path(path)) is not None


def _format_of(file: Path) -> _Format:
    if _lerobot.episode_of(file) is not None:
        return _LEROBOT
    if file.is_dir():
        return _bag_of_folder(file)
    name = file.name.lower()
    for suffix, chosen in _SUFFIXES.items():
        if name.endswith(suffix):
            return chosen
    with file.open("rb") as stream:
        start = stream.read(16)
    for beginning, chosen in _BEGINNINGS.items():
        if start.startswith(beginning):
            return chosen
    if start.startswith(b"PK") and _holds_arrays(file):
        return _NPZ
    understood = ", ".join(_SUFFIXES)
    raise RecordingError(
        f"{file}: neither name nor content tell the format; understood are {understood} and folders of ROS 2 bags "
        "(for a table of another name: read_csv)"
    )


def _holds_arrays(file: Path) -> bool:
    try:
        with zipfile.ZipFile(file) as archive:
            return any(name.endswith(".npy") for name in archive.namelist())
    except zipfile.BadZipFile:
        return False


def _bag_of_folder(folder: Path) -> _Format:
    """A bag of one MCAP file is that file; others are read through rosbags."""
    files = sorted(folder.glob("*.mcap"))
    if len(files) == 1 and not any(folder.glob("*.db3")):
        return _MCAP._replace(read=lambda _, joints, **options: read_mcap(files[0], joints, **options))
    if (folder / "metadata.yaml").exists():
        return _BAG
    raise RecordingError(
        f"{folder}: a folder, but neither a ROS 2 bag (metadata.yaml, or one MCAP file) nor a LeRobot data "
        "set (meta/info.json)"
    )
