"""Robots by what the user names: a URDF file, a Denavit-Hartenberg table, a ready-made robot."""

import difflib
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import Robot, RobotError
from ..robots import puma560, two_link
from .console import Output
from .errors import BadData, wrong_use

READY_MADE = {"puma560": puma560, "two_link": two_link}
LOGS = (".csv", ".csv.gz", ".tsv", ".txt", ".mcap", ".bag", ".db3", ".npz", ".parquet", ".mat", ".h5", ".hdf5")
"""Ends of names that no file of a robot has."""
MODELS = (".sgpr",)
ROBOTS = "a URDF, a table of DH parameters, puma560 or two_link"
DH_TABLE_KEYS = {"name", "convention", "joints", "gravity", "rows"}


def load_robot(name: str, joints: Sequence[str] | None = None, gravity: Sequence[float] | None = None) -> Robot:
    """The robot in the file `name`, or of that name.

    A DH table is a TOML or JSON file with `convention` ("standard" or "modified") and `rows`, one table per joint with
    a, alpha, d, theta and, if known, mass, centre_of_mass, inertia; also `name`, `joints` (names) and `gravity`.
    """
    if name in READY_MADE and not Path(name).exists():
        robot = READY_MADE[name]()
        _only_urdf_picks(joints, robot)
    elif Path(name).suffix.lower() in (".toml", ".json"):
        robot = _from_table(name)
        _only_urdf_picks(joints, robot)
    else:
        for ends, kind in ((LOGS, "log"), (MODELS, "model")):
            if Path(name).is_file() and Path(name).name.lower().endswith(ends):
                raise BadData(f"{name}: this is a {kind}; a robot is {ROBOTS}")
        if not Path(name).exists() and (near := difflib.get_close_matches(name, READY_MADE, n=1)):
            raise BadData(
                f"{name}: there is no such file, and no ready-made robot of that name: did you mean {near[0]}?"
            )
        robot = Robot.from_urdf(name, joints)
    return robot if gravity is None else robot.with_gravity(gravity)


def tell_locked(name: str, robot: Robot, output: Output) -> None:
    """Says which joints of a URDF the robot lacks: they stand at zero, whatever the log says of them."""
    if not is_urdf(name):
        return
    try:
        whole = Robot.from_urdf(name)
    except RobotError:
        return
    locked = [joint for joint in whole.joint_names if joint not in robot.joint_names]
    if locked:
        output.told(f"left out and taken to stand at zero: {', '.join(locked)}")


def is_urdf(name: str) -> bool:
    """Whether `name` is read as a URDF file."""
    ready_made = name in READY_MADE and not Path(name).exists()
    return not ready_made and Path(name).suffix.lower() not in (".toml", ".json")


def _from_table(path: str) -> Robot:
    text = Path(path).read_text(encoding="utf-8")
    try:
        table: dict[str, Any] = json.loads(text) if path.lower().endswith(".json") else tomllib.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadData(f"{path}: {error}") from error
    if not isinstance(table, dict) or not isinstance(table.get("rows"), list) or "convention" not in table:
        raise BadData(
            f'{path}: not a table of Denavit-Hartenberg parameters: give convention = "standard" or "modified" '
            "and rows, one per joint, each with a, alpha, d, theta"
        )
    unknown = sorted(set(table) - DH_TABLE_KEYS)
    if unknown:
        raise BadData(f"{path}: unknown entries {', '.join(unknown)}; known are {', '.join(sorted(DH_TABLE_KEYS))}")
    optional = {"joint_names": table.get("joints"), "gravity": table.get("gravity")}
    try:
        return Robot.from_dh(
            table["rows"],
            convention=table["convention"],
            name=table.get("name", Path(path).stem),
            **{key: value for key, value in optional.items() if value is not None},
        )
    except (TypeError, KeyError, ValueError) as error:
        raise BadData(f"{path}: {error}") from error


def _only_urdf_picks(joints: Sequence[str] | None, robot: Robot) -> None:
    if joints and list(joints) != robot.joint_names:
        raise wrong_use(
            f"{robot.name} has the joints {', '.join(robot.joint_names)}; only a URDF can be cut down", "--joints"
        )
