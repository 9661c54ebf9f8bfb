"""Logs of two real arms as a fleet: does it tell the load that one of them took, and nothing else?

    python examples/real_fleet.py --out out/real_fleet

A UR10e moves without and then with 2.805 kg at its flange, a Panda moves and nothing happens to it. Each log is cut
into sessions, which `sgpr fleet run` records and `sgpr fleet report` compares. The logs are not part of this
repository: `docs/real-data.md` says where they come from. The environment variable SGPR_DATA names the folder that
holds `real/` with `ur10e/` and `panda/`, or `real/` itself.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import sgpr

LOAD_KG = 2.805
# Drive gains of the authors, N·m per A, from a load that was known.
UR10E_GAINS = [10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]
UR10E_READ = {"columns": {"torque": "i{}_A"}, "torque_constants": UR10E_GAINS, "accept": ["joints_by_order"]}
# File, and the rows in which the robot moves.
UR10E_LOGS = [
    ("excitation_30s_12harm.csv", (635, 3510)),
    ("excitation_40s_12harm.csv", (500, 4460)),
    ("excitation_50s_12harm.csv", (355, 5090)),
    ("excitation_20s_8harm.csv", (320, 2310)),
    ("pair14_unloaded.csv", (195, 4966)),
    ("pair14_load_2p805kg.csv", (308, 5071)),
]
PANDA_LOGS = [("train_0_14s.csv", None), ("test_14_21s.csv", None)]


def main() -> None:
    """Sessions, records, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/real_fleet"))
    parser.add_argument("--workers", default="2")
    options = parser.parse_args()
    data = real_logs()
    options.out.mkdir(parents=True, exist_ok=True)
    robots = {name: data / name / f"{name}.urdf" for name in ("ur10e", "panda")}
    rows = sessions(data / "ur10e", robots["ur10e"], UR10E_LOGS, options.out, 10.0, UR10E_READ, 100.0)
    read = {"accept": ["joints_by_order"]}
    rows += sessions(data / "panda", robots["panda"], PANDA_LOGS, options.out, 2.5, read, 500.0)
    table = options.out / "fleet.csv"
    with table.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([["path", "robot", "type", "session", "start"], *rows])
    given = ["--robot", *(f"{name}={path}" for name, path in robots.items())]
    sgpr_fleet = [sys.executable, "-m", "sgpr", "fleet"]
    records, report = options.out / "records", options.out / "report"
    subprocess.run([*sgpr_fleet, "run", table, *given, "--out", records, "--workers", options.workers], check=True)
    subprocess.run([*sgpr_fleet, "report", records, *given, "--out", report], check=True)
    for arm in json.loads((report / "alarms.json").read_text())["arms"]:
        watched, every = len(arm["watched"]), len(arm["watched"]) + len(arm["not_watched"])
        alarms = [alarm["text"] for alarm in arm["alarms"]] or ["no change"]
        print(
            f"{arm['robot']}: {arm['sessions']} sessions, {watched} of {every} parameters watched; {'; '.join(alarms)}"
        )


def real_logs() -> Path:
    """Folder of the logs."""
    named = os.environ.get("SGPR_DATA")
    if not named:
        raise SystemExit("SGPR_DATA does not name the folder of the logs (docs/real-data.md)")
    return Path(named) / "real" if (Path(named) / "real").is_dir() else Path(named)


def sessions(
    folder: Path,
    urdf: Path,
    logs: list[tuple[str, tuple[int, int] | None]],
    out: Path,
    seconds: float,
    reading: dict[str, object],
    rate_hz: float,
) -> list[list[str]]:
    """Cuts logs into sessions of so many seconds, one on each of two halves of a day; rows of the table."""
    robot = sgpr.Robot.from_urdf(urdf)
    rows = []
    for file, part in logs:
        log = sgpr.read(folder / file, robot.joint_names, **(reading if part is None else {**reading, "rows": part}))
        for stretch in log.repair(resample=rate_hz).recordings:
            length = round(seconds * rate_hz)
            for start in range(0, len(stretch) - length // 2, length):
                rows_of = slice(start, start + length)
                path = out / f"{folder.name}_{len(rows):03d}.csv"
                t = 1e-9 * (stretch.time_ns[rows_of] - log.time_ns[0])
                names = [f"{joint}_{what}" for what in ("position", "torque") for joint in robot.joint_names]
                table = np.column_stack([t, stretch.q[rows_of], stretch.tau[rows_of]])
                np.savetxt(path, table, delimiter=",", header=",".join(["t", *names]), comments="", fmt="%.9g")
                day, hour = 1 + len(rows) // 2, 8 + 8 * (len(rows) % 2)
                label = f"{Path(file).stem} from {t[0]:.0f} s"
                when = f"2026-03-{day:02d}T{hour:02d}:00:00"
                rows.append([str(path.resolve()), folder.name, folder.name, label, when])
    return rows


if __name__ == "__main__":
    main()
