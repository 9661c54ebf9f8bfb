"""PAL Robotics TIAGo, its arm."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ._dataset import Dataset, Log, Source
from ._tables import Table, numbers, part

PLACE = (
    "https://raw.githubusercontent.com/thanhndv212/figaroh-examples/"
    "c0b5c7f0fda10078be55104f9ee76ac106b7a5ee/examples/tiago"
)
JOINTS = [f"arm_{number}_joint" for number in range(1, 8)]

NEWTON_METRES_PER_AMPERE = np.array([13.6, 13.6, -8.7, -8.7, *3 * [-336 * 0.0613]])
"""At the joint: gear times constant of the motor, as in the origin's identification.py."""

MOVING = (921, 6791)
"""Rows of the origin in which the robot moves."""


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """The arm without the torso that carries it; currents to torques at the joints."""
    # Of each file the first two columns are time and torso.
    position, velocity, current = (
        numbers(sources[f"tiago_{name}.csv"], skip=1) for name in ("position", "velocity", "effort")
    )
    quantities = {
        "position_rad": position[:, 2:],
        "velocity_rad_s": velocity[:, 2:],
        "torque_Nm": current[:, 2:] * NEWTON_METRES_PER_AMPERE,
    }
    columns = {f"{joint}_{name}": values[:, k] for name, values in quantities.items() for k, joint in enumerate(JOINTS)}
    table = part({"t_s": position[:, 0], **columns}, *MOVING)
    cut = 2 * len(table["t_s"]) // 3
    return {"train.csv": part(table, 0, cut), "test.csv": part(table, cut)}


DATASET = Dataset(
    name="tiago",
    robot="PAL Robotics TIAGo, the 7 joints of its arm",
    torque="motor current through gear and motor constant",
    rate_hz=100.0,
    licence="Apache-2.0, as FIGAROH, whose terms the repository names",
    citation="T. D. V. Nguyen and others: FIGAROH examples, TIAGo (the repository)",
    home="https://github.com/thanhndv212/figaroh-examples",
    sources=(
        Source(
            f"{PLACE}/data/identification/dynamic/tiago_effort.csv",
            "12c635987705efade603426a600f5b315add7f580c720a4b84609dadb9d0a2e9",
            494579,
        ),
        Source(
            f"{PLACE}/data/identification/dynamic/tiago_position.csv",
            "4297a60d434ee89f1f424ad0da8ec65bc00072ac57eb06b94966c0819fc2786d",
            1418146,
        ),
        Source(
            f"{PLACE}/data/identification/dynamic/tiago_velocity.csv",
            "269f681ca7a9511ac1698bf027ddf601e3fdb49d7d397af4810ec839f136cd69",
            1504041,
        ),
        Source(
            f"{PLACE}/urdf/tiago_48_schunk.urdf",
            "e4412357e3ea141097acc835d81c4ac477f889ad99b05d2a9818ed9cdf9d12b6",
            72190,
        ),
    ),
    logs=(Log("train.csv", "train", "the first 39 s"), Log("test.csv", "test", "the last 20 s of the same motion")),
    convert=convert,
    robot_file="tiago_48_schunk.urdf",
    settings=f"joints = {json.dumps(JOINTS)}\nresample = 100.0\n",
    physics="The motors of the three wrist joints draw next to no current, and for seconds none was logged: what is "
    "said of them is friction at best. The torso moves up and down by 0.3 m beneath the arm, slowly, which the "
    "model of the arm leaves out. The motion is slow (below 0.6 rad/s): gravity and friction.",
    unseen_percent=8.75,
)
