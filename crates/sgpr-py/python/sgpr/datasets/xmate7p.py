"""ROKAE xMate7 Pro."""

from collections.abc import Mapping
from pathlib import Path

from ._dataset import Dataset, Log, Source
from ._tables import Table, at_rate, joints, numbers

PLACE = "https://raw.githubusercontent.com/NKU-ZiXuan/xMate7p_dyn_ident/7d8c9246adfc2a14d161df41a21a70671471ac1c/data"
RATE_HZ = 50.0
LOGS = (Log("traj1.csv", "train"), Log("traj2.csv", "train"), Log("traj3.csv", "test", "another motion"))


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """Position, velocity, acceleration and torque, seven columns each, without time."""
    return {log.file: table(sources[f"xMate7p_{log.file.removesuffix('.csv')}_results.csv"]) for log in LOGS}


def table(path: Path) -> Table:
    """One motion."""
    rows = numbers(path)
    q, dq, _, tau = (rows[:, 7 * block : 7 * block + 7] for block in range(4))
    return at_rate(len(rows), RATE_HZ) | joints("q", "rad", q) | joints("dq", "rad_s", dq) | joints("tau", "Nm", tau)


DATASET = Dataset(
    name="xmate7p",
    robot="ROKAE xMate7 Pro, 7 joints",
    torque="joint torque as stored",
    rate_hz=RATE_HZ,
    licence="none stated; ask the authors before any use beyond research",
    citation="NKU-ZiXuan: xMate7p_dyn_ident (the repository), after C. D. Sousa, R. Cortesao: Physical feasibility of "
    "robot base inertial parameter identification. International Journal of Robotics Research 33(6), 2014",
    home="https://github.com/NKU-ZiXuan/xMate7p_dyn_ident",
    sources=(
        *(
            Source(f"{PLACE}/recdata/xMate7p_traj{number}_results.csv", sha256, size)
            for number, sha256, size in (
                (1, "84bcef00b1410b98f962d6edf354e3aa5f11c43c9645b8b7bdfb8b4dad87d67f", 248847),
                (2, "9fe697240cc64a06306c12aaa36c21f51619facccc92d0b0de51d07519806dfc", 253150),
                (3, "b8cf0a91bf58d4afafa7a65c9e69c7916ad63759248ef60e477c59db1d0af5e6", 251935),
            )
        ),
        Source(
            f"{PLACE}/robotparams/XM7p/urdf/XM7p.urdf",
            "525104b34c64a42504ebca5741ad0d0b0963ae8d62de17b6159b2bf56194dfe4",
            9624,
        ),
    ),
    logs=LOGS,
    convert=convert,
    robot_file="XM7p.urdf",
    physics="Friction and gravity dominate; the inertias of the robot file are those of a CAD model. Three "
    "motions of 20 s.",
    unseen_percent=3.96,
)
