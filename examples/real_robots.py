"""Identify five real robots and compare each model with logs that its fit never saw.

    python examples/real_robots.py --out out/real

The logs are not part of this repository; `docs/real-data.md` says where they come from, and
`sgpr data get NAME --out logs/NAME` downloads them. The environment variable SGPR_DATA names the folder that holds
`real/` with `ur10e/`, `panda/`, `baxter/`, `kuka_lwr/` and `emps/`, or `real/` itself (here `logs`).
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sgpr

EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"]


@dataclass(frozen=True)
class Log:
    """A file, and the part of it in which the robot moves (rows from 1, both ends included)."""

    file: str
    rows: tuple[int, int] | None = None


@dataclass(frozen=True)
class Variant:
    """One way to identify, and the published or reference error that it is held against."""

    name: str
    options: dict[str, Any] = field(default_factory=dict)
    reference: str = ""


@dataclass(frozen=True)
class Dataset:
    """Where the logs of a robot are and how they are read."""

    folder: str
    urdf: str
    train: list[Log]
    test: list[Log]
    variants: list[Variant]
    reference: dict[str, Any]
    """Processing of the reference: errors in a wider band count noise that it never saw."""
    read: dict[str, Any] = field(default_factory=dict)
    repair: dict[str, Any] = field(default_factory=dict)


# UR10e: currents times the gains that its authors identified with a known load; the controller's 10 ms jitter.
UR10E_GAINS = [10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]
# Baxter: as its reference was processed.
BAXTER_REFERENCE = {"cutoff_hz": 5.0, "standstill_speed": 1e-9}
# EMPS: the screw's viscous friction differs by direction (Janot, Gautier, Brunot 2019).
EMPS_ASYMMETRIC = ["viscous_friction", "asymmetric_viscous_friction", "coulomb_friction", "torque_offset"]
# A tenth of its samples, of which there are a thousand a second.
EMPS_REFERENCE = {"cutoff_hz": 100.0, "torque_band": 40.0, "standstill_speed": 1e-9}
EMPS_SYMMETRIC = ["viscous_friction", "coulomb_friction", "torque_offset"]

DATASETS = [
    Dataset(
        "ur10e",
        "ur10e.urdf",
        [
            Log("excitation_30s_12harm.csv", (635, 3510)),
            Log("excitation_40s_12harm.csv", (500, 4460)),
            Log("excitation_50s_12harm.csv", (355, 5090)),
            Log("excitation_20s_8harm.csv", (320, 2310)),
        ],
        [Log("pair14_unloaded.csv", (195, 4966))],
        [Variant("automatic", {}, "4.0 to 5.5"), Variant("5 Hz", {"cutoff_hz": 5.0}, "4.0 to 5.5")],
        {"cutoff_hz": 5.0},
        {"columns": {"torque": "i{}_A"}, "torque_constants": UR10E_GAINS, "accept": ["joints_by_order"]},
        {"resample": 100.0},
    ),
    Dataset(
        "panda",
        "panda.urdf",
        [Log("train_0_14s.csv")],
        [Log("test_14_21s.csv")],
        [Variant("automatic", {}, "2.87"), Variant("15 Hz", {"cutoff_hz": 15.0}, "2.87")],
        {"cutoff_hz": 15.0},
        repair={"drop_repeated": True, "split_gaps": 0.1, "resample": 1000.0},
    ),
    Dataset(
        "baxter",
        "baxter_arm.urdf",
        [Log(f"traj0{k}.csv") for k in range(1, 6)],
        [Log(f"traj0{k}.csv") for k in (6, 7)],
        [
            Variant("automatic", {}, "14.5"),
            Variant("5 Hz, no rests", BAXTER_REFERENCE, "14.5"),
            Variant("automatic, springs", {"effects": [*EFFECTS, "cable_stiffness"]}, "9.3"),
            Variant("automatic, balancer at joint 2", {"effects": [*EFFECTS, "spring_balancer@baxter_j2"]}, "9.3"),
            Variant("5 Hz, no rests, springs", {**BAXTER_REFERENCE, "effects": [*EFFECTS, "cable_stiffness"]}, "9.3"),
        ],
        {"cutoff_hz": 5.0},
    ),
    Dataset(
        "kuka_lwr",
        "kuka_lwr.urdf",
        [Log(f"traj0{k}.csv") for k in range(1, 6)],
        [Log(f"traj0{k}.csv") for k in (6, 7)],
        [Variant("automatic", {}, "1.61"), Variant("5 Hz", {"cutoff_hz": 5.0}, "1.61")],
        {"cutoff_hz": 5.0},
    ),
    Dataset(
        "emps",
        "emps.urdf",
        [Log("train.csv")],
        [Log("test_pulses.csv")],
        [
            Variant("automatic", {"effects": EMPS_SYMMETRIC}, "5.982"),
            Variant("100 Hz, torque to 40 Hz", {"effects": EMPS_SYMMETRIC, **EMPS_REFERENCE}, "5.982"),
            Variant("100 Hz, torque to 40 Hz, asymmetric", {"effects": EMPS_ASYMMETRIC, **EMPS_REFERENCE}, ""),
        ],
        EMPS_REFERENCE,
        {"columns": {"position": ["q_m"], "torque": ["force_N"]}},
    ),
]


def recordings(folder: Path, robot: sgpr.Robot, dataset: Dataset, logs: list[Log]) -> list[sgpr.Recording]:
    """Read and repair the logs of one role."""
    result = []
    for log in logs:
        options = dict(dataset.read, **({"rows": log.rows} if log.rows else {}))
        recording = sgpr.read(folder / log.file, joints=robot.joint_names, **options)
        result.extend(recording.repair(**dataset.repair).recordings)
    return result


def robot_and_logs(folder: Path, dataset: Dataset) -> tuple[sgpr.Robot, list[sgpr.Recording], list[sgpr.Recording]]:
    """The robot, its training logs and its test logs."""
    robot = sgpr.Robot.from_urdf(folder / dataset.urdf)
    train, test = (recordings(folder, robot, dataset, logs) for logs in (dataset.train, dataset.test))
    return robot, train, test


def data_folder(given: Path | None = None) -> Path:
    """The folder of the robots, in `given` or in what SGPR_DATA names; ends the program if neither is there."""
    folder = given or Path(os.environ.get("SGPR_DATA") or "")
    if folder == Path():
        sys.exit("set SGPR_DATA to the folder that holds the logs (see docs/real-data.md)")
    return folder / "real" if (folder / "real").is_dir() else folder


def find_dataset(name: str) -> tuple[Path, Dataset]:
    """The data of one robot and the folder below SGPR_DATA that holds them; ends the program if they are not there."""
    dataset = next(dataset for dataset in DATASETS if dataset.folder == name)
    folder = data_folder() / name
    if not (folder / dataset.urdf).exists():
        sys.exit(f"no logs in {folder}: set SGPR_DATA (see docs/real-data.md)")
    return folder, dataset


def save(logs: list[sgpr.Recording], folder: Path) -> list[Path]:
    """The logs as the command line reads them: in SI units, repaired."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for index, log in enumerate(logs):
        path = folder / f"{Path(log.source).stem}_{index}.csv"
        log.save(path)
        paths.append(path)
    return paths


def arguments_of(options: dict[str, Any]) -> list[str]:
    """Options as the command line takes them."""
    names = {
        "method": "--method",
        "cutoff_hz": "--cutoff",
        "torque_band": "--torque-band",
        "standstill_speed": "--standstill-speed",
    }
    arguments = ["--effects", *options["effects"]]
    for name, option in names.items():
        if name in options:
            arguments += [option, str(options[name])]
    return arguments


def run(folder: Path, dataset: Dataset, out: Path) -> list[str]:
    """Rows of the table for one robot; leaves model and report of every variant."""
    robot, train, test = robot_and_logs(folder, dataset)
    train_files = save(train, out / dataset.folder / "train")
    test_files = save(test, out / dataset.folder / "test")
    command = Path(sys.executable).parent / "sgpr"
    rows = []
    for index, variant in enumerate(dataset.variants):
        options = {"effects": EFFECTS, **variant.options}
        target = out / dataset.folder / ("automatic" if index == 0 else f"variant_{index}")
        arguments = ["--robot", folder / dataset.urdf, "--train", *train_files, "--test", *test_files, "--out", target]
        subprocess.run([command, "identify", *arguments, *arguments_of(options), "--quiet"], check=True)
        model = sgpr.load(target / "model.sgpr")
        fit = sgpr.compare(model, train)
        unseen = sgpr.compare(model, test)
        as_reference = sgpr.identify(robot, train, effects=options["effects"], **dataset.reference)
        in_its_band = sgpr.compare(model, test, processing=as_reference)
        assert model.processing is not None and model.fit is not None
        torque_hz = model.processing.torque_cutoff_hz
        band = "full" if torque_hz is None else f"{torque_hz:.1f}"
        rows.append(
            f"| {dataset.folder} | {variant.name} | {model.processing.cutoff_hz:.1f} / {band} "
            f"| {len(model.parameters)} | {model.fit['scaled_condition']:.0f} "
            f"| {fit.relative_error_percent:.2f} | {unseen.relative_error_percent:.2f} "
            f"| {unseen.relative_error_with_rests_percent:.2f} | {in_its_band.relative_error_with_rests_percent:.2f} "
            f"| {variant.reference or '-'} "
            f"| {' '.join(f'{value:.3g}' for value in unseen.rmse)} |"
        )
    return rows


HEADER = """\
| robot | processing | position / torque band, Hz | base parameters | condition | train, % | unseen, % \
| unseen with rests, % | in the reference's band, % | reference unseen, % | unseen RMSE per joint, N·m (N) |
|---|---|---|---|---|---|---|---|---|---|---|"""


def main() -> int:
    """Run every robot whose logs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the logs (default: what SGPR_DATA names)")
    parser.add_argument("--out", type=Path, default=Path("out/real"))
    arguments = parser.parse_args()
    data = data_folder(arguments.data)
    lines = [HEADER]
    for dataset in DATASETS:
        if not (data / dataset.folder / dataset.urdf).exists():
            print(f"{dataset.folder}: no logs in {data / dataset.folder}; skipped", file=sys.stderr)
            continue
        lines += run(data / dataset.folder, dataset, arguments.out)
    if len(lines) == 1:
        print("no logs found: set SGPR_DATA to the folder that holds them (see docs/real-data.md)", file=sys.stderr)
        return 1
    table = "\n".join(lines)
    print(table)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "table.md").write_text(table + "\n")
    print(f"\nmodels and reports: {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
