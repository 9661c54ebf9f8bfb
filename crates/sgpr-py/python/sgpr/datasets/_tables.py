"""Tables of logs: from the files of an origin, to CSV with names that say joint and unit."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Table = dict[str, Array]
"""Column -> one value per sample; all of one length."""


def joints(name: str, unit: str, values: Array) -> Table:
    """One column per joint: `q1_rad`, `q2_rad`, ... of an array `[samples, joints]`."""
    return {f"{name}{joint + 1}_{unit}": values[:, joint] for joint in range(values.shape[1])}


def at_rate(samples: int, rate_hz: float) -> Table:
    """The column of time, where the origin has none."""
    return {"t_s": np.arange(samples) / rate_hz}


def part(table: Table, first: int, last: int | None = None) -> Table:
    """The rows from `first` to before `last`, from 0."""
    return {name: values[first:last] for name, values in table.items()}


def matlab(path: Path) -> dict[str, Array]:
    """The arrays of a MATLAB file."""
    content: dict[str, Any] = import_module("scipy.io").loadmat(path)
    return {name: np.asarray(values, float) for name, values in content.items() if not name.startswith("__")}


def numbers(path: Path, *, skip: int = 0) -> Array:
    """The rows of a text file with commas, without those that do not fit the others: there its writer broke off."""
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()[skip:] if line.strip()]
    lengths = [len(row) for row in rows]
    width = max(set(lengths), key=lengths.count, default=0)
    kept = []
    for row in rows:
        try:
            kept.append([float(cell) for cell in row] if len(row) == width else None)
        except ValueError:
            kept.append(None)
    return np.array([row for row in kept if row is not None], float).reshape(-1, width)


def write(path: Path, table: Mapping[str, Array]) -> None:
    """A CSV file, eight digits each: more than any of the origins has."""
    names: Sequence[str] = list(table)
    np.savetxt(path, np.column_stack([table[name] for name in names]), "%.8g", ",", header=",".join(names), comments="")
