"""SARCOS arm, the small file of the benchmark."""

from collections.abc import Mapping
from pathlib import Path

from ._dataset import Dataset, Log, Source
from ._pick_and_place import PLACE
from ._tables import Table, joints, matlab

FILE = "sarcos_inv_test.mat"

PROGRAM = """
import numpy as np
import sgpr

[path] = sgpr.datasets.fetch("sarcos", "sarcos").paths("other")
table = np.loadtxt(path, delimiter=",", skiprows=1)
state, torque = table[:, :21], table[:, 21]  # positions, speeds, accelerations; the first joint
test = np.arange(len(table)) % 5 == 4
process = sgpr.GaussianProcess(inducing_points=356).fit(state[~test], torque[~test])
left = torque[test] - process.predict(state[test])
print(np.mean(left**2) / np.var(torque[test]))
"""


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """Position, velocity, acceleration and torque, seven columns each, without time."""
    rows = matlab(sources[FILE])["sarcos_inv_test"]
    q, dq, ddq, tau = (rows[:, 7 * block : 7 * block + 7] for block in range(4))
    table = joints("q", "rad", q) | joints("dq", "rad_s", dq) | joints("ddq", "rad_s2", ddq) | joints("tau", "raw", tau)
    return {"sarcos_inv_test.csv": table}


DATASET = Dataset(
    name="sarcos",
    robot="SARCOS anthropomorphic arm, 7 hydraulic joints",
    torque="torque in the scale of its origin",
    rate_hz=100.0,
    licence="none stated; a public benchmark since 2000",
    citation="S. Vijayakumar, A. D'Souza, S. Schaal: Incremental Online Learning in High Dimensions. Neural "
    "Computation 17(12), 2005; in this form C. E. Rasmussen, C. K. I. Williams: Gaussian Processes for Machine "
    "Learning, 2006",
    home="https://gaussianprocess.org/gpml/data/",
    sources=(
        Source(
            f"{PLACE}/InverseDynamics/{FILE}",
            "161a59b5c3b4f4b404584323f181607b2acbe620eb134dc720760dc3f38f5cec",
            996776,
        ),
    ),
    logs=(Log("sarcos_inv_test.csv", "other", "4449 samples in shuffled order, without time"),),
    convert=convert,
    robot_file=None,
    effects=(),
    physics="Hydraulic, light and compliant: a rigid body does not describe it, and its kinematics are not published. "
    "For Gaussian processes only (`sgpr.GaussianProcess`). These samples are a tenth of the recording, drawn by "
    "chance, and almost all are in the usual training file too: errors on them are optimistic.",
    program=PROGRAM,
    expected="0.0258 of the variance of the first joint's torque is left on every fifth sample, which the process has "
    "not seen; all joints, and an exact process, are in the measurements of Gaussian processes",
)
