"""Logs of any format: `read` looks at the file and hands it to the reader that understands it."""

import errno
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from . import _frames
from ._sgpr import Recording, RecordingError, format_of, formats, read_log

_OPTIONS = frozenset(option for _, _, options in formats() for option in options)


def read(path: str | os.PathLike[str] | Any, joints: Sequence[str] | None = None, **options: Any) -> Recording:
    """Reads a log: CSV, MCAP, ROS bag, NumPy archive, Parquet, MATLAB or HDF5 file, LeRobot episode, or a DataFrame.

    Parameters
    ----------
    path : str or os.PathLike, or DataFrame
        A DataFrame of pandas or polars is read by the names of its columns, as a CSV file. A file by its name: `.csv`,
        `.csv.gz`, `.txt`, `.tsv` as in `read_csv`; `.mcap` as in `read_mcap`; `.bag` (ROS 1), `.db3` or the folder of a
        ROS 2 bag with `sensor_msgs/JointState`; `.npz` with the arrays `t`, `q`, `dq`, `tau` (or `time`, `position`,
        `velocity`, `torque` or `effort`) and `joint_names`; `.mat`, `.h5` and `.hdf5` with such arrays, also in a
        structure or group, or with one vector per column as in a CSV file; `.parquet` with columns as in a CSV file, or
        lists, one per sample; an episode of a LeRobot data set, `FOLDER/episode_3` or its Parquet file. By its
        beginning if the name does not tell.
    joints : list of str, optional
        Joints wanted, in order, e.g. `robot.joint_names`; by default those that the log names.
    **options
        Tables and arrays: `columns`, `units`, `torque_constants`, `rows`, `seconds`, `sample_rate_hz`, see `read_csv`.
        MCAP and bags: `logged_names`, `topics`, `clock`, `recover`, see `read_mcap`. All: `limit_bytes`,
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
    for name in options:
        if name not in _OPTIONS:
            known = ", ".join(sorted(_OPTIONS))
            raise TypeError(f"read() got an unexpected keyword argument '{name}'; options are {known}")
    if not is_log(path):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(path))
    kind, known_options = format_of(path)
    given = {name: value for name, value in options.items() if value is not None}
    accept = None if "accept" in known_options else given.pop("accept", None)
    for name in given:
        if name not in known_options:
            allowed = ", ".join(f"`{option}`" for option in sorted({*known_options} - {"accept", "limit_bytes"}))
            raise RecordingError(
                f"{path}: the option `{name}` does not apply to {kind} files; those that do: {allowed}"
            )
    recording = read_log(path, joints, **given)
    return recording if accept is None else recording.accept(accept)


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
    return tuple(ending for _, endings, _ in formats() for ending in endings)


def options_of(path: str | os.PathLike[str]) -> frozenset[str]:
    """Options that apply to the format of a file."""
    return frozenset(format_of(path)[1]) | {"accept"}


def is_log(path: str | os.PathLike[str]) -> bool:
    """Whether there is something to read: a file, a folder, or an episode in a LeRobot data set."""
    if Path(path).exists():
        return True
    try:
        return format_of(path)[0] == "LeRobot"
    except (OSError, RecordingError):
        return False
