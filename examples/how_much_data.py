"""How the unseen error falls with the seconds of training, for real robots, beside the error of the robot file.

    python examples/how_much_data.py --out out/how_much_data.md

Of every training set the first 5, 10, 20, 40 and 80 s are taken, log after log, and again with each of the other logs
first; the error is that on the test logs. `docs/real-data.md` says where the logs come from; the environment variable
SGPR_DATA names their folder.
"""

import argparse
import os
import statistics
import sys
from pathlib import Path
from typing import Any

import sgpr
from real_robots import DATASETS, EFFECTS, Dataset, robot_and_logs

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


def rows(data: Path, dataset: Dataset, options: dict[str, Any]) -> list[str]:
    """Rows of the table for one robot."""
    robot, train, test = robot_and_logs(data / dataset.folder, dataset)
    effects = dataset.variants[0].options.get("effects", EFFECTS)
    whole = sgpr.identify(robot, train, effects=effects, **options)
    nominal = sgpr.Model.nominal(robot)
    file = sgpr.compare(nominal, test, processing=whole).relative_error_percent
    lines = []
    for seconds in SECONDS:
        if duration(train) < seconds:
            break
        errors, worst = [], 0.0
        for first in range(len(train)):
            logs = first_seconds(train[first:] + train[:first], seconds)
            try:
                model = sgpr.identify(robot, logs, effects=effects, **options)
            except sgpr.SgprError as error:
                print(f"{dataset.folder}, {seconds:.0f} s from log {first + 1}: {error}", file=sys.stderr)
                continue
            # Judged in one band, that of all logs: a narrow band of few seconds would make an error look small.
            errors.append(sgpr.compare(model, test, processing=whole).relative_error_percent)
            worst = max(worst, errors[-1])
        if errors:
            lines.append(
                f"| {dataset.folder} | {seconds:.0f} | {len(errors)} of {len(train)} "
                f"| {statistics.median(errors):.2f} | {worst:.2f} | {file:.2f} |"
            )
    error = sgpr.compare(whole, test).relative_error_percent
    lines.append(f"| {dataset.folder} | all {duration(train):.0f} | 1 | {error:.2f} | {error:.2f} | {file:.2f} |")
    return lines


HEADER = """\
| robot | training, s | starts | unseen error, median, % | worst, % | robot file, % |
|---|---:|---:|---:|---:|---:|"""


def main() -> int:
    """Run every robot whose logs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("SGPR_DATA"))
    parser.add_argument("--out", type=Path, default=Path("out/how_much_data.md"))
    parser.add_argument("--no-prior", action="store_true", help="the bare estimate")
    arguments = parser.parse_args()
    data = Path(arguments.data or "../shared/data/real")
    options: dict[str, Any] = {"prior": None} if arguments.no_prior else {}
    lines = [HEADER]
    for dataset in DATASETS:
        if not (data / dataset.folder / dataset.urdf).exists():
            print(f"{dataset.folder}: no logs in {data / dataset.folder}; skipped", file=sys.stderr)
            continue
        lines += rows(data, dataset, options)
        print("\n".join(lines if len(lines) < 8 else lines[-6:]), flush=True)
    table = "\n".join(lines)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(table + "\n")
    print(f"\n{table}\n\nwritten to {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
