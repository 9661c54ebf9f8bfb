"""Arrays by name, as NumPy archives, MATLAB and HDF5 files hold them: a time, and a column per joint."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._frames import read_columns
from ._sgpr import Recording, RecordingError, quantity_of_array
from .report.numbers import counted

Arrays = dict[str, NDArray[Any]]

NAMES = {
    "time": ("t", "time", "time_ns"),
    "position": ("q", "position", "qpos"),
    "velocity": ("dq", "velocity", "qvel"),
    "torque": ("tau", "torque", "effort"),
}
"""Quantity -> names of its array that go before others."""

ASSUMED = {"position": "rad (m)", "velocity": "rad/s (m/s)", "torque": "N·m (N)"}


def chosen(path: Path, arrays: Arrays, columns: Mapping[str, Any]) -> dict[str, str | None]:
    """Quantity -> its array: the one that `columns` names, else one whose name says so, also with a unit: `q_deg`."""
    found: dict[str, str | None] = {}
    for quantity, names in NAMES.items():
        if columns.get(quantity) is not None:
            found[quantity] = _named(arrays, columns[quantity])
            continue
        exact = [name for name in names if name in arrays]
        # A unit that is not known is told when the numbers are read.
        stated = [each for each in arrays if quantity_of_array(each.partition(" [")[0]) == quantity]
        if len(exact) > 1:
            raise RecordingError(f"{path}: the arrays {' and '.join(exact)} mean the same: leave one")
        found[quantity] = exact[0] if exact else stated[0] if len(stated) == 1 else None
    return found


def with_unit(name: str, unit: object) -> str:
    """The name of an array with the unit that its file says beside it, as columns of tables say it: `q [deg]`."""
    said = unit.decode(errors="replace") if isinstance(unit, bytes) else unit
    is_told = isinstance(said, str) and said.strip() not in ("", "1", "-")
    return f"{name} [{str(said).strip()}]" if is_told and quantity_of_array(name.rpartition(".")[2]) else name


def _named(arrays: Arrays, name: object) -> str | None:
    """An array by its name, with or without the unit."""
    if not isinstance(name, str):
        return None
    return next((each for each in arrays if each == name or each.startswith(f"{name} [")), None)


def listed(arrays: Arrays) -> str:
    """Arrays with their shapes, the largest first."""
    by_size = sorted(arrays.items(), key=lambda named: -named[1].size)
    return ", ".join(f"`{name}` {array.shape}" for name, array in by_size[:40]) or "none"


def recording_of(
    path: Path, arrays: Arrays, joints: Sequence[str] | None, options: Mapping[str, Any] | None = None
) -> Recording:
    """A recording of a time, positions and, if logged, velocities, torques, `joint_names`; others become channels."""
    options = dict(options or {})
    accept = options.pop("accept", None)
    roles = chosen(path, arrays, options.get("columns") or {})
    for quantity, name in (options.get("columns") or {}).items():
        if roles.get(quantity) is None:
            raise RecordingError(f"{path}: there is no array `{name}` for {quantity}; the arrays are {listed(arrays)}")
    for quantity, shape in (("time", "(N,)"), ("position", "(N, n)")):
        if roles[quantity] is None and not (quantity == "time" and options.get("sample_rate_hz")):
            names = " or ".join(f"`{name}`" for name in NAMES[quantity])
            more = ", or give `sample_rate_hz`" if quantity == "time" else ""
            raise RecordingError(
                f"{path}: no array {names} of shape {shape}; the arrays are {listed(arrays)}: name it with "
                f"`columns.{quantity}`{more}"
            )
    upright = _upright(path, arrays, roles)
    own = _joint_names(path, arrays, upright[roles["position"] or ""], joints)
    options = {key: value for key, value in options.items() if value is not None}
    if options or any(name not in NAMES[quantity] for quantity, name in roles.items() if name):
        recording = _through_table(path, upright, roles, own, options)
    else:
        recording = _as_they_are(path, upright, roles, own)
    recording = recording if accept is None else recording.accept(accept)
    return recording if joints is None else recording.select(joints)


def _upright(path: Path, arrays: Arrays, roles: Mapping[str, str | None]) -> Arrays:
    """Samples as rows, those of an array that lies on its side, too."""
    position = arrays[roles["position"] or ""]
    time = arrays[roles["time"]] if roles["time"] else None
    samples = len(np.atleast_1d(time.squeeze())) if time is not None else max(position.shape, default=0)
    upright = dict(arrays)
    for quantity, name in roles.items():
        if name is None:
            continue
        array = arrays[name]
        if array.dtype.kind not in "fiub" and not (quantity == "time" and array.dtype.kind == "M"):
            raise RecordingError(f"{path}: `{name}` holds {array.dtype}, expected numbers")
        if quantity == "time":
            array = np.atleast_1d(array.squeeze())
        elif array.ndim == 2 and array.shape[0] != samples and array.shape[1] == samples:
            array = array.T
        upright[name] = array
    return upright


def _as_they_are(path: Path, arrays: Arrays, roles: Mapping[str, str | None], names: list[str] | None) -> Recording:
    """SI units, nothing to convert."""
    used = {name for name in roles.values() if name} | {"joint_names"}
    time = arrays[roles["time"] or ""]
    channels = {name: values for name, values in arrays.items() if name not in used and _is_channel(values, time)}
    skipped = [name for name in arrays if name not in used and name not in channels]
    position, velocity, torque = (arrays[name] if name else None for name in list(roles.values())[1:])
    assert position is not None, "asked before"
    try:
        recording = Recording(time, position, velocity, torque, joint_names=names, channels=channels, source=str(path))
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    notes = ["skipped arrays: " + ", ".join(skipped)] if skipped else []
    return recording._from_source(str(path), notes, _layout(recording, roles))


def _layout(recording: Recording, roles: Mapping[str, str | None]) -> dict[str, Any]:
    """Which column of which array became what, as `Recording.layout` says it of tables."""

    def column(quantity: str, k: int) -> dict[str, Any] | None:
        name = roles[quantity]
        if name is None:
            return None
        unit = {"unit": ASSUMED[quantity], "stated": False, "torque_constant": None}
        return {"column": _called(name, k), **unit}

    joints = [
        {"joint": joint, **{quantity: column(quantity, k) for quantity in ASSUMED}}
        for k, joint in enumerate(recording.joint_names)
    ]
    # Arrays have no names for their columns: their order is that of the joints.
    return {"time": str(roles["time"]), "joints": joints, "by_order": True}


def _through_table(
    path: Path, arrays: Arrays, roles: Mapping[str, str | None], names: list[str] | None, options: dict[str, Any]
) -> Recording:
    """What units, constants and other options of tables are needed for: one set of rules."""
    position = np.atleast_2d(arrays[roles["position"] or ""])
    samples, count = position.shape
    columns: dict[str, NDArray[Any]] = {}
    named: dict[str, Any] = {}
    for quantity, name in roles.items():
        if name is None:
            continue
        array = arrays[name]
        if quantity == "time":
            columns[name], named["time"] = array, name
            continue
        if array.shape != (samples, count):
            raise RecordingError(f"{path}: {name}: got {array.shape}, expected {(samples, count)}")
        named[quantity] = [_called(name, k) for k in range(count)]
        columns |= {_called(name, k): array[:, k] for k in range(count)}
    if roles["time"] is not None and len(arrays[roles["time"]]) != samples:
        raise RecordingError(f"{path}: {roles['position']}: got {samples} rows, expected {len(arrays[roles['time']])}")
    used = {*columns, *(name for name in roles.values() if name)}
    columns |= {
        name: values
        for name, values in arrays.items()
        if name not in used and values.shape == (samples,) and values.dtype.kind in "fiu"
    }
    joints = names or [f"joint_{k + 1}" for k in range(count)]
    return read_columns(columns, str(path), joints, **{**options, "columns": named})


def _called(name: str, k: int) -> str:
    """What messages call a column of an array; it ends like the array, whose name may end in a unit."""
    return f"{k + 1} of {name}"


def _is_channel(values: NDArray[Any], time: NDArray[Any]) -> bool:
    return values.shape == time.shape and values.dtype.kind in "fiu"


def _joint_names(path: Path, arrays: Arrays, position: NDArray[Any], joints: Sequence[str] | None) -> list[str] | None:
    """Those of the file; else those that are asked for, if there are as many."""
    count = position.shape[1] if position.ndim == 2 else 0
    if "joint_names" in arrays:
        names = np.atleast_1d(arrays["joint_names"])
        if names.dtype.kind != "U" or names.ndim != 1:
            raise RecordingError(f"{path}: joint_names: got {names.dtype} of shape {names.shape}, expected text (n,)")
        if len(names) != count:
            raise RecordingError(
                f"{path}: joint_names: got {counted(len(names), 'name')} for {counted(count, 'column')} of positions"
            )
        return [str(name) for name in names]
    if joints is None:
        return None
    if len(joints) != count:
        raise RecordingError(
            f"{path}: the positions have {counted(count, 'column')} without names, the robot has "
            f"{counted(len(joints), 'joint')}: add an array `joint_names`, or name the joints with `joints`"
        )
    return list(joints)
