"""Universal Robots UR10, an exciting motion as a ROS 2 bag."""

from ._bag_in_two import converted
from ._dataset import Dataset, Log, Source

FILE = "ur10_exciting_trajectory.db3"

DATASET = Dataset(
    name="ur10",
    robot="Universal Robots UR10, 6 joints",
    torque="joint effort of the ROS 2 message",
    rate_hz=125.0,
    licence="BSD-3-Clause, the repository's",
    citation="V. Petrone, E. Ferrentino, P. Chiacchio: The Dynamic Model of the UR10 Robot and Its ROS2 Integration. "
    "IEEE Transactions on Industrial Informatics, 2025, doi 10.1109/TII.2025.3534415",
    home="https://github.com/unisa-acg/inverse-dynamics-solver",
    sources=(
        Source(
            "https://raw.githubusercontent.com/unisa-acg/inverse-dynamics-solver/"
            f"41e196de5ca340f2b48e443484a7c74a77533da4/ur10_inverse_dynamics_solver/bagfiles/{FILE}",
            "14244fc39e9b42047039824f3c20ab984f9d1b28d5a67e9415cc1b3cc0ac3369",
            1257472,
        ),
    ),
    logs=(Log("train.csv", "train"), Log("test.csv", "test", "the last third of the same motion")),
    convert=converted(FILE),
    robot_file="ur10.toml",
    physics="Harmonic drives with strong friction; one motion of 27 s, so that the test is on postures that the "
    "training has hardly seen. The origin does not say how the effort was measured; it ends at 1.9 Hz, "
    "as after a low-pass.",
    unseen_percent=8.07,
)
