"""Learn what physics leaves over on the logs of real robots, and judge it by logs that no fit has seen.

    python examples/learn_real_robots.py --out out/learned
    python examples/learn_real_robots.py --out out/learned --seconds 5 10 20

Robots, logs and their processing are those of `real_robots.py`; settings are as they come. With `--seconds` the first
seconds of the training logs are learned, with each log first in turn.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import sgpr
from how_much_data import duration, first_seconds
from real_robots import DATASETS, EFFECTS, find_dataset, robot_and_logs

CHOICES = {"chosen": None, "subset": False, "sparse": True}

COLUMNS = [
    "robot",
    "physics, %",
    "semi-parametric, %",
    "RMSE of the joints, semi-parametric over physics",
    "within 68 % / 95 % intervals",
    "the same, following (mean factors on the widths)",
    "rows are seen by",
]

SHORT_COLUMNS = [
    "robot",
    "training, s",
    "starts",
    "semi-parametric over physics, median",
    "worst",
    "within 68 %, mean (starts)",
    "within 95 %, mean (starts)",
]


def learn(name: str, sparse: bool | None) -> list[str]:
    """Cells of the table for one robot."""
    folder, dataset = find_dataset(name)
    robot, train, test = robot_and_logs(folder, dataset)
    start = time.perf_counter()
    effects = dataset.variants[0].options.get("effects", EFFECTS)
    model = sgpr.SemiParametricModel(robot, effects=effects, sparse=sparse).fit(train)
    wall = time.perf_counter() - start
    physics, both = sgpr.compare(model.physics_, test), model.compare(test)
    ratios = [after.rmse / before.rmse for before, after in zip(physics.joints, both.joints, strict=True)]
    plain, following = model.coverage(test), model.coverage(test, following=True)

    def shares(rows: list[dict[str, float]]) -> str:
        return " / ".join(f"{np.mean([row[key] for row in rows]):.0f}" for key in ("percent_68", "percent_95"))

    def factor(key: str) -> float:
        return float(np.mean([late[key] / row[key] for late, row in zip(following, plain, strict=True)]))

    factors = [factor(key) for key in ("half_width_68", "half_width_95")]
    print(f"{name}, sparse={sparse}: {wall:.0f} s", flush=True)
    return [
        name,
        f"{physics.relative_error_percent:.3f}",
        f"{both.relative_error_percent:.3f}",
        " ".join(f"{ratio:.2f}" for ratio in ratios),
        shares(plain),
        f"{shares(following)} ({factors[0]:.2f}, {factors[1]:.2f})",
        " ".join(report["inference"] if report["inputs"] else "-" for report in model.reports_),
    ]


def learn_short(name: str, seconds: float) -> list[str] | None:
    """Cells of the table of short logs for one robot; none if it has no more seconds than that."""
    folder, dataset = find_dataset(name)
    robot, train, test = robot_and_logs(folder, dataset)
    if seconds >= duration(train):
        return None
    effects = dataset.variants[0].options.get("effects", EFFECTS)
    ratios, within = [], []
    for first in range(len(train)):
        logs = first_seconds(train[first:] + train[:first], seconds)
        model = sgpr.SemiParametricModel(robot, effects=effects).fit(logs)
        physics, both = sgpr.compare(model.physics_, test), model.compare(test)
        ratios.append(both.relative_error_percent / physics.relative_error_percent)
        rows = model.coverage(test)
        within.append([float(np.mean([row[key] for row in rows])) for key in ("percent_68", "percent_95")])
    print(f"{name}, {seconds:g} s", flush=True)

    def shares(column: int) -> str:
        own = [row[column] for row in within]
        spread = f" ({min(own):.0f} to {max(own):.0f})" if len(own) > 1 else ""
        return f"{np.mean(own):.0f}{spread}"

    return [
        name,
        f"{seconds:g}",
        f"{len(train)}",
        f"{np.median(ratios):.3f}",
        f"{max(ratios):.3f}",
        shares(0),
        shares(1),
    ]


def main() -> None:
    """Learn all robots and write a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/learned"))
    parser.add_argument("--robots", nargs="+", default=[dataset.folder for dataset in DATASETS])
    parser.add_argument("--rows", choices=CHOICES, default="chosen", help="how more rows than points are seen")
    parser.add_argument("--seconds", nargs="+", type=float, help="of training, in place of whole logs")
    arguments = parser.parse_args()
    if arguments.seconds:
        columns, file = SHORT_COLUMNS, "learned_short.md"
        found = [learn_short(name, seconds) for name in arguments.robots for seconds in arguments.seconds]
        cells = [row for row in found if row is not None]
    else:
        columns, file = COLUMNS, f"learned_{arguments.rows}.md"
        cells = [learn(name, CHOICES[arguments.rows]) for name in arguments.robots]
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(row) + " |" for row in cells]
    print("\n".join(lines))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / file).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
