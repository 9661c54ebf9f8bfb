"""Rethink Baxter, one arm."""

from ._dataset import Dataset, Source
from ._pick_and_place import CITATION, HOME, LICENCE, LOGS, PLACE, RATE_HZ, converted

FILE = "BaxterDirectDynamics.mat"

DATASET = Dataset(
    name="baxter",
    robot="Rethink Baxter, one arm, 7 joints",
    torque="reported joint effort",
    rate_hz=RATE_HZ,
    licence=LICENCE,
    citation=CITATION,
    home=HOME,
    sources=(
        Source(
            f"{PLACE}/ForwardDynamics/{FILE}",
            "19a2e0e28fb4fb85375de36205dbc1272cabdc6f3bad452544fbaf93a6c1f087",
            2376509,
        ),
    ),
    logs=LOGS,
    # The origin has the alphabetical order e0, e1, s0, s1, w0, w1, w2.
    convert=converted(FILE, "baxtertraj", (2, 3, 0, 1, 4, 5, 6)),
    robot_file="baxter_arm.urdf",
    physics="Two large springs at the second joint (s1) carry part of the weight: a rigid body with friction cannot "
    "explain that joint. Joints 1 and 7 carry less than 1 N·m of spread, so that their relative errors are large "
    "whatever the model. Which arm it was is not stated; its joint order is what the conversion undoes.",
    unseen_percent=13.9,
)
