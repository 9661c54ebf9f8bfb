"""Franka Emika Panda, the exciting motion of Gaz et al."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ._dataset import Dataset, Log, Source
from ._tables import Table, joints, part

PLACE = (
    "https://raw.githubusercontent.com/marcocognetti/FrankaEmikaPandaDynModel/"
    "24d85ce4e648e2e894c832bfeee9b16711eb1a1a/matlab/data/Exciting_Traj/Trajectory_1/rbt_log"
)
JOINTS = 7
CUT_S = 14.0


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """One number per line, seven per sample; cut in time into a log for training and one for the test."""
    names = {"positions": ("q", "rad"), "velocity": ("dq", "rad_s"), "torques": ("tau", "Nm")}
    time = np.loadtxt(sources["exciting_traj_time.txt"], ndmin=1)
    blocks = {name: np.loadtxt(sources[f"exciting_traj_{name}.txt"]).reshape(-1, JOINTS)[: len(time)] for name in names}
    table = {"t_s": time[: min(map(len, blocks.values()))]}
    for name, block in blocks.items():
        table |= joints(*names[name], block[: len(table["t_s"])])
    cut = int(np.searchsorted(table["t_s"], CUT_S))
    return {"train_0_14s.csv": part(table, 0, cut), "test_14_21s.csv": part(table, cut)}


DATASET = Dataset(
    name="panda",
    robot="Franka Emika Panda, 7 joints",
    torque="link-side torque sensors",
    rate_hz=1000.0,
    licence="GPL-3.0, the repository's",
    citation="C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca: Dynamic Identification of the Franka "
    "Emika Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization. IEEE Robotics and "
    "Automation Letters 4(4), 2019, doi 10.1109/LRA.2019.2931248",
    home="https://github.com/marcocognetti/FrankaEmikaPandaDynModel",
    sources=tuple(
        Source(f"{PLACE}/exciting_traj_{name}.txt", sha256, size)
        for name, sha256, size in (
            ("time", "031063612f297011dc005ab29830903e36f4bfeba77bce59c0fbde13620fb20d", 163156),
            ("positions", "50bf82a082c439aff8220e8142985c8dd783f7ddc1415987cd75c9efb88bcf69", 1313599),
            ("velocity", "3340f299e926c501b66d540fa461ea0a7184b8dda32e505ebed062db57860d49", 1333480),
            ("torques", "11fda32785bb29ce444e14e0f45f4893aab7142dc6ee29576d828ab154852f9c", 1259026),
        )
    ),
    logs=(Log("train_0_14s.csv", "train"), Log("test_14_21s.csv", "test", "the same motion, later")),
    convert=convert,
    robot_file="panda.urdf",
    settings="drop_repeated = true\nsplit_gaps = 0.1\nresample = 1000.0\n",
    physics="The sensors sit behind the gears: rotor inertia and most gear friction are not in the signal. What is "
    "left is a small friction that saturates with speed, so that a line of Coulomb and viscous friction is a wrong "
    "shape. Steps jitter between 0.7 and 8.8 ms, and six in a hundred samples repeat the one before.",
    published="1.41 % on this motion, in sample (Gaz et al. 2019)",
    unseen_percent=0.86,
)
