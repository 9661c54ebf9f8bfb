"""Every estimator through the one door, and what they say of their uncertainty."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from conftest import example

EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia"]


@pytest.mark.parametrize("method", ["ols", "wls", "irls", "irls:2", "ridge:100", "tls", "rls"])
def test_estimators_agree_on_good_logs(
    method: str, demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    model = sgpr.identify(demo_robot, demo_logs, effects=EFFECTS, method=method)
    assert model.fit is not None
    assert model.fit["method"] == method.split(":")[0]
    assert sgpr.compare(model, [demo_test]).relative_error_percent < 5.0


def test_documented_estimators_are_those_of_the_library() -> None:
    page = (Path(__file__).parents[3] / "docs" / "estimators.md").read_text()
    table = page.split("| `method` |")[1].split("\n\n")[0]
    rows = [re.findall(r"`([^`]+)`", line.split("|")[1]) for line in table.splitlines()[2:]]
    documented = {names[0]: len(names) > 1 for names in rows}
    estimators = sgpr.estimators()
    assert documented == {"ols": False, "wls": False} | {e["name"]: e["setting"] is not None for e in estimators}
    for name, with_setting in [(e["name"], e["setting"] is not None) for e in estimators]:
        assert f'"{name}"' in (sgpr.identify.__doc__ or "")
        assert (f'"{name}:' in (sgpr.identify.__doc__ or "")) == with_setting


@pytest.mark.parametrize("method", ["lasso", "wls:2", "irls:x", "ridge:", "tls:-1", "rls:2", "irls:0"])
def test_unknown_methods_and_settings_are_refused(
    method: str, demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]
) -> None:
    with pytest.raises(sgpr.SgprError):
        sgpr.identify(demo_robot, demo_logs, method=method)


def test_instruments_are_the_same_motion(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    # Instruments that are the measured motion itself make instrumental variables least squares.
    ours = sgpr.identify(demo_robot, demo_logs, effects=EFFECTS, method="iv", instruments=demo_logs)
    theirs = sgpr.identify(demo_robot, demo_logs, effects=EFFECTS)
    values = [np.array([p.value for p in model.parameters]) for model in (ours, theirs)]
    assert np.abs(values[0] - values[1]).max() < 1e-6
    with pytest.raises(sgpr.SgprError, match="instruments"):
        sgpr.identify(demo_robot, demo_logs, method="iv")
    with pytest.raises(sgpr.SgprError, match="same times"):
        sgpr.identify(demo_robot, demo_logs, method="iv", instruments=demo_logs[:1])
    with pytest.raises(sgpr.SgprError, match="gains"):
        sgpr.identify(demo_robot, demo_logs, method="output_error")
    with pytest.raises(sgpr.SgprError, match="kp, kd"):
        sgpr.identify(demo_robot, demo_logs, kp=np.ones(6))


@pytest.mark.parametrize("uncertainty", ["hac", "bootstrap:100"])
def test_other_sources_of_deviations_are_of_the_same_size(
    uncertainty: str, demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]
) -> None:
    plain, other = (
        sgpr.identify(demo_robot, demo_logs, effects=EFFECTS, uncertainty=name) for name in ("memory", uncertainty)
    )
    ratios = [
        b.standard_deviation / a.standard_deviation
        for a, b in zip(plain.parameters, other.parameters, strict=True)
        if a.standard_deviation and b.standard_deviation and np.isfinite(a.standard_deviation)
    ]
    assert 0.3 < float(np.median(ratios)) < 3.0
    with pytest.raises(sgpr.SgprError, match="uncertainty"):
        sgpr.identify(demo_robot, demo_logs, uncertainty="jackknife")


def test_predictions_have_a_band(demo_model: sgpr.Model, demo_test: sgpr.Recording) -> None:
    q = demo_test.q[::50]
    zeros = np.zeros_like(q)
    tau, deviation = demo_model.predict(q, zeros, zeros, return_std=True)
    assert np.array_equal(tau, demo_model.predict(q, zeros, zeros))
    assert deviation.shape == tau.shape
    assert (deviation >= 0.0).all()
    assert np.median(deviation) < 0.1 * np.abs(tau).max()
    # By hand, from the covariance: the base regressor is the derivative by base parameters.
    nominal = sgpr.Model.nominal(demo_model.robot)
    assert not nominal.predict(q, zeros, zeros, return_std=True)[1].any()


def test_bands_along_a_log_know_of_terms(
    demo_robot: sgpr.Robot,
    demo_logs: list[sgpr.Recording],
    demo_model: sgpr.Model,
    demo_test: sgpr.Recording,
    tmp_path: Path,
) -> None:
    log = sgpr.compare(demo_model, [demo_test]).logs[0]
    plain = demo_model.standard_deviation(log)
    np.testing.assert_allclose(plain, demo_model.predict(log.q, log.dq, log.ddq, return_std=True)[1], rtol=1e-9)
    effects = [*EFFECTS, f"cable_hysteresis@{demo_robot.joint_names[1]}"]
    model = sgpr.identify(demo_robot, demo_logs[:1], effects=effects)
    deviation = model.standard_deviation(log)
    assert deviation.shape == log.q.shape
    assert (deviation[1:] > 0.0).all()
    model.save(tmp_path / "model.sgpr")
    assert np.array_equal(sgpr.load(tmp_path / "model.sgpr").standard_deviation(log), deviation)
    with pytest.raises(ValueError, match="joints"):
        sgpr.Model.nominal(sgpr.robots.two_link()).standard_deviation(log)


def test_essential_parameters_predict_as_well(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    whole = sgpr.identify(demo_robot, demo_logs)
    model = sgpr.identify(demo_robot, demo_logs, essential=True)
    assert model.report is not None
    found = model.report.essential
    assert found is not None
    rank = len(model.parameters)
    assert sorted(found["kept"] + found["dropped"]) == list(range(rank))
    assert all(abs(model.parameters[k].value) < 1e-12 for k in found["dropped"])
    assert len(found["validation"]) == rank + 1
    before, after = (sgpr.compare(each, [demo_test]).relative_error_percent for each in (whole, model))
    assert after < 1.02 * before


def test_mistakes_in_logs_are_named(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    def changed(log: sgpr.Recording, factors: list[float]) -> sgpr.Recording:
        tau = log.tau * np.array(factors)
        return sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names, source=log.source)

    def warnings(factors: list[float]) -> str:
        logs = [changed(log, factors) for log in demo_logs]
        report = sgpr.identify(demo_robot, logs, effects=EFFECTS).report
        assert report is not None
        return "\n".join(report.warnings)

    names = demo_robot.joint_names
    assert "negated" not in warnings([1.0] * 6)
    assert f"torque of {names[2]} looks negated" in warnings([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    assert "all torques look negated" in warnings([-1.0] * 6)
    both = warnings([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    assert all(f"torque of {name} looks negated" in both for name in names[1:3]) and both.count("negated") == 2
    with pytest.raises(sgpr.RecordingError, match="times what gravity asks of the arm"):
        warnings([1000.0] * 6)
    assert f"torque of {names[1]} is in another unit" in warnings([1.0, 1000.0, 1.0, 1.0, 1.0, 1.0])


def test_late_torque_is_named(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    def late(log: sgpr.Recording) -> sgpr.Recording:
        tau = log.tau.copy()
        tau[10:, 1] = log.tau[:-10, 1]
        return sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names, source=log.source)

    logs = [late(log) for log in demo_logs]
    model = sgpr.identify(demo_robot, logs, effects=EFFECTS)
    found = [text for text in sgpr.screen(model, logs) if "after its motion" in text]
    assert len(found) == 1
    assert demo_robot.joint_names[1] in found[0]
    assert sgpr.screen(sgpr.Model.nominal(demo_robot), logs) == []


def waves(robot: sgpr.Robot, friction: np.ndarray, rate_hz: float, *, noise: float, seed: int = 1) -> sgpr.Recording:
    """30 s of waves, cut in full motion, with viscous and Coulomb friction, rotors and offsets (4, n).

    - noise: of the torques, as a share of their standard deviations
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 1.0 / rate_hz)
    q, dq, ddq = np.zeros((3, t.size, robot.dof))
    for joint in range(robot.dof):
        for frequency in (0.13, 0.31, 0.47, 0.83):
            a, w, phase = rng.uniform(0.1, 0.4), 2.0 * np.pi * frequency, rng.uniform(0.0, 7.0)
            q[:, joint] += a * np.sin(w * t + phase)
            dq[:, joint] += a * w * np.cos(w * t + phase)
            ddq[:, joint] -= a * w * w * np.sin(w * t + phase)
    viscous, coulomb, rotor, offset = friction
    tau = robot.inverse_dynamics(q, dq, ddq) + viscous * dq + coulomb * np.sign(dq) + rotor * ddq + offset
    tau += noise * tau.std(axis=0) * rng.normal(size=tau.shape)
    q += 1e-6 * rng.normal(size=q.shape)
    return sgpr.Recording((t * 1e9).round().astype(np.int64), q, None, tau, joint_names=robot.joint_names)


LIGHT_LINK = """<robot name="light"><link name="base"/><link name="arm"><inertial><origin xyz="0.1 0 0"/>
<mass value="0.2"/><inertia ixx="2e-4" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.mark.parametrize("case", ["a force that knows no inertias", "an end in full motion", "a light link on a rotor"])
def test_good_logs_pass(case: str, data: Path) -> None:
    rate_hz, noise = 100.0, 0.02
    if case == "a force that knows no inertias":
        # The rows of the sliding joint have columns of zeros.
        robot = sgpr.Robot.from_urdf(data / "reference" / "urdf" / "scara.urdf")
    elif case == "an end in full motion":
        robot, rate_hz, noise = sgpr.robots.two_link(), 1000.0, 0.003
    else:
        # Of the rotor, which is most of its inertia, the robot file says nothing.
        robot = sgpr.Robot.from_urdf_text(LIGHT_LINK)
    log = waves(robot, np.outer([0.5, 0.3, 0.2, 0.1], np.ones(robot.dof)), rate_hz, noise=noise)
    model = sgpr.identify(robot, [log])
    assert model.report is not None
    said = [text for text in model.report.warnings if "smaller than their standard deviation" not in text]
    # The waves know nothing of the limits of the arm.
    said = [text for text in said if "is outside its limits" not in text]
    assert (said, sgpr.screen(model, [log])) == ([], [])


def negated(robot: sgpr.Robot, log: sgpr.Recording, joint: int) -> list[str]:
    """What is said to be negated in a log with one torque negated."""
    tau = log.tau.copy()
    tau[:, joint] *= -1.0
    spoilt = sgpr.Recording(log.time_ns, log.q, None, tau, joint_names=log.joint_names)
    report = sgpr.identify(robot, [spoilt]).report
    assert report is not None
    return re.findall(r"of (\S+) looks negated", "\n".join(report.warnings))


@pytest.mark.parametrize("name", ["scara", "stanford_like"])
def test_negated_torques_are_named_beside_sliding_joints(name: str, data: Path) -> None:
    robot = sgpr.Robot.from_urdf(data / "reference" / "urdf" / f"{name}.urdf")
    log = waves(robot, np.outer([0.5, 0.3, 0.2, 0.1], np.ones(robot.dof)), 100.0, noise=0.02)
    for joint, expected in enumerate(robot.joint_names):
        assert negated(robot, log, joint) == [expected]


def test_the_friction_that_is_known_best_tells_the_sign(data: Path) -> None:
    robot = sgpr.Robot.from_urdf(data / "reference" / "urdf" / "ur5e_like.urdf")
    friction = np.outer([0.5, 0.3, 0.2, 0.1], np.ones(robot.dof))
    # What a model lacks can make viscous friction and rotor of a joint negative.
    friction[[0, 2], -1] = -0.05, -0.01
    log = waves(robot, friction, 100.0, noise=0.02)
    assert negated(robot, log, 1) == [robot.joint_names[1]]


def test_base_parameters_by_recursion_are_those_of_random_motion(reference: Any) -> None:
    for effects in ([], EFFECTS):
        exact = reference.robot.base_parameters(effects, recursion=True)
        random = reference.robot.base_parameters(effects)
        assert exact.names == random.names
        assert np.allclose(exact.matrix, random.matrix, atol=1e-8)


def test_regrouping_rules_are_formulas() -> None:
    [rules] = sgpr.regroupings([{"prismatic": True, "a": 0.1}])
    assert [rule.split("(")[0] for rule in rules] == ["Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    [rules] = sgpr.regroupings([{}])
    assert rules[0].startswith("Iyy(j): Ixx(j-1) + 1, Iyy(j-1) + cos(alpha)^2")
    with pytest.raises(sgpr.SgprError):
        sgpr.regroupings([{"angle": 1.0}])


class ClosedLoop:
    """The two-link arm behind its reference under a PD controller, without noise, and its controller."""

    kp, kd = [400.0, 300.0], [40.0, 30.0]

    def __init__(self) -> None:
        self.robot = sgpr.robots.two_link()
        t = np.arange(0.0, 20.0, 1e-3)
        q, dq, ddq = (np.zeros((len(t), 2)) for _ in range(3))
        for joint in range(2):
            for h in range(1, 5):
                a, w, phase = 0.7 / h, 0.9 * h + 0.17 * joint, 1.7 * h * (joint + 1)
                q[:, joint] += a * np.sin(w * t + phase)
                dq[:, joint] += a * w * np.cos(w * t + phase)
                ddq[:, joint] -= a * w * w * np.sin(w * t + phase)
        controller: dict[str, Any] = {"controller": "pd", "kp": self.kp, "kd": self.kd}
        found = sgpr.simulate(self.robot, (1000.0, q, dq, ddq), **controller, record_period=5e-3)
        time = (found.t * 1e9).round().astype(np.int64)
        names = self.robot.joint_names
        self.log = sgpr.Recording(time, found.q, None, found.tau, joint_names=names, source="log")
        self.reference = sgpr.Recording(time, found.q_wanted, None, None, joint_names=names, source="reference")


@pytest.fixture(scope="module")
def closed_loop() -> ClosedLoop:
    return ClosedLoop()


@pytest.mark.parametrize(
    "method", ["ols", "wls", "irls", "ridge:10", "tls", "rls", "iv", "iv simulated", "output_error"]
)
def test_all_estimators_find_the_arm_behind_its_controller(method: str, closed_loop: ClosedLoop) -> None:
    name, _, simulated = method.partition(" ")
    options: dict[str, Any] = {}
    if name in ("iv", "output_error"):
        options["instruments"] = [closed_loop.reference]
    if name == "output_error" or simulated:
        options |= {"kp": closed_loop.kp, "kd": closed_loop.kd}
    robot, effects = closed_loop.robot, ["viscous_friction"]
    model = sgpr.identify(robot, [closed_loop.log], effects=effects, method=name, cutoff_hz=20.0, **options)
    expected = robot.base_parameters(effects).matrix @ np.append(robot.standard_parameters, [0.0, 0.0])
    found = np.array([parameter.value for parameter in model.parameters])
    # What is left are errors of the derivatives; output error takes none, and integrates coarsely.
    assert np.abs(found - expected).max() < 0.01
    assert model.fit is not None and model.fit["method"] == name.partition(":")[0]
    assert all(parameter.standard_deviation is not None for parameter in model.parameters)
    assert model.report is not None and len(model.report.singular_values) == len(found)


output_error = example("simulated_output_error")
"""Logs of arms that stick at their turns, and what output error makes of them."""


@pytest.mark.parametrize("step", [1e-4, 5e-4, 1e-3])
def test_output_error_finds_rotors_and_dry_friction_with_a_coarse_encoder(step: float) -> None:
    arm = output_error.Arm.two_link()
    log = arm.log(step, torque_noise=output_error.NOISE)
    for cutoff in (None, 30.0):
        model = arm.identified(*log, cutoff, guess=1.1)
        assert not [text for text in model.report.warnings if "simulation" in text]
        errors = np.array(list(arm.errors(model).values())) / model.parameters.standard_deviations
        assert np.abs(errors).max() < 3.0, dict(zip(model.parameters.names, errors.round(1), strict=True))


def test_output_error_keeps_joints_that_stick_in_their_place() -> None:
    # Joint 1 of the PUMA sticks at its turns; where it crept, its friction was off by 0.19 of 5.8 and 26.
    arm = output_error.Arm.puma560()
    exact = {"integrator": "runge_kutta", "control_period": 2.5e-4, "record_period": 1e-3}
    errors = arm.errors(arm.identified(*arm.log(1e-9, torque_noise=np.full(6, 1e-3), **exact), 20.0))
    assert abs(errors["joint_1.Fv"]) < 0.05 and abs(errors["joint_1.Fc"]) < 0.05, errors


def test_a_controller_that_does_not_hold_the_arm_is_named() -> None:
    arm = output_error.Arm.two_link()
    log, wanted = arm.log(1e-4, torque_noise=output_error.NOISE)
    wrong = {"kp": arm.gains["kp"], "kd": [1e9 * gain for gain in arm.gains["kd"]]}
    options: dict[str, Any] = {"effects": EFFECTS, "method": "output_error", "instruments": [wanted]}
    with pytest.raises(sgpr.IdentificationError, match="simulation of trajectory 1 diverges: check sign and unit"):
        sgpr.identify(arm.robot, [log], **options, **wrong)
