"""Logs of two real arms as a fleet: does it tell the load that one of them took, and nothing else?

    python examples/real_fleet.py --out out/real_fleet

A UR10e moves without and then with 2.805 kg at its flange, a Panda moves and nothing happens to it. Each log is cut
into sessions, which `sgpr fleet run` records and `sgpr fleet report` compares. The logs are not part of this
repository: they are those of `real_robots.py`, and SGPR_DATA names their folder.
"""

import argparse
import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import sgpr
from diagnose_real_robots import LOADED
from real_robots import Log, find_dataset


def main() -> None:
    """Sessions, records, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/real_fleet"))
    parser.add_argument("--workers", default="2")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    (ur10e_folder, ur10e), (panda_folder, panda) = find_dataset("ur10e"), find_dataset("panda")
    robots = {"ur10e": ur10e_folder / ur10e.urdf, "panda": panda_folder / panda.urdf}
    logs = [*ur10e.train, *ur10e.test, LOADED]
    rows = sessions(ur10e_folder, robots["ur10e"], logs, options.out, 10.0, ur10e.read, 100.0)
    read = {"accept": ["joints_by_order"]}
    rows += sessions(panda_folder, robots["panda"], [*panda.train, *panda.test], options.out, 2.5, read, 500.0)
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


def sessions(
    folder: Path,
    urdf: Path,
    logs: list[Log],
    out: Path,
    seconds: float,
    reading: dict[str, Any],
    rate_hz: float,
) -> list[list[str]]:
    """Cuts logs into sessions of so many seconds, one on each of two halves of a day; rows of the table."""
    robot = sgpr.Robot.from_urdf(urdf)
    rows = []
    for part in logs:
        limits = {} if part.rows is None else {"rows": part.rows}
        log = sgpr.read(folder / part.file, robot.joint_names, **reading, **limits)
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
                label = f"{Path(part.file).stem} from {t[0]:.0f} s"
                when = f"2026-03-{day:02d}T{hour:02d}:00:00"
                rows.append([str(path.resolve()), folder.name, folder.name, label, when])
    return rows


if __name__ == "__main__":
    main()
