"""Universal Robots UR10e, currents."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from ._dataset import Dataset, Log, Source
from ._tables import Table, joints, numbers

PLACE = "https://raw.githubusercontent.com/shamilmamedov/dynamic_calibration/11af40e7deb758ec080a175fed8fcdd6c99aca29"
ROBOT = "ur10e.urdf"
BLOCKS = (("q", "rad"), ("dq", "rad_s"), ("i", "A"), ("i_des", "A"), ("tau_des", "Nm"))


class _File(NamedTuple):
    """A log, where it comes from, and the rows in which the arm moves (from 1)."""

    log: str
    role: str
    what: str
    origin: str
    sha256: str
    size: int
    rows: tuple[int, int] | None


FILES = (
    _File(
        "excitation_30s_12harm.csv",
        "train",
        "periodic excitation of 12 harmonics",
        "identification_data/ur-20_02_10-30sec_12harm.csv",
        "341fff80f177be564c8720ea898165addfd46d7cbe6f3ffd8923eeaae0eef000",
        1108064,
        (635, 3510),
    ),
    _File(
        "excitation_40s_12harm.csv",
        "train",
        "the same in 40 s",
        "identification_data/ur-20_02_12-40sec_12harm.csv",
        "1355f739afecc5a9330f906e0c403be0080407f5ce2c26652556fac5748c6236",
        1389064,
        (500, 4460),
    ),
    _File(
        "excitation_50s_12harm.csv",
        "train",
        "the same in 50 s",
        "identification_data/ur-20_02_12-50sec_12harm.csv",
        "bb48cca42716a88f8b255d2d1b3eb3fa4a6eac4a9a52b694d4c1066ce8b4ca51",
        1626961,
        (355, 5090),
    ),
    _File(
        "excitation_20s_8harm.csv",
        "train",
        "8 harmonics in 20 s",
        "identification_data/ur-20_02_05-20sec_8harm.csv",
        "5456696773b5e3e12510640aab6049c65f4259c99880951bd71e1c74f8cb44e5",
        593204,
        (320, 2310),
    ),
    _File(
        "pair14_unloaded.csv",
        "test",
        "14 harmonics in 50 s, no load",
        "identification_data/ur-20_02_19_14harm50sec.csv",
        "cd503afc985c41a6ad8fbe47d443c961eadbde4822a87ff3e17adcb2a24fa103",
        1275916,
        (195, 4966),
    ),
    _File(
        "pair14_load_2p805kg.csv",
        "other",
        "the same motion with 2.805 kg at the flange",
        "identification_data/ur-20_02_19_14harm50secLoad.csv",
        "e689a99e5ff00ac38d03a2b9302e77688de0db8388b1d9c0e6aad3f77962758c",
        1266950,
        (308, 5071),
    ),
    _File(
        "pair_jan31_unloaded.csv",
        "other",
        "another motion, no load",
        "identification_data/ur-20_01_31-unload.csv",
        "513feea3e662364fad89214d5ff49e6ef96e02d56f85b4de57a408fc2563cb1c",
        620666,
        None,
    ),
    _File(
        "pair_jan31_loaded.csv",
        "other",
        "the same with a load that is not stated",
        "identification_data/ur-20_01_31-load.csv",
        "5abab622cdbd53db78fe3ec72485535c55ec5db412a179ae26bb9da6bea5441c",
        684549,
        None,
    ),
    _File(
        "validation_ptp_10_points.csv",
        "other",
        "moves between ten poses",
        "validation_data/ur-20_01_17-ptp_10_points.csv",
        "d97a4ac0c8b892b565d12f33af2bf0ef18183f7742e49d847d8ba92a041b56d8",
        1269008,
        (700, 4200),
    ),
    _File(
        "jointwise_joint2.csv",
        "other",
        "joint 2 alone, at several speeds",
        "jointwise_motion/ur-20_01_22-joint_2.csv",
        "50d969ecc38b1cd6916f0b38b63b4f5e65739319543637add44aa086fb3a8370",
        1420881,
        None,
    ),
    _File(
        "jointwise_joint4.csv",
        "other",
        "joint 4 alone, at several speeds",
        "jointwise_motion/ur-20_01_22-joint_4.csv",
        "7aa6d1e01c67318a13243bfe6b4db546978384d74abf37eff444e3f5e0bf0a8b",
        1456961,
        None,
    ),
    _File(
        "static_pose1.csv",
        "other",
        "standing still",
        "validation_data/ur-20_01_17-p1.csv",
        "840faa9479117632d16c3073a48402b547b2cee5363295d704a135968b6a3008",
        216176,
        None,
    ),
    _File(
        "static_pose2.csv",
        "other",
        "standing still",
        "validation_data/ur-20_01_17-p2.csv",
        "45afc4758846875e082855713374ea3e394d1957d2c46619d9a0b860469f5fdc",
        183520,
        None,
    ),
)


def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
    """Time, and five blocks of six columns; time is counted from the first sample."""
    return {file.log: table(sources[file.origin.rpartition("/")[2]]) for file in FILES}


def table(path: Path) -> Table:
    """One log."""
    rows = numbers(path)
    result: Table = {"t_s": rows[:, 0] - rows[0, 0]}
    for block, (name, unit) in enumerate(BLOCKS):
        result |= joints(name, unit, rows[:, 1 + 6 * block : 7 + 6 * block])
    return result


SETTINGS = """columns = { torque = "i{}_A" }
torque_constants = [10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]   # N·m/A, which the authors identified
accept = ["joints_by_order"]
resample = 100.0
""" + "".join(f'\n[files."{file.log}"]\nrows = [{file.rows[0]}, {file.rows[1]}]\n' for file in FILES if file.rows)

DATASET = Dataset(
    name="ur10e",
    robot="Universal Robots UR10e, 6 joints",
    torque="motor current times gains that the authors identified with a known load",
    rate_hz=94.0,
    licence="none stated; ask the authors before any use beyond research",
    citation="S. Mamedov, S. Mikhel: Practical Aspects of Model-Based Collision Detection. Frontiers in Robotics and "
    "AI 7, 2020, doi 10.3389/frobt.2020.571574",
    home="https://github.com/shamilmamedov/dynamic_calibration",
    sources=(
        *(Source(f"{PLACE}/dataset_ur10e/{file.origin}", file.sha256, file.size) for file in FILES),
        Source(f"{PLACE}/URe/urdf/{ROBOT}", "0d2abc6ebc70725c691a35aa6c2d03fd6e8158017a1b7da7a10a3ef52de7b821", 11913),
    ),
    logs=tuple(Log(file.log, file.role, file.what) for file in FILES),
    convert=convert,
    robot_file=ROBOT,
    settings=SETTINGS,
    physics="Harmonic drives: strong friction and rotor inertia; a load in the logs that say so. While a joint stands, "
    "its current lies anywhere inside the band of its Coulomb friction. Steps of 10 ms jitter from 2 to 34 ms.",
    unseen_percent=3.96,
)
