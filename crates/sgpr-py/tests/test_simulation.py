"""Simulated experiments."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr

ROBOT = sgpr.robots.two_link()
DRIVES = sgpr.robots.two_link_drives()


def sines(seconds: float = 2.0, rate_hz: float = 200.0) -> tuple[float, Any, Any, Any]:
    """A motion from rest."""
    t = np.arange(int(seconds * rate_hz) + 1)[:, None] / rate_hz
    w = np.array([2.0, 3.0])
    return rate_hz, 0.3 * (1 - np.cos(w * t)), 0.3 * w * np.sin(w * t), 0.3 * w**2 * np.cos(w * t)


def test_a_true_model_follows_and_feedback_alone_does_not() -> None:
    parameters = np.concatenate([ROBOT.standard_parameters, [0.4, 0.3], [0.5, 0.2]])
    truth = sgpr.Model.from_parameters(ROBOT, parameters, effects=["viscous_friction", "rotor_inertia"])
    reference = sines()
    followed = sgpr.simulate(truth, reference, model=truth)
    alone = sgpr.simulate(truth, reference, model=truth, controller="pd")
    assert followed.tracking_rmse.max() < 2e-3
    assert alone.tracking_rmse.max() > 0.05
    assert followed.q.shape == (2000, 2)
    assert not followed.q.flags.writeable
    recording = followed.recording("run")
    assert recording.joint_names == ROBOT.joint_names
    assert np.array_equal(recording.tau, followed.tau_measured)


def test_feed_forward_and_a_user_controller_are_the_built_in_law() -> None:
    reference = sines()
    built_in = sgpr.simulate(ROBOT, reference, drives=DRIVES, kp=80.0, kd=[6.0, 5.0])

    def law(t: float, q: Any, dq: Any, q_wanted: Any, dq_wanted: Any, ddq_wanted: Any) -> Any:
        model = ROBOT.inverse_dynamics(q_wanted, dq_wanted, ddq_wanted)
        return model + 80.0 * (q_wanted - q) + np.array([6.0, 5.0]) * (dq_wanted - dq)

    own = sgpr.simulate(ROBOT, reference, drives=DRIVES, controller=law)
    assert np.abs(own.q - built_in.q).max() < 1e-9
    prepared = ROBOT.inverse_dynamics(built_in.q_wanted, built_in.dq_wanted, built_in.ddq_wanted)
    scheduled = sgpr.simulate(
        ROBOT, reference, drives=DRIVES, controller="pd", kp=80.0, kd=[6.0, 5.0], feed_forward=prepared
    )
    assert np.abs(scheduled.q - built_in.q).max() < 1e-9


def test_the_same_arguments_give_the_same_bits() -> None:
    options: dict[str, Any] = {
        "drives": DRIVES,
        "position_resolution": [1e-4, 1e-4],
        "torque_noise": [0.1, 0.1],
        "actuation_noise": [0.05, 0.05],
        "velocity": "difference",
        "delay": 1e-3,
    }
    one, same, other = (sgpr.simulate(ROBOT, sines(), random_state=seed, **options) for seed in (1, 1, 2))
    assert np.array_equal(one.q, same.q) and np.array_equal(one.tau_measured, same.tau_measured)
    assert not np.array_equal(one.q, other.q)


def test_an_exception_of_the_controller_arrives() -> None:
    def broken(*_: Any) -> Any:
        raise ZeroDivisionError("in the controller")

    with pytest.raises(ZeroDivisionError, match="in the controller"):
        sgpr.simulate(ROBOT, [0.0, 0.0], duration=0.1, controller=broken)


def test_progress_is_told_and_stops() -> None:
    heard = []
    sgpr.simulate(ROBOT, [0.0, 0.0], duration=3.0, progress=lambda *step: heard.append(step))
    assert heard[-1] == ("simulate", 12000, 12000)

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sgpr.simulate(ROBOT, [0.0, 0.0], duration=3.0, progress=stop)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "runs away": ({"kp": 1e7, "kd": 1e6}, "ran away: its speed is"),
    "no number": ({"controller": lambda *_: [np.nan, 0.0]}, "the controller gives NaN for joint `joint_1` at 0.000000"),
    "shape": ({"controller": lambda *_: [0.0]}, r"got \(1,\), expected \(2,\)"),
    "period": ({"control_period": 1.1e-3}, "a whole number of steps"),
    "law": ({"controller": "pid"}, "expected 'feed_forward' or 'computed_torque'"),
    "drives": ({"drives": DRIVES[:1]}, "got 1 value for 2 joints"),
    "gain": ({"kp": [1.0, 2.0, 3.0]}, r"kp: got \(3,\), expected \(2,\)"),
    "joints": ({"model": sgpr.robots.puma560()}, "it has 6 joints, the arm has 2"),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_arguments(case: str) -> None:
    options, message = WRONG[case]
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.simulate(ROBOT, sines(), **options)


def test_a_position_has_no_duration() -> None:
    with pytest.raises(sgpr.SgprError, match="duration"):
        sgpr.simulate(ROBOT, [0.0, 0.0])


def test_a_page_shows_tracking(tmp_path: Path) -> None:
    robot = sgpr.robots.two_link()
    run = sgpr.simulate(robot, [0.3, -0.2], duration=0.5, drives=sgpr.robots.two_link_drives())
    sgpr.save_report(run, robot, tmp_path / "tracking.html")
    page = (tmp_path / "tracking.html").read_text()
    for text in ("Position minus wanted position", "error-plot", "friction-plot", "joint_2", "Versions"):
        assert text in page


def test_effects_at_single_joints_act_or_are_refused() -> None:
    motion = sgpr.Trajectory.random(ROBOT, terms=3, max_acceleration=[2.0, 2.0], random_state=5)
    logs = [sgpr.simulate(ROBOT, motion, drives=DRIVES, kp=300.0, kd=10.0).recording()]
    common = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
    plain = sgpr.identify(ROBOT, logs, effects=common)
    model = sgpr.identify(
        ROBOT, logs, effects=[*common, "stribeck_friction@joint_1", "position_dependent_friction@joint_2"]
    )
    assert len(model.terms) == 2
    run = sgpr.simulate(model, motion, model=model, kp=300.0, kd=10.0)
    # The torque that the model says for the motion that it made; where a joint sticks, none.
    moves = np.abs(run.dq) > 0.05
    error = np.abs(run.tau - model.predict(run.q, run.dq, run.ddq))[moves]
    assert np.sqrt(np.mean(error**2)) < 1e-2
    without = np.abs(run.tau - plain.predict(run.q, run.dq, run.ddq))[moves]
    assert np.sqrt(np.mean(without**2)) > 10.0 * np.sqrt(np.mean(error**2))
    lagging = sgpr.identify(ROBOT, logs, effects=[*common, "transmission_hysteresis@joint_1"])
    with pytest.raises(sgpr.SimulationError, match=r"the effect `transmission_hysteresis` .*: it has a hidden state"):
        sgpr.simulate(lagging, motion)
