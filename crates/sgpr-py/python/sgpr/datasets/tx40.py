"""Staubli TX40."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ._dataset import Dataset, Log, Source
from ._tables import Table, at_rate, joints, numbers, part

PLACE = (
    "https://raw.githubusercontent.com/thanhndv212/figaroh-examples/"
    "c0b5c7f0fda10078be55104f9ee76ac106b7a5ee/examples/staubli_TX40"
)
RATE_HZ = 5000.0

GEARS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
COUPLING = 32.0
"""Motor turns per joint turn; the fifth motor turns the sixth joint, too. As in the origin's TX40_config.yaml."""


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """From motors to joints: turns through the gears, torque of the motors through their transpose."""
    turns, torque = GEARS.copy(), GEARS.copy()
    turns[5, 4] = torque[4, 5] = COUPLING
    q = numbers(sources["pos_read_data.csv"], skip=1) @ np.linalg.inv(turns).T
    q += np.array([0.0, -np.pi / 2.0, np.pi / 2.0, 0.0, 0.0, 0.0])
    tau = numbers(sources["curr_data.csv"], skip=1) @ torque.T
    table = at_rate(len(q), RATE_HZ) | joints("q", "rad", q) | joints("tau", "Nm", tau)
    cut = 2 * len(q) // 3
    return {"train.csv": part(table, 0, cut), "test.csv": part(table, cut)}


DATASET = Dataset(
    name="tx40",
    robot="Staubli TX40, 6 joints, the last two coupled",
    torque="motor torque from current, through the gears",
    rate_hz=RATE_HZ,
    licence="Apache-2.0, as FIGAROH, whose terms the repository names",
    citation="T. D. V. Nguyen and others: FIGAROH examples, Staubli TX40 (the repository)",
    home="https://github.com/thanhndv212/figaroh-examples",
    sources=(
        Source(
            f"{PLACE}/data/pos_read_data.csv",
            "5cc1cecc1024ef0e331d0caba06f689456ab789ec3f1e904599c0a8be5c27bc8",
            2101824,
        ),
        Source(
            f"{PLACE}/data/curr_data.csv", "f4592f4ba4db42f5d7625688986be25b575ca34d0504b27979ca6b0276bd3af9", 2357129
        ),
        Source(
            f"{PLACE}/urdf/tx40_mdh_modified.urdf",
            "3d00cbd46279c915d594b1bb4610dbac78d1e99ed27f95de70984bde13486074",
            7448,
        ),
    ),
    logs=(Log("train.csv", "train", "the first 6 s"), Log("test.csv", "test", "the last 3 s of the same motion")),
    convert=convert,
    robot_file="tx40_mdh_modified.urdf",
    physics="The fifth motor turns the sixth joint too: friction and rotor inertia of these two joints are coupled, "
    "which no effect of the library says, and the fifth joint keeps the largest relative error. A gear of 32 to 48 "
    "makes rotor inertia and friction large.",
    unseen_percent=19.7,
)
