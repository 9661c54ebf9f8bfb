"""Ask of five real robots which effect their model lacks, and watch the error on logs that no fit saw.

    python examples/diagnose_real_robots.py
    python examples/diagnose_real_robots.py --parts 12
    python examples/diagnose_real_robots.py --alike

The logs are those of `real_robots.py`; SGPR_DATA names their folder. On the UR10e a second session has logs without
and one with a payload of 2.805 kg one after the other. With `--parts` so many parts of each robot's logs, drawn at
random, are diagnosed alone. With `--alike` the Panda is identified with either of two effects that look alike.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import sgpr
from real_robots import DATASETS, EFFECTS, Dataset, Log, data_folder, find_dataset, recordings, robot_and_logs

PAUSE_S = 5.0
NO_WORSE = 1.02
BETTER = 0.9
# Length of parts.
SHORTEST_S, LONGEST_S = 6.0, 30.0
SEED = 0

UNLOADED = [
    Log("excitation_30s_12harm.csv", (635, 3510)),
    Log("excitation_40s_12harm.csv", (500, 4460)),
    Log("pair14_unloaded.csv", (195, 4966)),
]
LOADED = Log("pair14_load_2p805kg.csv", (308, 5071))


def model_of(robot: sgpr.Robot, train: list[sgpr.Recording]) -> sgpr.Model:
    """The model that the diagnosis starts from."""
    return sgpr.identify(robot, train, effects=EFFECTS)


def part(log: sgpr.Recording, first: int, last: int, start_s: float) -> sgpr.Recording:
    """Samples of a log, on a clock at which the first one of the whole log is at `start_s`."""
    clock = log.time_ns - log.time_ns[0] + round(start_s * 1e9)
    rows = slice(first, last)
    assert log.tau is not None
    speed = None if log.dq is None else log.dq[rows]
    return sgpr.Recording(
        clock[rows], log.q[rows], speed, log.tau[rows], joint_names=log.joint_names, source=log.source
    )


def payload_session(
    folder: Path, robot: sgpr.Robot, dataset: Dataset
) -> tuple[list[sgpr.Recording], list[sgpr.Recording]]:
    """The UR10e without, then with its payload; half of the last log is kept for the test."""
    logs = [recordings(folder, robot, dataset, [log])[0] for log in (*UNLOADED, LOADED)]
    session, start = [], 0.0
    for log in logs:
        session.append(part(log, 0, len(log), start))
        start = float(session[-1].time_ns[-1]) * 1e-9 + PAUSE_S
    last, half = session.pop(), len(logs[-1]) // 2
    first_s = float(last.time_ns[0]) * 1e-9
    return [*session, part(last, 0, half, first_s)], [part(last, half, len(last), first_s)]


def told(finding: sgpr.Finding) -> str:
    """A finding in a few words."""
    where = f" at {', '.join(finding.joints)}" if finding.joints else ""
    mass = f", {finding.parameters['m'][0]:.2f} kg" if "m" in finding.parameters else ""
    return f"{finding.effect}{where} ({finding.probability:.2f}{mass})"


def row(name: str, model: sgpr.Model, train: list[sgpr.Recording], test: list[sgpr.Recording]) -> str:
    """One line of the table."""
    clock = time.perf_counter()
    diagnosis = sgpr.diagnose(model, train, test)
    seconds = time.perf_counter() - clock
    before, after = (sgpr.compare(each, test).relative_error_percent for each in (model, diagnosis.model))
    findings = "; ".join(told(finding) for finding in diagnosis.findings) or diagnosis.verdict
    samples = int(np.sum([len(log) for log in train]))
    return f"| {name} | {findings} | {before:.2f} | {after:.2f} | {samples} | {seconds:.0f} |"


def short(log: sgpr.Recording, seconds: float, start: float = 0.0) -> sgpr.Recording:
    """So many seconds of a log."""
    first, last = np.searchsorted(log.time_ns, log.time_ns[0] + np.round([start * 1e9, (start + seconds) * 1e9]))
    return part(log, int(first), int(last), 0.0)


def ratio_of_short(
    robot: sgpr.Robot, log: sgpr.Recording, test: list[sgpr.Recording], seconds: float, start: float = 0.0
) -> float:
    """Unseen error with the findings over that of the model without them; both know so many seconds of a log."""
    train = [short(log, seconds, start)]
    model = model_of(robot, train)
    before, after = (
        sgpr.compare(each, test).relative_error_percent for each in (model, sgpr.diagnose(model, train).model)
    )
    return after / before


def row_of_parts(name: str, robot: sgpr.Robot, logs: list[sgpr.Recording], count: int) -> str:
    """One line of the table of parts, each of a log drawn at random and judged on all other logs."""
    random = np.random.default_rng(SEED)
    ratios = []
    for _ in range(count):
        index = int(random.integers(len(logs)))
        length = float(logs[index].time_ns[-1] - logs[index].time_ns[0]) * 1e-9
        seconds = random.uniform(SHORTEST_S, max(SHORTEST_S, min(length, LONGEST_S)))
        start = random.uniform(0.0, max(length - seconds, 0.0))
        others = logs[:index] + logs[index + 1 :]
        ratios.append(ratio_of_short(robot, logs[index], others, seconds, start))
    mean = float(np.exp(np.mean(np.log(ratios))))
    worse, better = sum(ratio > NO_WORSE for ratio in ratios), sum(ratio < BETTER for ratio in ratios)
    return f"| {name} | {count} | {mean:.2f} | {max(ratios):.2f} | {worse} | {better} |"


def alike() -> None:
    """Print what models of the Panda leave, with either of two effects at all joints and without."""
    robot, train, test = robot_and_logs(*find_dataset("panda"))
    print("| effect at all joints | training log, % | unseen log, % |\n|---|---:|---:|")
    for effect in ("none", "coulomb_transition", "presliding_friction"):
        model = sgpr.identify(robot, train, effects=EFFECTS if effect == "none" else [*EFFECTS, effect])
        errors = (sgpr.compare(model, logs).relative_error_percent for logs in (train, test))
        print(f"| {effect} | {' | '.join(f'{error:.2f}' for error in errors)} |", flush=True)


def main() -> int:
    """Diagnose every robot whose logs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the logs (default: what SGPR_DATA names)")
    parser.add_argument("--parts", type=int, default=0, help="number of parts of each robot's logs")
    parser.add_argument("--alike", action="store_true", help="the Panda with either of two effects")
    options = parser.parse_args()
    if options.alike:
        alike()
        return 0
    data = data_folder(options.data)
    found = [dataset for dataset in DATASETS if (data / dataset.folder / dataset.urdf).exists()]
    if not found:
        print("no logs found: set SGPR_DATA to the folder that holds them (see docs/real-data.md)", file=sys.stderr)
        return 1
    if options.parts > 0:
        print("| robot | parts | unseen error, after over before | worst | above 1.02 | below 0.9 |")
        print("|---|---|---|---|---|---|")
        for dataset in found:
            robot, train, test = robot_and_logs(data / dataset.folder, dataset)
            print(row_of_parts(dataset.folder, robot, [*train, *test], options.parts), flush=True)
        return 0
    print("| robot | findings | unseen before, % | after, % | samples | s |\n|---|---|---|---|---|---|")
    for dataset in found:
        folder = data / dataset.folder
        robot, train, test = robot_and_logs(folder, dataset)
        print(row(dataset.folder, model_of(robot, train), train, test), flush=True)
        if dataset.folder == "ur10e":
            train, test = payload_session(folder, robot, dataset)
            print(row("ur10e, takes 2.805 kg", model_of(robot, train), train, test), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
