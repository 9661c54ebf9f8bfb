"""Diagnose each half of the training logs of three real robots, and count on what they agree.

    python examples/diagnose_halves.py

What is there shows in both halves: the first, third, fifth log and the second, fourth, sixth. The logs are those of
`real_robots.py`; SGPR_DATA names their folder.
"""

import argparse
import sys
from pathlib import Path

import sgpr
from diagnose_real_robots import model_of, told
from real_robots import DATASETS, Dataset, data_folder, robot_and_logs

ROBOTS = ("ur10e", "baxter", "kuka_lwr")


def names(findings: list[sgpr.Finding]) -> set[tuple[str, ...]]:
    """Effects and where they act."""
    return {(finding.effect, *finding.joints) for finding in findings}


def rows(folder: Path, dataset: Dataset) -> list[str]:
    """A line for each half and the share of what they name that both name."""
    robot, train, test = robot_and_logs(folder, dataset)
    lines, named = [], []
    for label, logs in (("odd", train[0::2]), ("even", train[1::2])):
        model = model_of(robot, logs)
        diagnosis = sgpr.diagnose(model, logs, test)
        before, after = (sgpr.compare(each, test).relative_error_percent for each in (model, diagnosis.model))
        likely = [finding for finding in diagnosis.findings if finding.probability > 0.5]
        named.append(names(likely))
        found = "; ".join(told(finding) for finding in likely) or diagnosis.verdict
        lines.append(f"| {dataset.folder}, {label} logs | {found} | {before:.2f} | {after:.2f} |")
    both, count = named[0] & named[1], len(named[0]) + len(named[1])
    share = f"{100 * 2 * len(both) / max(count, 1):.0f} % of what is named"
    lines.append(f"| {dataset.folder} | {len(both)} of {count - len(both)} in both: {share} | | |")
    return lines


def main() -> int:
    """Diagnose the halves of every robot whose logs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the logs (default: what SGPR_DATA names)")
    data = data_folder(parser.parse_args().data)
    found = [dataset for dataset in DATASETS if dataset.folder in ROBOTS and (data / dataset.folder).exists()]
    if not found:
        print("no logs found: set SGPR_DATA to the folder that holds them (see docs/real-data.md)", file=sys.stderr)
        return 1
    print("| half | findings | unseen before, % | after, % |\n|---|---|---|---|")
    for dataset in found:
        print("\n".join(rows(data / dataset.folder, dataset)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
