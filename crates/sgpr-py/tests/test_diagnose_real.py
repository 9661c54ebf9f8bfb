"""Real robots whose logs lack an effect that is documented."""

import numpy as np
import pytest
import sgpr
from conftest import example, outside
from scipy.signal import butter, filtfilt


def robot_and_logs(name: str) -> tuple[sgpr.Robot, list[sgpr.Recording], list[sgpr.Recording]]:
    """Of a real set: the robot, training logs, test logs."""
    folder = outside(f"real/{name}")
    real = example("real_robots")
    return real.robot_and_logs(folder, next(dataset for dataset in real.DATASETS if dataset.folder == name))


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
    model = example("diagnose_real_robots").model_of(robot, train)

    diagnosis = sgpr.diagnose(model, train, test)

    first = diagnosis.findings[0]
    assert first.effect == effect
    assert first.joints[0] == joint
    assert sgpr.compare(diagnosis.model, test).relative_error_percent < reference


def test_an_effect_that_is_unsure_stays_in_the_model_beside_findings() -> None:
    # Without offsets, springs are found for sure, and friction of one direction stands for whichever offset there is.
    robot, train, test = robot_and_logs("kuka_lwr")
    model = sgpr.identify(robot, train, effects=["viscous_friction", "coulomb_friction"])

    diagnosis = sgpr.diagnose(model, train, test)

    assert diagnosis.verdict == "effects_found"
    assert all(finding.probability >= 0.5 for finding in diagnosis.findings)
    before, after = (sgpr.compare(one, test).relative_error_percent for one in (model, diagnosis.model))
    assert after < 0.7 * before
    found = {finding.effect for finding in diagnosis.findings}
    unsure = [words for words in diagnosis.unexplained if "none is more probable than not" in words]
    kept = {term["effect"] for term in diagnosis.model.terms} - found
    assert unsure and any(effect in words for effect in kept for words in unsure), (found, kept, unsure)
    assert any(effect in line for effect in kept for line in diagnosis.model.history), diagnosis.model.history


def test_an_effect_whose_rivals_say_something_else_elsewhere_is_not_in_the_model() -> None:
    # In 7 s a gain of joint 2 stands for the spring that is there, which makes another torque at other positions.
    robot, train, test = robot_and_logs("baxter")
    long = test[-1]
    seconds = (long.time_ns - long.time_ns[0]) * 1e-9
    rows = np.flatnonzero((seconds >= 0.42) & (seconds < 7.9))
    assert long.dq is not None
    one = (long.time_ns[rows], long.q[rows], long.dq[rows], long.tau[rows])
    piece = sgpr.Recording(*one, joint_names=long.joint_names, source="7 s")
    others = [*train, *test[:-1]]
    effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"]
    model = sgpr.identify(robot, [piece], effects=effects)

    diagnosis = sgpr.diagnose(model, [piece], others)

    before, after = (sgpr.compare(one, others).relative_error_percent for one in (model, diagnosis.model))
    assert after < 1.02 * before


def test_a_rival_that_may_be_there_as_well_is_not_instead_of_an_effect() -> None:
    # A force in the world explains part of what a tilt of the base does, and less than the two together.
    robot, train, test = robot_and_logs("panda")
    model = sgpr.identify(robot, train, effects=example("real_robots").EFFECTS)

    diagnosis = sgpr.diagnose(model, train, test)

    tilt = next(finding for finding in diagnosis.findings if finding.effect == "base_tilt")
    assert tilt.probability > 0.97


def test_friction_of_a_joint_that_moves_in_one_log_is_found() -> None:
    # Without that log the others do not tell of it: parts of it have to.
    robot, train, test = robot_and_logs("kuka_lwr")
    joint = list(robot.joint_names).index("lwr_j4")

    def with_friction(log: sgpr.Recording) -> sgpr.Recording:
        assert log.dq is not None and log.tau is not None
        torque = log.tau.copy()
        torque[:, joint] += 7.4 * np.maximum(log.dq[:, joint], 0.0)
        return sgpr.Recording(log.time_ns, log.q, log.dq, torque, joint_names=log.joint_names, source=log.source)

    train, test = [with_friction(log) for log in train], [with_friction(log) for log in test]
    model = sgpr.identify(robot, train, effects=["viscous_friction", "coulomb_friction", "torque_offset"])

    diagnosis = sgpr.diagnose(model, train, test)

    assert ("asymmetric_viscous_friction", ["lwr_j4"]) in [(each.effect, each.joints) for each in diagnosis.findings]
    before, after = (sgpr.compare(one, test).joints[joint].rmse for one in (model, diagnosis.model))
    assert after < 0.6 * before


def test_logs_of_two_robots_are_told() -> None:
    robot, own, test = robot_and_logs("kuka_lwr")
    _, (other, *_), _ = robot_and_logs("baxter")
    train = [*own, other.renamed(robot.joint_names)]

    model = sgpr.identify(robot, train)

    (told,) = [warning for warning in model.report.warnings if "do not fit one model" in warning]
    assert f"they agree best without {other.source}" in told
    with pytest.raises(sgpr.SgprError, match=rf"logs do not fit one model: .* without {other.source}\. .* two robots"):
        sgpr.diagnose(model, train)
    # A joint that lacks the springs that carry it is no other arm.
    for name in ("kuka_lwr", "baxter", "ur10e"):
        robot, train, test = robot_and_logs(name)
        assert not any("one model" in warning for warning in sgpr.identify(robot, train + test).report.warnings)


def test_a_load_that_all_joints_show_stays_for_one_that_errs_more_beyond_the_band() -> None:
    # From 39 s on a body on the last link of 1.67 kg, by the regressor along smoothed motion, which holds no noise of
    # differentiated positions: the model has that of the load, too.
    robot, train, test = robot_and_logs("baxter")
    load = 1.666 * np.array([1.0, -0.044, 0.024, -0.040])

    starts = np.cumsum([0.0] + [float(log.time_ns[-1] - log.time_ns[0]) * 1e-9 + 5.0 for log in train + test])

    def with_load(log: sgpr.Recording, start: float) -> sgpr.Recording:
        assert log.tau is not None
        time = (log.time_ns - log.time_ns[0]) * 1e-9
        b, a = butter(4, 10.0, fs=(len(time) - 1) / time[-1])
        q = filtfilt(b, a, log.q, axis=0)
        dq = np.gradient(q, time, axis=0)
        regressor = robot.regressor(q, dq, np.gradient(dq, time, axis=0)).reshape(len(time), robot.dof, -1)
        carries = (time + start >= 39.08)[:, None]
        torque = log.tau + carries * (regressor[:, :, 10 * (robot.dof - 1) :][:, :, :4] @ load)
        stamps = log.time_ns - log.time_ns[0] + round(start * 1e9)
        return sgpr.Recording(stamps, log.q, log.dq, torque, joint_names=log.joint_names, source=log.source)

    logs = [with_load(log, start) for log, start in zip(train + test, starts, strict=False)]
    train, test = logs[: len(train)], logs[len(train) :]
    model = sgpr.identify(robot, train, effects=example("real_robots").EFFECTS)

    diagnosis = sgpr.diagnose(model, train, test)

    assert diagnosis.findings[0].effect == "payload_change"
    assert "payload_change" in {term["effect"] for term in diagnosis.model.terms}
    before, after = (sgpr.compare(one, test).relative_error_percent for one in (model, diagnosis.model))
    assert after < 0.5 * before


@pytest.mark.parametrize(
    ("name", "log", "start", "seconds", "most"), [("ur10e", 4, 6.13, 10.0, 0.7), ("baxter", 5, 0.15, 20.0, 1.01)]
)
@pytest.mark.filterwarnings("ignore:.*another log at the time stamps")
def test_what_the_robot_file_holds_it_holds_beside_findings(
    name: str, log: int, start: float, seconds: float, most: float
) -> None:
    # Few rows determine less of a model with findings than of the one without.
    robot, train, test = robot_and_logs(name)
    logs = train + test
    own = example("diagnose_real_robots").short(logs.pop(log), seconds, start)

    model = sgpr.identify(robot, [own])
    diagnosis = sgpr.diagnose(model, [own])

    assert diagnosis.findings
    for each in (model, diagnosis.model):
        assert each.fit is not None and each.fit["prior_standard_deviation"] is not None
    before, after = (sgpr.compare(one, logs).relative_error_percent for one in (model, diagnosis.model))
    assert after < most * before


def test_what_is_added_loosens_nothing_that_the_robot_file_holds() -> None:
    # How wrong the file is does not hang on the effects of a model: by itself the evidence would take a wider prior.
    robot, train, _ = robot_and_logs("ur10e")
    own = example("diagnose_real_robots").short(train[2], 8.0, 2.0)
    model = sgpr.identify(robot, [own])
    assert model.fit is not None
    width = model.fit["prior_standard_deviation"]

    for effect in ("load_dependent_friction@elbow_joint", "presliding_friction@shoulder_pan_joint"):
        added = model.add(effect, [own])
        assert added.fit is not None
        assert 0.0 < added.fit["prior_standard_deviation"] <= width


def test_a_finding_that_harms_joints_beside_its_own_is_left_out() -> None:
    # Friction at joint 2 makes that joint look well known, and joints 3 and 6 follow bodies that they share with it.
    robot, train, test = robot_and_logs("baxter")
    diagnose = example("diagnose_real_robots")
    seconds = float(train[0].time_ns[-1] - train[0].time_ns[0]) * 1e-9

    assert diagnose.ratio_of_short(robot, train[0], test, 8.0, seconds - 8.0) < 1.02


def test_a_short_log_does_not_tilt_the_base_by_seven_degrees() -> None:
    # Left-out parts of these 8 s are predicted 30 % better with such a tilt, other logs twice as badly.
    robot, train, test = robot_and_logs("ur10e")
    diagnose = example("diagnose_real_robots")
    seconds = float(train[0].time_ns[-1] - train[0].time_ns[0]) * 1e-9

    assert diagnose.ratio_of_short(robot, train[0], test, 8.0, seconds - 8.0) < 1.1


@pytest.mark.parametrize(
    ("name", "seconds", "best"),
    [("ur10e", 8.0, 1.01), ("ur10e", 16.0, 0.7), ("panda", 8.0, 0.95), ("baxter", 16.0, 0.5)],
)
@pytest.mark.filterwarnings("ignore:.*another log at the time stamps")
def test_one_short_log_makes_no_model_worse(name: str, seconds: float, best: float) -> None:
    # The test logs are other motions, at positions that so short a log does not show, and their clocks begin anew.
    robot, train, test = robot_and_logs(name)
    diagnose = example("diagnose_real_robots")

    ratios = [diagnose.ratio_of_short(robot, log, test, seconds) for log in train]

    assert max(ratios) < 1.03, ratios
    assert min(ratios) < best, ratios
