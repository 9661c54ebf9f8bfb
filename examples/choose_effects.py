"""Which effects a consistent model needs, chosen from training logs alone: one after the other, by cross-validation.

    python examples/choose_effects.py panda --steps 3

Every effect of a short list at every joint is added to the consistent model; the three with the least training error
are judged by predicting each log (each quarter of a single one) from the others. The best stays as long as that error
falls by half a percent. The errors on the test log are printed beside, and decide nothing. SGPR_DATA names the folder
of the logs.
"""

import argparse
import math
import sys

import sgpr
from consistent_robots import AT_THE_LINK, FRICTION
from real_robots import DATASETS, EFFECTS, find_dataset, robot_and_logs

KINDS = [
    "cable_stiffness",
    "cable_hysteresis",
    "presliding_friction",
    "stribeck_friction",
    "asymmetric_coulomb_friction",
    "asymmetric_viscous_friction",
    "torque_gain_error",
    "spring_balancer",
]
JUDGED = 3
WORTH = 0.995
PARTS = 4


class Choice:
    """A robot, its logs, and the effects chosen so far."""

    def __init__(self, robot: sgpr.Robot, train: list[sgpr.Recording], test: list[sgpr.Recording], effects: list[str]):
        self.robot, self.train, self.test, self.first = robot, train, test, tuple(effects)
        processing = sgpr.identify(robot, train, effects=effects).processing
        assert processing is not None
        self.cutoff_hz = processing.cutoff_hz
        self.parts = train
        if len(train) == 1:
            count = len(train[0])
            self.parts = [train[0].slice(k * count // PARTS, (k + 1) * count // PARTS) for k in range(PARTS)]

    def model(self, logs: list[sgpr.Recording], effects: list[str], consistent: bool) -> sgpr.Model:
        """The model of some logs."""
        return sgpr.identify(self.robot, logs, effects=effects, consistent=consistent, cutoff_hz=self.cutoff_hz)

    def cross_validated(self, effects: list[str], consistent: bool = True) -> float:
        """Root mean square of the errors of all parts, each predicted from the others, %."""
        squares = 0.0
        for part in self.parts:
            others = [other for other in self.parts if other is not part]
            squares += sgpr.compare(self.model(others, effects, consistent), [part]).relative_error_percent ** 2
        return math.sqrt(squares / len(self.parts))

    def line(self, effects: list[str]) -> str:
        """One line of the table."""
        added = ", ".join(f"`{name}`" for name in effects if name not in self.first) or "-"
        kept_out = [self.cross_validated(effects, consistent) for consistent in (False, True)]
        models = [self.model(self.train, effects, consistent) for consistent in (False, True)]
        free, bound = (sgpr.compare(model, self.test).relative_error_percent for model in models)
        loss = 100.0 * (bound / free - 1.0)
        return f"| {added} | {kept_out[0]:.3f} | {kept_out[1]:.3f} | {free:.3f} | {bound:.3f} | {loss:+.1f} % |"

    def next(self, effects: list[str], error: float) -> tuple[float, str] | None:
        """The effect to add and the cross-validated error with it."""
        candidates = []
        for name in (f"{kind}@{joint}" for kind in KINDS for joint in self.robot.joint_names):
            if name in effects:
                continue
            try:
                model = self.model(self.train, [*effects, name], True)
            except sgpr.IdentificationError as refused:
                # A spring of two ends belongs to joints that turn; what logs cannot show, they cannot choose.
                print(f"{name}: {refused}", file=sys.stderr)
                continue
            candidates.append((sgpr.compare(model, self.train).relative_error_percent, name))
        best = sorted(candidates)[:JUDGED]
        found = min(((self.cross_validated([*effects, name]), name) for _, name in best), default=(math.inf, ""))
        return found if found[0] < WORTH * error else None


def main() -> int:
    """Choose, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=[dataset.folder for dataset in DATASETS])
    parser.add_argument("--steps", type=int, default=3)
    arguments = parser.parse_args()
    robot, train, test = robot_and_logs(*find_dataset(arguments.robot))
    effects = list(FRICTION if arguments.robot in AT_THE_LINK else EFFECTS)
    choice = Choice(robot, train, test, effects)
    print("| added | parts kept out: unconstrained | consistent | test log: unconstrained | consistent | loss |")
    print("|---|---:|---:|---:|---:|---:|")
    print(choice.line(effects), flush=True)
    error = choice.cross_validated(effects)
    for _ in range(arguments.steps):
        found = choice.next(effects, error)
        if found is None:
            break
        error, name = found
        effects.append(name)
        print(choice.line(effects), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
