"""Excitation trajectories."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from sgpr.report.markup import prose

ROBOT = sgpr.robots.two_link()
LIMITS: dict[str, Any] = {"max_acceleration": [2.0, 2.0]}
QUICK: dict[str, Any] = {"terms": 3, "starts": 2, "max_evaluations": 150, **LIMITS}


def test_a_motion_keeps_its_limits_and_excites() -> None:
    found = sgpr.excite(ROBOT, **QUICK)
    assert found.status == "finished" and found.utilisation <= 1.0
    report = found.report
    assert report["rank"] == report["base_parameters"] == 10
    assert np.isclose(report["condition"], report["singular_values"][0] / report["singular_values"][-1])
    t, q, dq, ddq = found.trajectory.samples(2000.0)
    assert len(t) == 20000
    assert (np.abs(q) <= np.pi / 2 + 1e-6).all() and (np.abs(dq) <= 2 + 1e-6).all() and (np.abs(ddq) <= 2 + 1e-6).all()
    assert max(np.abs(values[0]).max() for values in (q, dq, ddq)) < 1e-12
    peaks = found.peaks
    assert np.allclose(peaks["acceleration"], np.abs(ddq).max(axis=0), atol=1e-5)
    history = found.history
    assert history.shape[1] == 3 and set(history[:, 0]) == {0.0, 1.0}
    assert found.values.min() == found.value


def test_speed_is_the_derivative_of_position() -> None:
    motion = sgpr.Trajectory.random(ROBOT, terms=4, random_state=2, **LIMITS)
    t = np.linspace(0.1, 9.9, 99)
    h = 1e-5
    (before, _, _), (_, dq, _), (after, _, _) = (motion.at(t + shift) for shift in (-h, 0.0, h))
    assert np.abs((after - before) / (2 * h) - dq).max() < 1e-7


@pytest.mark.parametrize("basis", ["fourier", "b_spline", "point_to_point"])
def test_a_motion_can_be_sent_to_another_process(basis: str) -> None:
    options = {} if basis == "fourier" else {"points": 10}
    motion = sgpr.excite(ROBOT, basis=basis, **options, **QUICK).trajectory
    again = pickle.loads(pickle.dumps(motion))
    assert again.joint_names == motion.joint_names
    for ours, theirs in zip(again.samples(50.0), motion.samples(50.0), strict=True):
        assert np.array_equal(ours, theirs)
    make, (robot, parts) = motion.__reduce__()
    with pytest.raises(sgpr.SgprError, match="do not belong together"):
        make(robot, {**parts, "coefficients": parts["coefficients"][:-1]})
    with pytest.raises(sgpr.SgprError, match="not a trajectory"):
        make(robot, {**parts, "basis": "spline"})
    with pytest.raises(sgpr.SgprError, match="another number of joints"):
        make(sgpr.robots.puma560(), parts)


def test_criteria_and_families_by_name() -> None:
    for criterion in ("d_optimality", "sum_of_conditions"):
        assert np.isfinite(sgpr.excite(ROBOT, criterion=criterion, **QUICK).value)
    for basis in ("b_spline", "point_to_point"):
        assert sgpr.excite(ROBOT, basis=basis, points=10, **QUICK).utilisation <= 1.0


def test_torque_limits() -> None:
    start = [-1.57 + 0.1, 0.0]
    free = sgpr.excite(ROBOT, [], start=start, **QUICK)
    limit = 0.7 * free.peaks["torque"]
    found = sgpr.excite(ROBOT, [], start=start, max_torque=limit, **QUICK)
    assert (found.peaks["torque"] <= limit + 1e-6).all()
    assert free.tightest.split()[0] in ("position", "speed", "acceleration") and "`joint_" in free.tightest
    share = found.peaks["torque"] / limit
    assert found.tightest == f"torque of joint `joint_{1 + int(share.argmax())}`" and share.max() > 0.999


def test_surroundings() -> None:
    robot = sgpr.robots.puma560()
    options: dict[str, Any] = {"max_acceleration": [6.0] * 6, "starts": 1, "max_evaluations": 60}
    found = sgpr.excite(robot, floor=-0.5, max_tip_speed=1.0, link_radius=0.05, self_collision=True, **options)
    _, q, dq, _ = found.trajectory.samples(200.0)
    speed = np.linalg.norm(np.einsum("kij,kj->ki", robot.jacobian(q), dq)[:, :3], axis=1)
    assert speed.max() <= 1.0 + 1e-6
    assert robot.forward_kinematics(q)[:, 2, 3].min() > -0.5 + 0.05 - 1e-6
    with pytest.raises(sgpr.SgprError, match="from box 1, m is"):
        sgpr.excite(robot, boxes=[([-1, -1, -1], [1, 1, 1])], **options)


def test_files(tmp_path: Path) -> None:
    motion = sgpr.Trajectory.random(ROBOT, terms=3, **LIMITS)
    motion.save_csv(tmp_path / "motion.csv", 50.0)
    log = sgpr.read(tmp_path / "motion.csv")
    # From rest to rest: the end is in the files, which samples of one period leave out.
    q, dq, ddq = motion.at(np.linspace(0.0, 10.0, 501))
    assert np.allclose(log.q, q) and np.allclose(log.dq, dq)
    assert np.abs(log.dq[[0, -1]]).max() < 1e-9 and log.t[-1] == 10.0
    assert np.allclose(log.channels["joint_2_acceleration"], ddq[:, 1])
    motion.save_mcap(tmp_path / "motion.mcap", 50.0, "/arm/trajectory")
    with (tmp_path / "motion.mcap").open("rb") as file:
        [(_, channel, _, message)] = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
    assert channel.topic == "/arm/trajectory"
    points = message.points
    assert message.joint_names == ROBOT.joint_names and len(points) == 501
    assert np.allclose(points[7].positions, q[7]) and np.allclose(points[7].accelerations, ddq[7])
    assert points[7].time_from_start.nanosec == 140_000_000


def test_interrupted_work_gives_its_best() -> None:
    def stop(stage: str, done: int, total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    found = sgpr.excite(ROBOT, terms=3, starts=1000, progress=stop, **LIMITS)
    assert found.status == "interrupted" and np.isfinite(found.value)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no acceleration": ({}, "max_acceleration: give one number per joint"),
    "short": ({"max_acceleration": [1.0]}, r"got \(1,\), expected \(2,\)"),
    "negative": ({"max_acceleration": [1.0, -1.0]}, "the acceleration limit of joint `joint_2` is -1"),
    "criterion": ({**LIMITS, "criterion": "best"}, "expected 'condition'"),
    "basis": ({**LIMITS, "fundamental_hz": -1.0}, "fundamental_hz is -1"),
    "start": ({**LIMITS, "start": [2.0, 0.0]}, "the start position breaks a limit: position of joint `joint_1` is 2"),
    "weak": ({**LIMITS, "max_torque": [1.0, 1.0]}, "torque of joint `joint_1` against gravity is 19.62"),
    "empty": ({**LIMITS, "position_range": [[0.0, 0.0], [0.0, 1.0]]}, r"range of joint `joint_1` is \[0, 0\]"),
}


@pytest.mark.parametrize("case", WRONG)
def test_bad_arguments(case: str) -> None:
    options, message = WRONG[case]
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.excite(ROBOT, **options)


def test_options_that_a_motion_does_not_have() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'max_jerk'; options are basis, fundamental_hz"):
        sgpr.excite(ROBOT, **LIMITS, max_jerk=1)
    with pytest.raises(TypeError, match="unexpected keyword argument 'floor'"):
        sgpr.Trajectory.random(ROBOT, **LIMITS, floor=0.0)
    with pytest.raises(TypeError, match="unexpected keyword argument 'gain'; options are duration, controller"):
        sgpr.simulate(ROBOT, [0.0, 0.0], gain=1.0)
    with pytest.raises(sgpr.SgprError, match="random_state = -1: expected a whole number, 0 or more"):
        sgpr.simulate(ROBOT, [0.0, 0.0], duration=0.1, random_state=-1)


URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.25 0 0"/><geometry>{shape}</geometry></collision></link>
<link name="fore"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.06" length="0.4"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>
  <limit lower="-1.5" upper="1.5" velocity="2" effort="90"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-1.5" upper="1.5" velocity="2" effort="90"/></joint></robot>"""
BOX = '<box size="0.5 0.08 0.06"/>'


def test_limits_that_the_robot_lacks_are_given_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    options: dict[str, Any] = {"max_acceleration": [6.0] * 2, "terms": 3, "starts": 1, "max_evaluations": 40}
    text = URDF.format(shape=BOX)
    path.write_text(text.replace('velocity="2"', 'velocity="0"'))
    robot = sgpr.Robot.from_urdf(path)
    with pytest.raises(sgpr.ExcitationError, match=r"`j1` has no limit of its speed: give one \(`max_velocity`\)"):
        sgpr.excite(robot, [], **options)
    assert sgpr.excite(robot, [], max_velocity=[1.0, 2.0], **options).peaks["velocity"][0] <= 1.0 + 1e-9
    path.write_text(text.replace("revolute", "continuous").replace('effort="90"', 'effort="16"'))
    robot = sgpr.Robot.from_urdf(path)
    with pytest.raises(sgpr.ExcitationError, match=r"`j1` has no limit of its position: give one \(`position_range`\)"):
        sgpr.excite(robot, [], **options)
    # The torque limits of the file hold all the same.
    given = {"position_range": [[-0.5, 0.5]] * 2, "max_velocity": [2.0, 2.0]}
    peaks = sgpr.excite(robot, [], **given, **options).peaks
    assert np.abs(peaks["position"]).max() <= 0.5 + 1e-9
    assert np.max(peaks["torque"]) <= 16.0 + 1e-9


def test_links_are_the_shapes_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.format(shape=BOX))
    robot = sgpr.Robot.from_urdf(path)
    options: dict[str, Any] = {"max_acceleration": [6.0] * 2, "terms": 3, "starts": 1, "max_evaluations": 80}
    found = sgpr.excite(robot, [], floor=0.2, link_shapes=path, **options)
    _, q, _, _ = found.trajectory.samples(200.0)
    # Corners of the box and points of the cylinder's rims, from the angles.
    upper, both = q[:, 0], q.sum(axis=1)
    elbow = 0.5 - 0.5 * np.sin(upper)
    lowest = [0.5 - x * np.sin(upper) - 0.03 * np.abs(np.cos(upper)) for x in (0.0, 0.5)]
    lowest += [elbow - x * np.sin(both) - 0.06 * np.abs(np.cos(both)) for x in (0.0, 0.4)]
    assert np.min(lowest) > 0.2 - 1e-9
    free = sgpr.excite(robot, [], **options)
    _, q, _, _ = free.trajectory.samples(200.0)
    assert (0.5 - 0.5 * np.sin(q[:, 0]) - 0.4 * np.sin(q.sum(axis=1))).min() < 0.2, "the floor is in the way"
    with pytest.raises(sgpr.SgprError, match="shapes of a file or capsules of a radius"):
        sgpr.excite(robot, [], floor=0.2, link_shapes=path, link_radius=0.1, **options)
    path.write_text(URDF.format(shape='<mesh filename="upper.stl"/>'))
    with pytest.raises(sgpr.SgprError, match="`upper` is a mesh, which is not read: give `link_radius`"):
        sgpr.excite(robot, [], floor=0.2, link_shapes=path, **options)


# What a motion cannot show, and why.
REFUSED = {
    "temperature_dependent_friction": "no temperature channel",
    "time_base_error": "checks of a log",
}
# Not at any joint of the two-link arm.
ELSEWHERE = {"wrist_coupling"}


@pytest.mark.parametrize("effect", [effect["name"] for effect in sgpr.effects()])
def test_every_effect_is_excited_or_refused_with_the_reason(effect: str) -> None:
    if effect in REFUSED:
        with pytest.raises(sgpr.ExcitationError, match=f"cannot excite `{effect}`: .*{REFUSED[effect]}"):
            sgpr.excite(ROBOT, [effect], **QUICK)
        return
    robot, limits = (sgpr.robots.puma560(), {"max_acceleration": [6.0] * 6}) if effect in ELSEWHERE else (ROBOT, LIMITS)
    options = {"terms": 3, "starts": 2, "criterion": "d_optimality", **limits}
    bare = sgpr.excite(robot, [], max_evaluations=75, **options).trajectory
    found = sgpr.excite(robot, [effect], max_evaluations=150, **options)
    assert found.report["rank"] == found.report["base_parameters"]
    hidden = len(found.report.get("hidden", []))
    assert found.report["base_parameters"] + hidden > bare.excitation()["base_parameters"]
    # Judged by the same columns at the same rate, the motion that was made for them is at least as good.
    before, after = (motion.excitation([effect]) for motion in (bare, found.trajectory))
    assert after["log_determinant"] >= before["log_determinant"] - 0.5


def test_the_columns_of_a_nonlinear_effect_are_derivatives_at_nominal_values() -> None:
    motion = sgpr.Trajectory.random(ROBOT, terms=4, random_state=2, **LIMITS)
    report = motion.excitation(["viscous_friction", "stribeck_friction"], rate_hz=50.0)
    vs = {name: value for name, value in report["nominal"].items() if ".vs " in name}
    assert list(vs) == [f"{joint}.vs (stribeck_friction)" for joint in ROBOT.joint_names] and report["hidden"] == []
    _, q, dq, ddq = motion.samples(50.0)
    base = ROBOT.base_parameters(["viscous_friction"])
    known = [ROBOT.standard_parameter_names.index(name) for name in base.names if not name.endswith(".Fv")]
    columns = [ROBOT.regressor(q, dq, ddq)[:, :, known]]
    for joint, speed in enumerate(vs.values()):
        own = dq[:, joint] / speed
        dry = np.sign(own) * np.exp(-(own**2))
        # tau = dFs sgn(dq) exp(-(dq/vs)²) at dFs = 1.
        for values in (dq[:, joint], dry, dry * 2.0 * own**2 / speed):
            column = np.zeros((len(q), 2, 1))
            column[:, joint, 0] = values
            columns.append(column)
    w = np.concatenate(columns, axis=2).reshape(2 * len(q), -1)
    expected = np.linalg.slogdet(w.T @ w / len(q))[1]
    assert report["base_parameters"] == w.shape[1]
    assert report["log_determinant"] == pytest.approx(expected, abs=1e-5)


def test_parameters_that_no_motion_tells_apart_are_named() -> None:
    report = sgpr.Trajectory.random(ROBOT, terms=4, **LIMITS).excitation(["payload"])
    assert len(report["hidden"]) == 10 and report["nominal"] == {}
    assert report["rank"] == report["base_parameters"]


def test_a_page_shows_motion_and_search(tmp_path: Path) -> None:
    found = sgpr.excite(ROBOT, criterion="sum_of_conditions", **QUICK)
    assert found.criterion == "sum_of_conditions"
    sgpr.save_report(found, ROBOT, tmp_path / "motion.html")
    page = (tmp_path / "motion.html").read_text()
    for text in (
        "position-plot",
        "acceleration-plot",
        "search-plot",
        "best sum_of_conditions",
        prose(found.tightest),
        "Versions",
    ):
        assert text in page
    assert [path.name for path in tmp_path.iterdir()] == ["motion.html"]
    with pytest.raises(sgpr.SgprError, match="robot: its joints are joint_1, joint_2, joint_3"):
        sgpr.save_report(found, sgpr.robots.puma560(), tmp_path / "motion.html")
    sgpr.save_report(found, ROBOT, tmp_path / "new" / "motion.html")
    assert (tmp_path / "new" / "motion.html").read_text() == page
    with pytest.raises((FileExistsError, NotADirectoryError)):
        sgpr.save_report(found, ROBOT, tmp_path / "motion.html" / "motion.html")
