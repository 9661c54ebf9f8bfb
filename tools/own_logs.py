"""Logs of the bundled arm as a stranger might have them, for the timed path of docs/first-hour.md.

    python tools/own_logs.py FOLDER

Semicolons, decimal commas, a title line, time in milliseconds, positions in degrees, and column names that fit no robot
file.
"""

import csv
import gzip
import shutil
import sys
from math import degrees
from pathlib import Path

DEMO = Path(__file__).resolve().parents[1] / "data" / "demo"
NAMES = {"train_1": "monday_a", "train_2": "monday_b", "train_3": "monday_c", "test": "tuesday"}
JOINTS = range(1, 7)


def rewritten(source: Path, target: Path) -> None:
    """One log with the columns of another controller."""
    with gzip.open(source, "rt", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    start = float(rows[0]["t"])
    with target.open("w") as out:
        out.write("Cell 4; recorded by the axis monitor\n")
        out.write(
            ";".join(["clock_ms", *(f"Ax{k} act pos [deg]" for k in JOINTS), *(f"Ax{k} drv" for k in JOINTS)]) + "\n"
        )
        for row in rows:
            cells = [1000.0 * (float(row["t"]) - start)]
            cells += [degrees(float(row[f"q_{k}"])) for k in JOINTS] + [float(row[f"tau_{k}"]) for k in JOINTS]
            out.write(";".join(f"{cell:.6f}".replace(".", ",") for cell in cells) + "\n")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(DEMO / "robot.urdf", folder / "arm.urdf")
    for name, own in NAMES.items():
        rewritten(DEMO / f"{name}.csv.gz", folder / f"{own}.csv")
    print("\n".join(str(path) for path in sorted(folder.iterdir())))
