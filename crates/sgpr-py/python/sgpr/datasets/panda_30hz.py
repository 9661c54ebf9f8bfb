"""Franka Emika Panda, an exciting motion logged slowly as a ROS 2 bag."""

from ._bag_in_two import converted
from ._dataset import Dataset, Log, Source

FILE = "panda_exciting_trajectory.db3"

DATASET = Dataset(
    name="panda_30hz",
    robot="Franka Emika Panda, 7 joints, logged at 30 Hz",
    torque="joint effort of the ROS 2 message",
    rate_hz=30.0,
    licence="BSD-3-Clause, the repository's",
    citation="V. Petrone, E. Ferrentino, P. Chiacchio: The Dynamic Model of the UR10 Robot and Its ROS2 Integration. "
    "IEEE Transactions on Industrial Informatics, 2025, doi 10.1109/TII.2025.3534415 (the repository)",
    home="https://github.com/unisa-acg/inverse-dynamics-solver",
    sources=(
        Source(
            "https://raw.githubusercontent.com/unisa-acg/inverse-dynamics-solver/"
            f"41e196de5ca340f2b48e443484a7c74a77533da4/franka_inria_inverse_dynamics_solver/bagfiles/{FILE}",
            "6794c9dc89628d775bd77bfaee3ed73e0a7d7716401886e17e06d81ea3b7f299",
            307200,
        ),
    ),
    logs=(Log("train.csv", "train"), Log("test.csv", "test", "the last third of the same motion")),
    convert=converted(FILE),
    robot_file="panda.urdf",
    settings="resample = 30.0\n",
    physics="The same type of robot as `panda`, another motion, 24 s at 30 samples a second: little data for 43 base "
    "parameters and friction, a set to see what few samples do.",
    unseen_percent=1.59,
)
