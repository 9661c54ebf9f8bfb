"""Real robots whose logs lack an effect that is documented."""

import sys
from pathlib import Path

import pytest
import sgpr
from conftest import outside

EXAMPLES = Path(__file__).parents[3] / "examples"


def robot_and_logs(name: str) -> tuple[sgpr.Robot, list[sgpr.Recording], list[sgpr.Recording]]:
    """Of a real set: training logs, then test logs."""
    folder = outside(f"real/{name}")
    sys.path.insert(0, str(EXAMPLES))
    try:
        from diagnose_real_robots import DATASETS, recordings
    finally:
        sys.path.remove(str(EXAMPLES))
    dataset = next(dataset for dataset in DATASETS if dataset.folder == name)
    robot = sgpr.Robot.from_urdf(folder / dataset.urdf)
    return robot, recordings(folder, robot, dataset, dataset.train), recordings(folder, robot, dataset, dataset.test)


@pytest.mark.parametrize(
    ("name", "effect", "joint", "reference"),
    [
        # Springs at the shoulder carry part of gravity; 9.3 % is least squares that is told of them.
        ("baxter", "spring_balancer", "baxter_j2", 9.3),
        # A worn screw (Janot, Gautier, Brunot (2019)); 5.402 % is their protocol with asymmetric viscous friction.
        ("emps", "asymmetric_viscous_friction", "slide", 5.402),
    ],
)
def test_the_documented_effect_comes_first(name: str, effect: str, joint: str, reference: float) -> None:
    robot, train, test = robot_and_logs(name)
    sys.path.insert(0, str(EXAMPLES))
    try:
        from diagnose_real_robots import model_of
    finally:
        sys.path.remove(str(EXAMPLES))
    model = model_of(robot, train)

    diagnosis = sgpr.diagnose(model, train, test)

    first = diagnosis.findings[0]
    assert first.effect == effect
    assert first.joints[0] == joint
    assert sgpr.compare(diagnosis.model, test).relative_error_percent < reference


def test_no_finding_is_less_probable_than_not() -> None:
    # Without offsets, a tilted base and forces of springs stand for them, none of them for sure.
    robot, train, test = robot_and_logs("kuka_lwr")
    model = sgpr.identify(robot, train, effects=["viscous_friction", "coulomb_friction"])

    diagnosis = sgpr.diagnose(model, train, test)

    assert all(finding.probability >= 0.5 for finding in diagnosis.findings)
    assert diagnosis.verdict == "unexplained_structure"
    assert any("none is more probable than not" in words for words in diagnosis.unexplained)
