"""Models one sample after the other."""

import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run

EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia", "presliding_friction@joint_2", "torque_delay"]


@pytest.fixture(scope="module")
def model(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(demo_robot, demo_logs[:1], effects=EFFECTS)


def test_a_streamed_model_leaves_the_error_of_the_batch(model: sgpr.Model, demo_test: sgpr.Recording) -> None:
    batch = sgpr.compare(model, [demo_test])
    streamed = sgpr.compare_streaming(model, [demo_test])
    causal = sgpr.compare_streaming(model, [demo_test], causal=True)
    assert np.all(streamed.rmse <= 1.1 * batch.rmse)
    assert causal.relative_error_percent > streamed.relative_error_percent
    part = streamed.logs[0]
    predictor = model.predictor(rate_hz=demo_test.sample_rate_hz)
    first = predictor.torque(part.q[0], part.dq[0], part.ddq[0])
    np.testing.assert_allclose(first, part.predicted[0], atol=1e-9)


@pytest.mark.parametrize("causal", [False, True])
def test_logs_of_one_name_keep_their_own_motion(
    demo_model: sgpr.Model, demo_logs: list[sgpr.Recording], causal: bool
) -> None:
    # Logs made of arrays have one name, and their clocks begin at zero.
    logs = [
        sgpr.Recording(log.time_ns - log.time_ns[0], log.q, None, log.tau, joint_names=log.joint_names)
        for log in demo_logs[:2]
    ]
    both = sgpr.compare_streaming(demo_model, logs, causal=causal)
    for own, log in zip(both.logs, logs, strict=True):
        alone = sgpr.compare_streaming(demo_model, [log], causal=causal)
        assert np.array_equal(own.predicted, alone.logs[0].predicted)


def test_hidden_states_are_carried_and_reset(model: sgpr.Model) -> None:
    predictor = model.predictor(rate_hz=250.0)
    assert (predictor.purpose, predictor.rate_hz, predictor.time) == ("expected_measurement", 250.0, 0.0)
    q = np.linspace(0.0, 0.4, 40)[:, None] * np.ones(6)
    zero = np.zeros(6)
    there = np.array([predictor.torque(row, zero, zero) for row in q])
    back = np.array([predictor.torque(row, zero, zero) for row in q[::-1]])[::-1]
    assert np.max(np.abs((there - back)[:-10, 1])) > 1e-3, "friction depends on the way"
    assert predictor.time == pytest.approx(79 / 250.0)
    predictor.reset()
    again = np.array([predictor.torque(row, zero, zero) for row in q])
    np.testing.assert_array_equal(there, again)
    predictor.reset(q[0], time=5.0)
    assert predictor.time == 5.0
    with pytest.raises(sgpr.SgprError, match="give q"):
        predictor.reset(dq=zero)


def test_a_bad_sample_leaves_the_states_alone(model: sgpr.Model) -> None:
    predictor, other = model.predictor(rate_hz=250.0), model.predictor(rate_hz=250.0)
    zero = np.zeros(6)
    for k in range(20):
        q = np.full(6, 0.01 * k)
        with pytest.raises(sgpr.SgprError, match="dq"):
            predictor.torque(q, np.full(6, np.nan), zero)
        with pytest.raises(sgpr.SgprError, match=r"got \(5,\), expected \(6,\)"):
            predictor.torque(q[1:], zero, zero)
        with pytest.raises(sgpr.SgprError, match="out"):
            predictor.torque(q, zero, zero, out=np.zeros(12)[::2])
        with pytest.raises(sgpr.SgprError, match="step"):
            predictor.torque(q, zero, zero, step=-1.0)
        np.testing.assert_array_equal(predictor.torque(q, zero, zero), other.torque(q, zero, zero))


def test_purposes_and_needs(model: sgpr.Model) -> None:
    with pytest.raises(sgpr.SgprError, match=r"torque_delay.*rate_hz"):
        model.predictor()
    with pytest.raises(sgpr.SgprError, match="feed_forward"):
        model.predictor(rate_hz=250.0, purpose="control")  # type: ignore[arg-type]
    with pytest.raises(sgpr.SgprError, match="`payload`"):
        model.predictor(rate_hz=250.0, purpose="feed_forward", keep=["payload"])
    # The delay is one of the log: without it no rate is needed.
    needed = model.predictor(purpose="feed_forward")
    assert needed.purpose == "feed_forward"
    q, dq, ddq = np.full(6, 0.2), np.zeros(6), np.zeros(6)
    kept = model.predictor(rate_hz=250.0, purpose="feed_forward", keep=["torque_delay"])
    np.testing.assert_allclose(needed.torque(q, dq, ddq), kept.torque(q, dq, ddq), atol=1e-9)


def _with(robot: sgpr.Robot, log: sgpr.Recording, effect: sgpr.Effect) -> sgpr.Model:
    sgpr.register_effect(effect)
    return sgpr.identify(robot, [log], effects=["viscous_friction", "coulomb_friction", f"{effect.name}@joint_2"])


def test_effects_of_a_user(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    def spring(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return np.tanh(q[:, joint])

    def late(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], dq[:-1, joint]])

    try:
        model = _with(demo_robot, demo_logs[0], sgpr.Effect("soft_spring", spring, ["k"]))
    except sgpr.SgprError as error:
        pytest.skip(f"effects of a user are not identified by name: {error}")
    q, zero = np.full(6, 0.3), np.zeros(6)
    tau = model.predictor().torque(q, zero, zero)
    np.testing.assert_allclose(tau, model.predict(q[None], zero[None], zero[None])[0], atol=1e-9)
    with_memory = _with(demo_robot, demo_logs[0], sgpr.Effect("late_friction", late, ["k"]))
    with pytest.raises(sgpr.SgprError, match=r"late_friction cannot be streamed: .* other samples"):
        with_memory.predictor()


def test_the_command(model: sgpr.Model, tmp_path: Path, data: Path) -> None:
    path, log = tmp_path / "model.sgpr", data / "demo" / "test.csv.gz"
    model.save(path)
    found = json.loads(run("compare", path, log, "--streaming", "--json").out)
    batch, streaming = found["comparison"], found["streaming"]
    for joint, streamed in zip(batch["joints"], streaming["filtered"]["joints"], strict=True):
        assert streamed["rmse"] <= 1.1 * joint["rmse"]
    assert streaming["causal"]["relative_error_percent"] > batch["relative_error_percent"]
    text = run("compare", path, log, "--streaming").out
    assert "RMSE streamed" in text and "RMSE causal" in text
    assert json.loads(run("compare", path, log, "--json").out)["streaming"] is None
