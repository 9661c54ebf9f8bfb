"""Robots from files and tables."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run
from conftest import DATA, Reference

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/>
<mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/><joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2" velocity="3" effort="4"/></joint><joint name="slide" type="prismatic"><parent link="rod"/>
<child link="tip"/><axis xyz="0 0 1"/></joint></robot>"""


def test_parameters_agree_with_independent_codes(reference: Reference) -> None:
    assert np.allclose(reference.robot.standard_parameters, reference["params_joint"], rtol=0, atol=3e-13)
    assert reference.robot.joint_names == reference.info["joint_names"]
    assert np.array_equal(reference.robot.gravity, reference.info["gravity"])


def test_what_a_robot_says_of_itself() -> None:
    robot = sgpr.Robot.from_urdf_text(PENDULUM)
    assert (robot.name, robot.dof, robot.joint_names) == ("pendulum", 2, ["hinge", "slide"])
    assert robot.joint_kinds == ["revolute", "prismatic"]
    assert robot.position_units == ["rad", "m"]
    assert robot.torque_units == ["N·m", "N"]
    assert robot.frames == ["base", "rod", "tip"]
    assert np.array_equal(robot.limits["lower"], [-1, -np.inf])
    assert np.array_equal(robot.limits["upper"], [2, np.inf])
    assert np.array_equal(robot.limits["velocity"], [3, np.inf])
    assert np.array_equal(robot.limits["effort"], [4, np.inf])
    assert len(robot.standard_parameter_names) == 20
    assert robot.standard_parameter_names[4] == "hinge.Ixx"
    assert any("slide" in warning for warning in robot.warnings)
    assert "pendulum" in repr(robot)
    assert "-1.0000 to 2.0000 rad" in repr(robot)


def test_locked_joints_are_merged() -> None:
    robot = sgpr.Robot.from_urdf_text(PENDULUM, ["hinge"], locked={"slide": 0.1})
    assert robot.dof == 1
    # The lower end moved with the locked joint.
    assert np.allclose(robot.forward_kinematics([0.0], "tip")[:3, 3], [0, 0, 0.1])


def test_table_of_denavit_and_hartenberg() -> None:
    reference = Reference("puma560")
    dh = reference.info["dh"]
    keys = {"a": "a", "alpha": "alpha", "d": "d", "theta": "theta", "mass": "mass", "com": "centre_of_mass"}
    rows = [{new: dh[old][i] for old, new in keys.items()} | {"inertia": dh["inertia_com"][i]} for i in range(6)]
    robot = sgpr.Robot.from_dh(rows, convention="standard", name="mine", gravity=reference.info["gravity"])
    assert robot.name == "mine"
    assert robot.joint_names[0] == "joint_1"
    tau = robot.inverse_dynamics(reference.q, reference.dq, reference.ddq)
    assert np.abs(tau - reference["tau"]).max() < 1e-12 * reference.info["max_abs_tau"]
    assert np.allclose(robot.standard_parameters, sgpr.robots.puma560().standard_parameters)


def test_limits_of_a_table() -> None:
    row = {"a": 1.0, "lower": -1, "upper": 1, "velocity": 2, "effort": np.inf}
    robot = sgpr.Robot.from_dh([row], convention="modified", joint_names=["hinge"])
    assert robot.joint_names == ["hinge"]
    assert robot.limits["velocity"][0] == 2
    assert robot.limits["effort"][0] == np.inf


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"b": 1.0}, "there is no `b`; known are a, alpha"),
        ({"a": np.nan}, r"rows\[0\]\['a'\] is NaN"),
        ({"mass": np.inf}, "expected a finite number"),
        ({"centre_of_mass": [1, 2]}, r"got \(2,\), expected \(3,\)"),
        ({"inertia": [1, 2, 3]}, r"got \(3,\), expected \(3, 3\)"),
        ({"lower": 1.0}, "give `lower` and `upper`, or neither"),
        ({"lower": 1.0, "upper": 0.0}, "`lower` is above `upper`"),
        ({"mass": -1.0}, "a mass is not negative"),
    ],
)
def test_bad_rows_are_refused(row: dict[str, object], message: str) -> None:
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.Robot.from_dh([row], convention="standard")


def test_convention_has_no_default() -> None:
    with pytest.raises(TypeError, match="convention"):
        sgpr.Robot.from_dh([{}])  # type: ignore[call-arg]
    with pytest.raises(sgpr.SgprError, match="convention = 'craig': expected 'standard' or 'modified'"):
        sgpr.Robot.from_dh([{}], convention="craig")  # type: ignore[arg-type]


def test_base_parameters_agree_with_independent_codes(reference: Reference) -> None:
    base = reference.robot.base_parameters()
    robot = reference.robot
    parameters = robot.standard_parameters
    assert base.matrix.shape == (base.rank, 10 * robot.dof)
    assert len(base) == base.rank == len(base.names) == len(base.units) == len(base.expressions)
    assert base.parameter_names == robot.standard_parameter_names
    assert set(base.classes.values()) <= {"identifiable", "combination", "invisible"}
    # The rank is that of the regressor, and the combinations carry all of the torque.
    W = robot.regressor(reference.q, reference.dq, reference.ddq).reshape(-1, 10 * robot.dof)
    assert base.rank == np.linalg.matrix_rank(W, tol=1e-7 * np.linalg.norm(W, 2))
    kept = [base.parameter_names.index(name) for name in base.names]
    tau = W[:, kept] @ (base.matrix @ parameters)
    assert np.allclose(tau, W @ parameters, atol=1e-8 * reference.info["max_abs_tau"])


def test_base_parameters_with_effects() -> None:
    base = sgpr.robots.two_link().base_parameters(["viscous_friction"])
    assert base.names[-2:] == ["joint_1.Fv", "joint_2.Fv"]
    with pytest.raises(sgpr.IdentificationError, match="there is no effect `stiction`; `sgpr effects` lists all"):
        sgpr.robots.two_link().base_parameters(["stiction"])


def test_other_gravity_and_other_inertias_are_other_robots() -> None:
    robot = sgpr.robots.two_link()
    assert np.array_equal(robot.with_gravity([1, 2, 3]).gravity, [1, 2, 3])
    assert np.array_equal(robot.gravity, [0, -9.81, 0])
    doubled = robot.with_standard_parameters(2 * robot.standard_parameters)
    assert doubled != robot
    assert np.array_equal(doubled.standard_parameters, 2 * robot.standard_parameters)
    with pytest.raises(sgpr.SgprError, match=r"parameters: got \(3,\), expected \(20,\)"):
        robot.with_standard_parameters([1, 2, 3])
    with pytest.raises(sgpr.SgprError, match=r"gravity: got \(2,\), expected \(3,\)"):
        robot.with_gravity([1, 2])


def test_robots_travel_by_pickle(reference: Reference) -> None:
    robot = pickle.loads(pickle.dumps(reference.robot))
    assert robot == reference.robot
    assert hash(robot) == hash(reference.robot)
    assert np.array_equal(robot.standard_parameters, reference.robot.standard_parameters)


def test_inertias_that_no_body_has_travel_too() -> None:
    robot = sgpr.robots.two_link()
    strange = robot.with_standard_parameters(-robot.standard_parameters)
    assert pickle.loads(pickle.dumps(strange)) == strange


def test_files_that_are_no_robots() -> None:
    with pytest.raises(FileNotFoundError) as error:
        sgpr.Robot.from_urdf("nowhere.urdf")
    assert error.value.filename == "nowhere.urdf"
    with pytest.raises(IsADirectoryError):
        sgpr.Robot.from_urdf(DATA)
    with pytest.raises(sgpr.RobotError, match="mine: not a URDF"):
        sgpr.Robot.from_urdf_text("<nonsense", origin="mine")
    with pytest.raises(sgpr.RobotError, match="no joint `elbow`"):
        sgpr.Robot.from_urdf_text(PENDULUM, ["elbow"])
    with pytest.raises(TypeError, match="joints: got a str"):
        sgpr.Robot.from_urdf_text(PENDULUM, "hinge")


def test_a_joint_that_mimics_another_is_told(tmp_path: Path) -> None:
    body = '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    link = '<link name="{}"><inertial>' + body + "</inertial></link>"
    joint = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>' + limit + "{}</joint>"
    path = tmp_path / "hand.urdf"
    path.write_text(
        '<robot name="hand">'
        + "".join(link.format(name) for name in ("palm", "left", "right"))
        + joint.format("finger", "palm", "left", "")
        + joint.format("follower", "palm", "right", '<mimic joint="finger"/>')
        + "</robot>"
    )
    robot = sgpr.Robot.from_urdf(path)
    assert robot.joint_names == ["finger"]
    assert any("`follower` mimics `finger`" in text for text in robot.warnings)
    both = sgpr.Robot.from_urdf(path, ["finger", "follower"])
    assert not any("mimics" in text for text in both.warnings)
    assert "follower" in run("info", path).out.replace("\n", " ")
