"""The payload of a real UR10e, 2.805 kg, weighed with known gains, and its gains from the known mass.

    python examples/weigh_payload.py

The tables are those of `docs/estimators.md`. SGPR_DATA names the folder of the logs (`docs/real-data.md`). The logs
hold target currents and target torques of the controller, too: the slope of one over the other is the constant that
the controller works with.
"""

import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np
import sgpr
from diagnose_real_robots import LOADED
from real_robots import UR10E_GAINS, Dataset, Log, find_dataset, recordings

MASS = 2.805
MOVES = 0.05
"""Speed above which a joint counts as moving, rad/s."""
BOUND = {"consistent": True, "lowest": [10.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
PUBLISHED_WAY: dict[str, Any] = {"estimator": "least_squares", "standstill_speed": 1e-9, **BOUND}


def controller_constants(paths: list[Path]) -> np.ndarray:
    """Slope of the target torque over the target current of every joint while it moves, N·m/A.

    The target current holds the friction that the controller compensates, too: that is fitted beside the slope.
    """
    logs = []
    for path in paths:
        with path.open(newline="") as lines:
            logs += list(csv.DictReader(lines))
    constants = []
    for joint in range(1, 7):
        names = (f"i_des{joint}_A", f"tau_des{joint}_Nm", f"dq{joint}_rad_s")
        current, torque, speed = np.array([[float(row[name]) for name in names] for row in logs]).T
        columns = np.column_stack([torque, np.sign(speed), speed, speed * np.abs(speed), np.ones_like(speed)])
        moves = np.abs(speed) > MOVES
        constants.append(1.0 / np.linalg.lstsq(columns[moves], current[moves], rcond=None)[0][0])
    return np.array(constants)


def numbers(values: Any) -> str:
    """Gains with two digits after the point."""
    return " ".join(f"{value:.2f}" for value in values)


class Pair:
    """Logs of the currents without and with the payload, and those of the excitation."""

    def __init__(self, folder: Path, dataset: Dataset) -> None:
        self.robot = sgpr.Robot.from_urdf(folder / dataset.urdf)
        self.folder, self.dataset = folder, dataset
        self.without, self.loaded = self.logs(dataset.test), self.logs([LOADED])
        self.excitation = self.logs(dataset.train)

    def logs(self, names: list[Log]) -> list[sgpr.Recording]:
        """Currents as they are, with gains of one."""
        read = {**self.dataset.read, "torque_constants": [1.0] * 6}
        plain = Dataset(**{**vars(self.dataset), "read": read})
        return recordings(self.folder, self.robot, plain, names)

    def weighed(self, gains: Any) -> str:
        """The payload's mass with these gains, kg."""
        logs = [[scaled(log, gains) for log in role] for role in (self.without, self.loaded)]
        payload = sgpr.identify_payload(self.robot, *logs)
        deviation = payload.standard_deviations[0]
        return f"{payload.mass:.3f} ± {deviation:.3f} | {100.0 * (payload.mass / MASS - 1.0):+.1f} %"

    def gains(self, with_excitation: bool, options: dict[str, Any]) -> sgpr.DriveGains:
        """Of all drives, with the mass known."""
        without = [*self.without, *(self.excitation if with_excitation else [])]
        return sgpr.identify_drive_gains(self.robot, without, self.loaded, payload={"m": MASS}, **options)


def scaled(log: sgpr.Recording, gains: Any) -> sgpr.Recording:
    """The log with torques in the place of its currents."""
    assert log.tau is not None
    tau = log.tau * np.asarray(gains)
    return sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names, source=log.source)


BOUNDED = "least squares, bodies, first gain at least 10"
VARIANTS: list[tuple[str, str, str, bool, dict[str, Any]]] = [
    ("default", "pair and excitation", "automatic", True, {}),
    ("default", "pair", "automatic", False, {}),
    *(("default", "pair and excitation", f"{hz:g} Hz", True, {"cutoff_hz": hz}) for hz in (7.0, 11.0)),
    ("default, bodies", "pair and excitation", "automatic", True, {"consistent": True}),
    *((BOUNDED, "pair, rests counted", f"{hz:g} Hz", False, {**PUBLISHED_WAY, "cutoff_hz": hz}) for hz in (7.0, 11.0)),
]


def main() -> int:
    """Print the tables."""
    folder, dataset = find_dataset("ur10e")
    pair = Pair(folder, dataset)
    files = [log.file for log in (*dataset.test, LOADED)]
    constants = controller_constants([folder / name for name in files])
    found = pair.gains(True, {})
    print("| gains | N·m/A | payload, kg | off by |\n|---|---|---:|---:|")
    for words, gains in (
        ("constants of the controller", constants),
        ("found with the mass known", found.gains),
        ("published with the logs", UR10E_GAINS),
    ):
        print(f"| {words} | {numbers(gains)} | {pair.weighed(gains)} |", flush=True)
    print("\n| estimator | logs | cut-off | joints 1 to 6 | off the controller's, at most |\n|---|---|---|---|---:|")
    for words, logs, cutoff, with_excitation, options in VARIANTS:
        gains = pair.gains(with_excitation, options).gains
        off = 100.0 * np.abs(gains / constants - 1.0).max()
        print(f"| {words} | {logs} | {cutoff} | {numbers(gains)} | {off:.1f} % |", flush=True)
    off = 100.0 * np.abs(np.array(UR10E_GAINS) / constants - 1.0).max()
    print(f"| published (Mamedov, Mikhel) | | | {numbers(UR10E_GAINS)} | {off:.1f} % |")
    deviations = found.standard_deviations
    print(f"\ndefault, pair and excitation: standard deviations {numbers(deviations)} N·m/A")
    return 0


if __name__ == "__main__":
    sys.exit(main())
