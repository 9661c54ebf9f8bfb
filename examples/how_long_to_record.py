"""How much data a model needs: the error on an unseen log after shorter and longer pieces of the bundled logs.

python examples/how_long_to_record.py
"""

from pathlib import Path

import sgpr

DEMO = Path(__file__).parents[1] / "data" / "demo"
EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
SECONDS = (1.0, 2.0, 4.0, 8.0, 16.0)


def main() -> None:
    """Print a row for each length, and one for all three logs."""
    robot = sgpr.Robot.from_urdf(DEMO / "robot.urdf")
    logs = [sgpr.read(DEMO / f"train_{number}.csv.gz") for number in (1, 2, 3)]
    test = [sgpr.read(DEMO / "test.csv.gz")]
    print("| logs | seconds | condition number | error on unseen motion, % |\n|---|---|---|---|")
    pieces = [[logs[0].between(0.0, seconds)] for seconds in SECONDS]
    for train in [*pieces, logs[:1], logs[:2], logs]:
        seconds = sum(log.duration for log in train)
        model = sgpr.identify(robot, train, effects=EFFECTS)
        assert model.fit is not None
        unseen = sgpr.compare(model, test).relative_error_percent
        print(f"| {len(train)} | {seconds:.0f} | {model.fit['scaled_condition']:.0f} | {unseen:.2f} |")


if __name__ == "__main__":
    main()
