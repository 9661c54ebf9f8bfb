"""Whether joints that stand are told from joints that move, chosen by the training logs: errors of five real robots.

    python examples/choose_rests.py [ROBOT...]

While a joint stands, dry friction holds it with any torque inside the Coulomb band. By default its speed is then set to
zero and its rows weigh by noise of their own; with a standstill speed of almost zero every row is motion. Which of
the two predicts better depends on how a robot stands. Fifths of the training logs, each predicted from the other four,
choose for each robot; the test logs are looked at with both to show what the choice brings. Errors are those of all
samples in the band of the reference, rests included, percent of the torque. The table is the one in
`research/consistency.md`; `docs/real-data.md` says where the logs come from, SGPR_DATA names their folder.
"""

import sys
from typing import Any

import numpy as np
import sgpr
from consistent_robots import fifths
from real_robots import DATASETS, EFFECTS, find_dataset, robot_and_logs

STANDING: dict[str, dict[str, Any]] = {"told apart": {}, "all motion": {"standstill_speed": 1e-9}}
HEADER = """\
| robot | joints that stand | parts kept out: unconstrained | consistent | test logs: unconstrained | consistent \
| loss | reference |
|---|---|---:|---:|---:|---:|---:|---:|"""

Logs = list[sgpr.Recording]


def error(robot: sgpr.Robot, known: Logs, new: Logs, options: dict[str, Any]) -> float:
    """Of a model of `known` logs on `new` ones, rests included, %."""
    model = sgpr.identify(robot, known, effects=EFFECTS, **options)
    return sgpr.compare(model, new).relative_error_with_rests_percent


def errors(name: str, standing: dict[str, Any]) -> tuple[float, float, float, float]:
    """Unconstrained and consistent, on parts of the training logs that were kept out and on the test logs, %."""
    folder, dataset = find_dataset(name)
    robot, train, test = robot_and_logs(folder, dataset)
    band = {key: value for key, value in dataset.reference.items() if key != "standstill_speed"}
    parts = fifths(train, shortest=8.0 / band["cutoff_hz"])
    free, bound = ({**band, **standing, "consistent": consistent} for consistent in (False, True))
    kept_out = (np.sqrt(np.mean([error(robot, *part, each) ** 2 for part in parts])) for each in (free, bound))
    return (*map(float, kept_out), error(robot, train, test, free), error(robot, train, test, bound))


def main() -> int:
    """Print the table; the choice of each robot is marked."""
    print(HEADER)
    references = {dataset.folder: dataset.variants[0].reference for dataset in DATASETS}
    for name in sys.argv[1:] or references:
        rows = {words: errors(name, standing) for words, standing in STANDING.items()}
        # Of what is as good to a hundredth the first, which is the default.
        chosen = min(rows, key=lambda words: round(rows[words][1], 2))
        for words, (kept_free, kept_bound, free, bound) in rows.items():
            mark = " (chosen)" if words == chosen else ""
            print(
                f"| `{name}` | {words}{mark} | {kept_free:.2f} | {kept_bound:.2f} | {free:.3f} | {bound:.3f} "
                f"| {100.0 * (bound / free - 1.0):+.1f} % | {references[name]} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
