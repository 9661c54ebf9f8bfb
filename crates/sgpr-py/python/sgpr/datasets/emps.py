"""EMPS, a sliding axis."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ._dataset import Dataset, Log, Source
from ._tables import Table, matlab

PLACE = (
    "https://raw.githubusercontent.com/forgi86/sysid-neural-continuous/"
    "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a/examples/EMPS/data"
)
FILES = {"train.csv": "DATA_EMPS.mat", "test_pulses.csv": "DATA_EMPS_PULSES.mat"}


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """The force is the controller's output times the stated gain of the drive."""
    return {log: table(sources[file]) for log, file in FILES.items()}


def table(path: Path) -> Table:
    """One log."""
    arrays = {name: values.ravel() for name, values in matlab(path).items()}
    return {
        "t_s": arrays["t"],
        "q_m": arrays["qm"],
        "q_ref_m": arrays["qg"],
        "vir_V": arrays["vir"],
        "force_N": arrays["gtau"] * arrays["vir"],
        "pulse_raw": arrays.get("pulses_N", np.zeros_like(arrays["t"])),
    }


DATASET = Dataset(
    name="emps",
    robot="EMPS, a positioning axis: motor, ball screw, carriage",
    torque="force from the controller's output",
    rate_hz=1000.0,
    licence="public benchmark, free with citation; this copy lies in a repository under Apache-2.0",
    citation="A. Janot, M. Gautier, M. Brunot: Data Set and Reference Models of EMPS. Workshop on Nonlinear System "
    "Identification Benchmarks, Eindhoven, 2019",
    home="https://www.nonlinearbenchmark.org",
    sources=(
        Source(f"{PLACE}/DATA_EMPS.mat", "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e", 626039),
        Source(
            f"{PLACE}/DATA_EMPS_PULSES.mat",
            "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
            630990,
        ),
    ),
    logs=(Log("train.csv", "train"), Log("test_pulses.csv", "test", "with pulses that excite a flexibility")),
    convert=convert,
    robot_file="emps.urdf",
    effects=("viscous_friction", "coulomb_friction", "torque_offset"),
    settings="""columns = { position = "q_m", torque = "force_N" }\n""",
    physics="Inertia, viscous and Coulomb friction and an offset; the screw is worn, so that its viscous friction "
    "differs by direction. The axis is horizontal: no gravity along the motion.",
    published="4.0834 % on the training log and 5.9824 % on the test log with symmetric friction, 3.1117 % on the "
    "training log with friction that differs by direction (Janot, Gautier, Brunot 2019, on every tenth sample of "
    "filtered logs)",
    unseen_percent=7.21,
)
