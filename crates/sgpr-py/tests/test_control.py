"""What a controller makes of a model: compensation, and torque from outside."""

import numpy as np
import pytest
import sgpr

EFFECTS = ["viscous_friction", "coulomb_friction"]
VISCOUS, COULOMB = np.array([0.5, 0.2]), np.array([2.0, 1.0])
GRAVITY = 9.81 * np.array([2.0, 0.5])
"""Of two links of 1 m and 1 kg with the mass in the middle, stretched out level, N·m."""
REST = np.zeros(2)


@pytest.fixture(scope="module")
def model() -> sgpr.Model:
    robot = sgpr.robots.two_link()
    parameters = [*robot.standard_parameters, *VISCOUS, *COULOMB]
    return sgpr.Model.from_parameters(robot, parameters, EFFECTS)


@pytest.mark.parametrize("speed", [0.0, 0.005, 0.02, 0.3, -0.3])
def test_gravity_is_of_the_position_and_friction_of_the_wanted_speed(model: sgpr.Model, speed: float) -> None:
    compensation = sgpr.Compensation(model, friction=0.7, transition_speed=0.02)
    dq = np.array([0.0, speed])
    share = 0.7 * min(abs(speed) / 0.02, 1.0)
    friction = np.array([0.0, VISCOUS[1] * speed + COULOMB[1] * np.sign(speed)])
    tau = compensation.torque(REST, dq)
    # One link alone that moves makes a torque of its own: along the arm, thus none about the joints.
    np.testing.assert_allclose(tau, GRAVITY + share * friction, atol=1e-12)


def test_torques_are_limited(model: sgpr.Model) -> None:
    tau = sgpr.Compensation(model, limits=[10.0, 10.0]).torque(REST, REST)
    np.testing.assert_allclose(tau, [10.0, GRAVITY[1]])


def test_a_push_is_followed_with_the_lag_of_the_bandwidth(model: sgpr.Model) -> None:
    observer = sgpr.MomentumObserver(model, rate_hz=1000.0, bandwidth_hz=5.0, deviation=[0.2, 0.1])
    assert observer.alarm is None
    push = np.array([0.0, 2.0])
    observer.update(REST, REST, GRAVITY)
    seen = np.array([observer.update(REST, REST, GRAVITY - push) for _ in range(400)])
    lag = 1.0 - np.exp(-2.0 * np.pi * 5.0 * np.arange(1, 401) / 1000.0)
    np.testing.assert_allclose(seen, push * lag[:, None], atol=0.03)
    joint, torque, threshold = observer.alarm or pytest.fail("no alarm")
    assert (joint, torque, threshold) == (1, seen[-1, 1], observer.thresholds[1])
    np.testing.assert_array_equal(observer.external_torque, seen[-1])
    observer.reset()
    assert observer.alarm is None


@pytest.mark.parametrize("per_hour", [0.01, 1.0, 100.0])
def test_a_normal_error_crosses_the_threshold_as_often_as_accepted(model: sgpr.Model, per_hour: float) -> None:
    options = {"rate_hz": 500.0, "bandwidth_hz": 2.0, "deviation": [0.2, 0.1]}
    z = sgpr.MomentumObserver(model, false_alarms_per_hour=per_hour, **options).thresholds / [0.2, 0.1]
    # Rice: 2 f exp(-z²/2) crossings per second of ±z at each joint.
    np.testing.assert_allclose(3600.0 * 2 * 2.0 * 2.0 * np.exp(-(z**2) / 2), per_hour)


def test_the_fit_says_how_good_its_model_is(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    model = sgpr.identify(demo_robot, demo_logs[:1], effects=EFFECTS)
    own = sgpr.MomentumObserver(model, rate_hz=250.0).thresholds
    unit = sgpr.MomentumObserver(model, rate_hz=250.0, deviation=np.ones(6)).thresholds
    assert np.all(own > 0.0) and np.all(own / unit < 1.0), "the noise of the demo is below 1 N·m"


def test_logs_without_contact_tell_rest_from_motion(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    model = sgpr.identify(demo_robot, demo_logs[:2], effects=EFFECTS)
    options = {"rate_hz": 250.0, "bandwidth_hz": 5.0, "false_alarms_per_hour": 1.0}
    observer = sgpr.MomentumObserver(model, without_contact=demo_logs[:2], **options)
    moving, resting, speed = observer.errors.T
    assert observer.errors.shape == (6, 3) and np.all(moving > 0.0) and np.all(resting >= 0.0) and np.all(speed > 0.0)
    # Before the first sample the thresholds are those of a moving arm; at rest they are larger by what rest adds.
    z = observer.thresholds / moving
    np.testing.assert_allclose(z, z[0])
    log = demo_logs[2]
    observer.update(log.q[0], np.zeros(6), log.tau[0])
    np.testing.assert_allclose(observer.thresholds, z * np.hypot(moving, resting))
    alarms = 0
    observer.reset()
    for q, dq, tau in zip(log.q, log.dq, log.tau, strict=True):
        observer.update(q, dq, tau)
        alarms += observer.alarm is not None
    assert alarms <= 0.001 * len(log)
    assert np.all(sgpr.MomentumObserver(model, rate_hz=250.0).errors[:, 1] == 0.0)
    with pytest.raises(sgpr.SgprError, match=r"log 0: 250\.0 samples per second, expected 100"):
        sgpr.MomentumObserver(model, rate_hz=100.0, without_contact=demo_logs[:1])
    with pytest.raises(sgpr.SgprError, match="got 0 samples"):
        sgpr.MomentumObserver(model, rate_hz=250.0, without_contact=[])
    still = sgpr.Recording(log.t, log.q, None, log.tau, source="still")
    with pytest.raises(sgpr.SgprError, match="still: it has no velocity"):
        sgpr.MomentumObserver(model, rate_hz=250.0, without_contact=[still])
    with pytest.raises(TypeError, match="a list of Recording"):
        sgpr.MomentumObserver(model, rate_hz=250.0, without_contact=demo_logs[0])  # type: ignore[arg-type]


def test_what_is_wrong_is_said(model: sgpr.Model) -> None:
    with pytest.raises(sgpr.SgprError, match="bandwidth_hz: got 60 Hz, expected at most a tenth"):
        sgpr.MomentumObserver(model, rate_hz=100.0, bandwidth_hz=60.0, deviation=[1.0, 1.0])
    with pytest.raises(sgpr.SgprError, match="give the standard deviation"):
        sgpr.MomentumObserver(model, rate_hz=100.0)
    with pytest.raises(sgpr.SgprError, match="false_alarms_per_hour"):
        sgpr.MomentumObserver(model, rate_hz=100.0, false_alarms_per_hour=0.0, deviation=[1.0, 1.0])
    with pytest.raises(sgpr.SgprError, match="friction"):
        sgpr.Compensation(model, friction=1.5)
    with pytest.raises(sgpr.SgprError, match="limits"):
        sgpr.Compensation(model, limits=[1.0])
    compensation = sgpr.Compensation(model)
    with pytest.raises(ValueError, match="q"):
        compensation.torque(np.zeros(3), REST)
    with pytest.raises(ValueError, match="wanted_dq"):
        compensation.torque(REST, [np.nan, 0.0])
    observer = sgpr.MomentumObserver(model, rate_hz=100.0, deviation=[1.0, 1.0])
    with pytest.raises(ValueError, match="tau"):
        observer.update(REST, REST, np.zeros(3))
