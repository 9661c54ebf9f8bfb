"""Learn what physics leaves over on the logs of real robots, and judge it by logs that no fit has seen.

    python examples/learn_real_robots.py --out out/learned

Robots, logs and their processing are those of `real_robots.py`; settings are as they come.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import sgpr
from real_robots import DATASETS, find_dataset, robot_and_logs

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


def learn(name: str, sparse: bool | None) -> list[str]:
    """Cells of the table for one robot."""
    folder, dataset = find_dataset(name)
    robot, train, test = robot_and_logs(folder, dataset)
    start = time.perf_counter()
    options = dataset.variants[0].options
    model = sgpr.SemiParametricModel(
        robot,
        effects=options.get("effects", ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"]),
        sparse=sparse,
    ).fit(train)
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


def main() -> None:
    """Learn all robots and write a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/learned"))
    parser.add_argument("--robots", nargs="+", default=[dataset.folder for dataset in DATASETS])
    parser.add_argument("--rows", choices=CHOICES, default="chosen", help="how more rows than points are seen")
    arguments = parser.parse_args()
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    for name in arguments.robots:
        lines.append("| " + " | ".join(learn(name, CHOICES[arguments.rows])) + " |")
        print(lines[-1], flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / f"learned_{arguments.rows}.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
