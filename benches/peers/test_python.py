"""Times sgpr's Python interface against Pinocchio's (pytest-benchmark).

    python -m pytest benches/peers/test_python.py      with sgpr, pin, numpy and pytest-benchmark installed

Pinocchio's Python interface takes one sample at a time; sgpr's takes a whole log.
"""

from pathlib import Path

import numpy as np
import pytest
import sgpr

pinocchio = pytest.importorskip("pinocchio")

URDF = Path(__file__).resolve().parents[2] / "data" / "reference" / "urdf" / "panda_like.urdf"
SAMPLES = 1000


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(1)
    return rng.uniform(-1, 1, (3, SAMPLES, 7))


@pytest.fixture(scope="module")
def ours():
    return sgpr.Robot.from_urdf(URDF)


@pytest.fixture(scope="module")
def theirs():
    model = pinocchio.buildModelFromUrdf(str(URDF))
    return model, model.createData()


def rnea_of_a_log(model, data, motion):
    return np.array([pinocchio.rnea(model, data, q, dq, ddq) for q, dq, ddq in zip(*motion, strict=True)])


def regressor_of_a_log(model, data, motion):
    compute = pinocchio.computeJointTorqueRegressor
    return np.array([compute(model, data, q, dq, ddq) for q, dq, ddq in zip(*motion, strict=True)])


@pytest.mark.benchmark(group="inverse dynamics of 1000 samples")
def test_inverse_dynamics_sgpr(benchmark, ours, theirs, motion):
    torque = benchmark(ours.inverse_dynamics, *motion)
    np.testing.assert_allclose(torque, rnea_of_a_log(*theirs, motion), atol=1e-10)


@pytest.mark.benchmark(group="inverse dynamics of 1000 samples")
def test_inverse_dynamics_pinocchio(benchmark, theirs, motion):
    benchmark(rnea_of_a_log, *theirs, motion)


@pytest.mark.benchmark(group="regressor of 1000 samples")
def test_regressor_sgpr(benchmark, ours, theirs, motion):
    matrix = benchmark(ours.regressor, *motion)
    np.testing.assert_allclose(matrix, regressor_of_a_log(*theirs, motion), atol=1e-10)


@pytest.mark.benchmark(group="regressor of 1000 samples")
def test_regressor_pinocchio(benchmark, theirs, motion):
    benchmark(regressor_of_a_log, *theirs, motion)
