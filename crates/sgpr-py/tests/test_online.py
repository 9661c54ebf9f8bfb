"""Models that learn while the arm runs."""

from typing import Any

import numpy as np
import pytest
import sgpr

ROBOT = sgpr.robots.puma560()
DRIVES = sgpr.robots.puma560_drives()
NOISE = [1.0, 1.0, 0.5, 0.1, 0.1, 0.1]
HELD = np.array([2.0, 0.04, -0.06, 0.30, 0.06, 0.001, 0.055, -0.006, 0.009, 0.012])


def truth() -> sgpr.Model:
    """What an identification would have found."""
    effects = {"viscous_friction": [], "coulomb_friction": [], "rotor_inertia": []}
    for drive in DRIVES:
        effects["viscous_friction"].append(drive.viscous_friction)
        effects["coulomb_friction"].append(float(np.mean(drive.coulomb_friction)))
        effects["rotor_inertia"].append(drive.rotor_inertia)
    parameters = np.concatenate([ROBOT.standard_parameters, *effects.values()])
    return sgpr.Model.from_parameters(ROBOT, parameters, effects=list(effects))


def motion(t: Any) -> tuple[Any, Any, Any]:
    t = np.asarray(t)[..., None]
    joint = np.arange(6)
    middle = np.array([0.0, -1.2, 0.3, 0.2, 0.4, 0.0])
    q, dq, ddq = middle + 0.0 * t, 0.0 * t * joint, 0.0 * t * joint
    for w, size in ((2.2 + 0.37 * joint, 0.35), (3.9 - 0.29 * joint, -0.12)):
        q = q + size * (1.0 - np.cos(w * t))
        dq = dq + size * w * np.sin(w * t)
        ddq = ddq + size * w**2 * np.cos(w * t)
    return q, dq, ddq


def picks_up(**followed: bool) -> tuple[sgpr.OnlineModel, float, float]:
    """The model afterwards, and the error before the pick-up after 3 s and from a second after it."""
    model = truth()
    online = sgpr.OnlineModel(ROBOT, model, noise=NOISE, **followed)
    before: list[Any] = []

    def controller(t: float, q: Any, dq: Any, q_wanted: Any, dq_wanted: Any, ddq_wanted: Any) -> Any:
        if before:
            online.update(q, before[-1])
        torque = online.torque(q_wanted, dq_wanted, ddq_wanted) + 75.0 * (q_wanted - q) + 5.0 * (dq_wanted - dq)
        before[:] = [torque]
        return torque

    rate = 200.0
    wanted = (rate, *motion(np.arange(int(7.0 * rate) + 1) / rate))
    run = sgpr.simulate(
        model, wanted, controller=controller, pick_up=(3.0, HELD), position_resolution=[1e-5] * 6, duration=7.0
    )
    error = np.linalg.norm(run.q - run.q_wanted, axis=1)
    mean = [float(np.sqrt(np.mean(error[(run.t >= a) & (run.t < b)] ** 2))) for a, b in ((1.0, 3.0), (4.0, 7.0))]
    return online, mean[0], mean[1]


def test_a_payload_is_tracked_and_the_error_recovers() -> None:
    _, before, lost = picks_up(payload=False, process=False)
    online, _, recovered = picks_up(process=False)
    assert lost > 3.0 * before
    assert recovered < 0.15 * lost
    assert online.payload is not None and online.payload_std is not None
    assert abs(online.payload[0] - HELD[0]) < 0.1
    assert online.payload.shape == online.payload_std.shape == (10,)


def test_a_process_helps_without_knowing_what_happened() -> None:
    _, _, lost = picks_up(payload=False, process=False)
    online, _, recovered = picks_up(payload=False)
    assert recovered < 0.5 * lost
    assert online.payload is None and online.payload_std is None
    assert 10 < online.points <= 100


def test_nothing_learned_is_the_model() -> None:
    model = truth()
    online = sgpr.OnlineModel(ROBOT, model, noise=NOISE)
    q, dq, ddq = (part[0] for part in motion(np.array([0.7])))
    assert np.allclose(online.torque(q, dq, ddq), model.predict(q, dq, ddq), atol=1e-12)


def test_a_payload_picked_up_is_a_heavier_arm() -> None:
    # From the pick-up on the arm moves as one that was built so.
    parameters = ROBOT.standard_parameters
    parameters = parameters + np.concatenate([np.zeros(50), HELD])
    heavier = ROBOT.with_standard_parameters(parameters)
    options: dict[str, Any] = {"drives": DRIVES, "model": ROBOT, "kp": 300.0, "kd": 10.0}
    first = sgpr.simulate(ROBOT, [0.2] * 6, duration=0.5, **options)
    both = sgpr.simulate(ROBOT, [0.2] * 6, duration=1.0, pick_up=(0.5, HELD), **options)
    assert np.array_equal(both.q[:500], first.q) and len(both) == 1000
    tau, q, dq, ddq = both.tau[700], both.q[700], both.dq[700], both.ddq[700]
    rotors = np.array([drive.rotor_inertia for drive in DRIVES])
    balance = heavier.inverse_dynamics(q, dq, ddq) + rotors * ddq + both.friction[700]
    assert np.allclose(tau, balance, atol=1e-8), tau - balance


def test_the_process_by_itself_is_an_exact_one() -> None:
    random = np.random.default_rng(1)
    kernel = sgpr.Kernel("matern32", [0, 1], 0.8, variance=2.0)
    gp = sgpr.OnlineGaussianProcess(kernel, 2, noise_variance=1e-3, points=300, novelty=0.0)
    x = random.uniform(-2.0, 2.0, (120, 2))
    y = np.sin(x[:, 0]) * x[:, 1]
    for point, value in zip(x, y, strict=True):
        gp.add(point, [value])
    assert len(gp) == 120
    distance = np.linalg.norm(x[:, None] - x[None], axis=2) * np.sqrt(3.0) / 0.8
    covariance = 2.0 * (1.0 + distance) * np.exp(-distance)
    at = np.array([0.3, -0.4])
    r = np.linalg.norm(x - at, axis=1) * np.sqrt(3.0) / 0.8
    cross = 2.0 * (1.0 + r) * np.exp(-r)
    noisy = covariance + 1e-3 * np.eye(120)
    mean, std = gp.predict(at, return_std=True)
    assert np.isclose(mean[0], cross @ np.linalg.solve(noisy, y), atol=1e-9)
    assert np.isclose(std**2, 2.0 - cross @ np.linalg.solve(noisy, cross), atol=1e-9)
    assert np.array_equal(gp.predict(at), mean)


KERNEL = sgpr.Kernel("squared_exponential", [0], 1.0)
WRONG: dict[str, tuple[Any, str]] = {
    "noise": (lambda: sgpr.OnlineModel(ROBOT), "noise: the model was not identified here"),
    "noise of five": (lambda: sgpr.OnlineModel(ROBOT, noise=[1.0] * 5), r"noise: got \(5,\), expected \(6,\)"),
    "link": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE, link="hand"), "no joint `hand`; it has joint_1"),
    "memory": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE, memory=0.0), "memory is 0"),
    "cutoff": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE, cutoff_hz=200.0), "at most a tenth of the sampling rate"),
    "points": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE, points=0), "points"),
    "sample": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE).update([0.0] * 5, [0.0] * 6), r"q: got \(5,\)"),
    "number": (lambda: sgpr.OnlineModel(ROBOT, noise=NOISE).update([np.nan] * 6, [0.0] * 6), "q"),
    "kernel": (lambda: sgpr.OnlineGaussianProcess(KERNEL, 0), "at least one"),
    "variance": (lambda: sgpr.OnlineGaussianProcess(KERNEL, 1, noise_variance=0.0), "noise_variance is 0"),
    "time": (lambda: sgpr.simulate(ROBOT, [0.0] * 6, duration=1.0, pick_up=(2.0, HELD)), "time of the pick-up is 2"),
    "held": (lambda: sgpr.simulate(ROBOT, [0.0] * 6, duration=1.0, pick_up=(0.5, HELD[:4])), r"pick_up: got \(4,\)"),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_arguments(case: str) -> None:
    call, message = WRONG[case]
    with pytest.raises(sgpr.SgprError, match=message):
        call()
