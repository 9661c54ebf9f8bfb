"""Real robots whose logs lack an effect that is documented."""

import sys
from pathlib import Path

import pytest
import sgpr
from conftest import outside

EXAMPLES = Path(__file__).parents[3] / "examples"


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
    folder = outside(f"real/{name}")
    sys.path.insert(0, str(EXAMPLES))
    try:
        from diagnose_real_robots import DATASETS, model_of, recordings
    finally:
        sys.path.remove(str(EXAMPLES))
    dataset = next(dataset for dataset in DATASETS if dataset.folder == name)
    robot = sgpr.Robot.from_urdf(folder / dataset.urdf)
    train = recordings(folder, robot, dataset, dataset.train)
    test = recordings(folder, robot, dataset, dataset.test)
    model = model_of(robot, train)

    diagnosis = sgpr.diagnose(model, train, test)

    first = diagnosis.findings[0]
    assert first.effect == effect
    assert first.joints[0] == joint
    assert sgpr.compare(diagnosis.model, test).relative_error_percent < reference
