"""KUKA LWR IV."""

from ._dataset import Dataset, Source
from ._pick_and_place import CITATION, HOME, LICENCE, LOGS, PLACE, RATE_HZ, converted

FILE = "KukaDirectDynamics.mat"

DATASET = Dataset(
    name="kuka_lwr",
    robot="KUKA LWR IV, 7 joints",
    torque="link-side torque sensors",
    rate_hz=RATE_HZ,
    licence=LICENCE,
    citation=CITATION,
    home=HOME,
    sources=(
        Source(
            f"{PLACE}/ForwardDynamics/{FILE}",
            "b66131278f6b3e325b614f05d90e6a180a4f658606f1f554d8c832939cb5ff9d",
            1425632,
        ),
    ),
    logs=LOGS,
    convert=converted(FILE, "kukatraj", range(7)),
    robot_file="kuka_lwr.urdf",
    physics="The motion is slow (below 2 rad/s²): gravity and friction dominate, inertia is hardly excited, and all "
    "seven logs are alike. A part that depends on the direction of motion is left at joints 1, 5 and 7.",
    unseen_percent=1.2,
)
