"""How the unseen error falls with the seconds of training, for real robots, beside the error of the robot file.

    python examples/how_much_data.py --out out/how_much_data.md

Of every training set the first 5, 10, 20, 40 and 80 s are taken, log after log, and again with each of the other logs
first; the error is that on the test logs, bare (`prior=None`) and held by the robot file where the logs do not know.
`docs/real-data.md` says where the logs come from; the environment variable SGPR_DATA names the folder with `real/`.
"""

import argparse
import statistics
import sys
from pathlib import Path
from typing import Any

import sgpr
from real_robots import DATASETS, EFFECTS, Dataset, data_folder, robot_and_logs

SECONDS = (5.0, 10.0, 20.0, 40.0, 80.0)


def first_seconds(logs: list[sgpr.Recording], seconds: float) -> list[sgpr.Recording]:
    """The first `seconds` of the logs, one after the other; what is left of less than a second is no log."""
    taken = []
    for log in logs:
        start = log.time_ns[0]
        count = int(((log.time_ns - start) * 1e-9 <= seconds).sum())
        length = float(log.time_ns[count - 1] - start) * 1e-9
        if length < 1.0:
            break
        dq = None if log.dq is None else log.dq[:count]
        tau = None if log.tau is None else log.tau[:count]
        taken.append(
            sgpr.Recording(log.time_ns[:count], log.q[:count], dq, tau, joint_names=log.joint_names, source=log.source)
        )
        seconds -= length
        if seconds < 1.0:
            break
    return taken


def duration(logs: list[sgpr.Recording]) -> float:
    """Seconds in all logs."""
    return sum(float(log.time_ns[-1] - log.time_ns[0]) * 1e-9 for log in logs)


BARE: dict[str, Any] = {"prior": None}


def rows(data: Path, dataset: Dataset) -> list[str]:
    """Rows of the table for one robot."""
    robot, train, test = robot_and_logs(data / dataset.folder, dataset)
    effects = dataset.variants[0].options.get("effects", EFFECTS)
    # Judged in one band, that of all logs: a narrow band of few seconds would make an error look small.
    whole = sgpr.identify(robot, train, effects=effects)

    def error(model: sgpr.Model) -> float:
        found: float = sgpr.compare(model, test, processing=whole).relative_error_percent
        return found

    def errors(logs_of_starts: list[list[sgpr.Recording]], options: dict[str, Any]) -> str:
        found = [error(sgpr.identify(robot, logs, effects=effects, **options)) for logs in logs_of_starts]
        return f"{statistics.median(found):.2f} | {max(found):.2f}"

    file = error(sgpr.Model.nominal(robot))
    times = [seconds for seconds in SECONDS if seconds < duration(train)]
    lines = []
    for seconds in times:
        starts = [first_seconds(train[first:] + train[:first], seconds) for first in range(len(train))]
        both = f"{errors(starts, BARE)} | {errors(starts, {})}"
        lines.append(f"| {dataset.folder} | {seconds:.0f} | {len(starts)} | {both} | {file:.2f} |")
    both = f"{errors([train], BARE)} | {errors([train], {})}"
    lines.append(f"| {dataset.folder} | all {duration(train):.0f} | 1 | {both} | {file:.2f} |")
    return lines


HEADER = """\
| robot | training, s | starts | bare, median, % | bare, worst, % | held, median, % | held, worst, % | robot file, % |
|---|---:|---:|---:|---:|---:|---:|---:|"""


def main() -> int:
    """Run every robot whose logs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the logs (default: what SGPR_DATA names)")
    parser.add_argument("--out", type=Path, default=Path("out/how_much_data.md"))
    arguments = parser.parse_args()
    data = data_folder(arguments.data)
    lines = [HEADER]
    for dataset in DATASETS:
        if not (data / dataset.folder / dataset.urdf).exists():
            print(f"{dataset.folder}: no logs in {data / dataset.folder}; skipped", file=sys.stderr)
            continue
        lines += rows(data, dataset)
        print(f"{dataset.folder}: done", file=sys.stderr)
    table = "\n".join(lines)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(table + "\n")
    print(f"\n{table}\n\nwritten to {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
