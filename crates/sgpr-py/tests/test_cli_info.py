"""`sgpr info`."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import DEMO_ROBOT, DEMO_TEST, DEMO_TRAIN, JOINTS, RECORDINGS, run, write_log


def test_robot_with_effects() -> None:
    found = run("info", DEMO_ROBOT, "--json", "--effects", "viscous_friction", "rotor_inertia")
    [data] = json.loads(found.out)
    assert (found.code, found.err) == (0, "")
    assert data["type"] == "robot"
    assert data["dof"] == 6
    robot = sgpr.Robot.from_urdf(DEMO_ROBOT)
    base = robot.base_parameters(["viscous_friction", "rotor_inertia"])
    assert [p["expression"] for p in data["base_parameters"]] == base.expressions
    assert data["moving_mass_kg"] == robot.standard_parameters[::10].sum()
    assert set(data["standard_parameter_classes"].values()) <= {"identifiable", "combination", "invisible"}


def test_ready_made_robot_for_people() -> None:
    found = run("info", "two_link")
    assert found.code == 0
    for text in ("joint", "base parameter", "identifiable", "combination", "kg"):
        assert text in found.out


def test_formulas_of_base_parameters() -> None:
    found = run("info", "two_link", "--base-parameters", "--effects", "rotor_inertia")
    assert found.code == 0
    assert "ZZ1R = ZZ1 + M2 + Ia1" in found.out
    [data] = json.loads(run("info", "two_link", "--base-parameters", "--json").out)
    assert [p["formula"] for p in data["base_parameters"]] == sgpr.robots.two_link().base_parameters().formulas


def test_gravity_of_an_arm_that_is_mounted_otherwise() -> None:
    # In the plane of the motion gravity reveals first moments; across it only inertias are left.
    for gravity, count in (("0 -9.81 0", 6), ("0 0 -9.81", 4)):
        [data] = json.loads(run("info", "two_link", "--gravity", *gravity.split(), "--json").out)
        assert len(data["base_parameters"]) == count


def test_screening_against_the_robot(tmp_path: Path) -> None:
    arguments = ("--robot", "two_link", "--effects", "viscous_friction", "coulomb_friction", "--json")
    [data] = json.loads(run("info", write_log(tmp_path / "log.csv", 1), *arguments).out)
    screening = data["screening"]
    assert screening["refused"] is None
    assert "excites all" in screening["excitation"]
    assert not any("negated" in text for text in screening["findings"])

    def negated(table: np.ndarray) -> np.ndarray:
        table[:, 4] *= -1.0
        return table

    path = write_log(tmp_path / "negated.csv", 1, negated)
    [data] = json.loads(run("info", path, *arguments).out)
    assert any("joint_2" in text and "negated" in text for text in data["screening"]["findings"])
    assert "negated" in run("info", path, *arguments[:-1]).out

    def too_short(table: np.ndarray) -> np.ndarray:
        return table[:8]

    [data] = json.loads(run("info", write_log(tmp_path / "short.csv", 1, too_short), *arguments).out)
    assert data["screening"]["refused"]


def test_whether_a_log_is_enough_is_said(tmp_path: Path) -> None:
    effects = ("viscous_friction", "coulomb_friction", "torque_offset")
    enough = run("info", write_log(tmp_path / "log.csv", 1), "--robot", "two_link", "--effects", *effects)
    assert enough.code == 0 and "enough data" in enough.out, enough.out
    found = run("info", DEMO_ROBOT, DEMO_TRAIN[0])
    assert found.code == 0 and "s of motion like this: until then" in found.out, found.out
    with gzip.open(DEMO_TRAIN[0], "rt") as file:
        table = file.read().splitlines(keepends=True)
    (tmp_path / "short.csv").write_text("".join(table[: len(table) * 3 // 20]))
    [_, data] = json.loads(run("info", DEMO_ROBOT, tmp_path / "short.csv", "--json").out)
    said = data["screening"]["how_much_data"]
    assert said["seconds_to_go"] is None or said["seconds_to_go"] > 1.0
    assert "record another" in said["answer"]
    assert [len(joint["standard_deviations"]) for joint in said["joints"]] == [len(said["seconds"])] * 6

    def one_way(table: np.ndarray) -> np.ndarray:
        # The second joint turns one way only, and the first one both ways.
        t = table[:, 0]
        q = np.column_stack([0.6 * np.sin(2.0 * t), 0.5 * t + 0.1 * np.sin(t)])
        dq = np.column_stack([1.2 * np.cos(2.0 * t), 0.5 + 0.1 * np.cos(t)])
        ddq = np.column_stack([-2.4 * np.sin(2.0 * t), -0.1 * np.sin(t)])
        noise = 0.01 * np.random.default_rng(1).standard_normal(q.shape)
        tau = sgpr.robots.two_link().inverse_dynamics(q, dq, ddq) + 0.3 * dq + 0.4 * np.sign(dq) + noise
        return np.column_stack([t, q, tau])

    path = write_log(tmp_path / "one_way.csv", 1, one_way)
    [data] = json.loads(run("info", path, "--robot", "two_link", "--effects", *effects, "--json").out)
    said = data["screening"]["how_much_data"]
    assert said["seconds_to_go"] is None and "`joint_2` must reverse" in said["answer"], said["answer"]


def test_saturated_torques_and_impossible_positions_are_named(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    links = "".join(
        f'<link name="l{k}"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>'
        for k in (1, 2)
    )
    joints = "".join(
        f'<joint name="joint_{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="0 0 1"/>'
        f'<origin xyz="{0.5 * (k - 1)} 0 0"/><limit lower="-0.3" upper="0.3" effort="2" velocity="5"/></joint>'
        for k in (1, 2)
    )
    urdf.write_text(f'<robot name="arm"><link name="l0"/>{links}{joints}</robot>')

    def clipped(table: np.ndarray) -> np.ndarray:
        table[:, 3] = np.clip(table[:, 3], -2.0, 2.0)
        return table

    path = write_log(tmp_path / "clipped.csv", 1, clipped)
    [data] = json.loads(run("info", path, "--robot", urdf, "--effects", "viscous_friction", "--json").out)
    findings = data["screening"]["findings"]
    assert any("torque of joint_1 is at or above its limit" in text for text in findings), findings
    assert any("position of joint_1 is outside its limits of -0.3 to 0.3 rad" in text for text in findings), findings
    model = sgpr.identify(sgpr.Robot.from_urdf(urdf), [sgpr.read(path)], effects=["viscous_friction"])
    assert model.report is not None
    assert any("is at or above its limit of 2 N·m" in text for text in model.report.warnings)


def test_log(tmp_path: Path) -> None:
    [data] = json.loads(run("info", write_log(tmp_path / "log.csv", 1), "--json").out)
    assert data["type"] == "log"
    assert data["samples"] == 2000
    assert np.isclose(data["rate_hz"], 100.0)
    assert len(data["joints"]) == JOINTS
    low, high = data["joints"][0]["torque"]
    assert low < high
    assert data["joints"][0]["velocity"] is None


def test_several_files_of_different_kinds() -> None:
    data = json.loads(run("info", DEMO_ROBOT, DEMO_TEST, RECORDINGS / "zstd.mcap", "--json").out)
    assert [entry["type"] for entry in data] == ["robot", "log", "log"]


def test_saved_model_is_known_by_its_content(tmp_path: Path) -> None:
    path = tmp_path / "no_suffix"
    sgpr.Model.nominal(sgpr.robots.two_link()).save(path)
    [data] = json.loads(run("info", path, "--json").out)
    assert data["type"] == "model"
    assert data["fit"] is None
    assert all(p["standard_deviation"] is None for p in data["parameters"])
    assert run("info", path).code == 0


def test_degrees_are_suspected(tmp_path: Path) -> None:
    def in_degrees(table: np.ndarray) -> np.ndarray:
        table[:, 1:3] = np.rad2deg(table[:, 1:3])
        return table

    path = write_log(tmp_path / "degrees.csv", 1, in_degrees)
    found = run("info", path)
    assert found.code == 1
    assert "stop: `joint_1_position` has a range of" in found.out
    identified = run("identify", "--robot", "two_link", "--train", path, "--out", tmp_path / "out")
    assert identified.code == 1
    assert "looks like degrees; give the unit of the position with `--units position=...`" in identified.err
    for confirmation in (("--units", "position=rad"), ("--accept", "position_in_degrees")):
        assert run("info", path, *confirmation).code == 0
    [data] = json.loads(run("info", path, "--units", "position=deg", "--json").out)
    assert not any("degree" in issue["message"] for issue in data["issues"])


def test_milliradians_are_named(tmp_path: Path) -> None:
    def in_milliradians(table: np.ndarray) -> np.ndarray:
        table[:, 1:3] *= 1e3
        return table

    path = write_log(tmp_path / "log.csv", 1, in_milliradians)
    found = run("info", path)
    assert found.code == 1
    assert "looks like milliradians; give the unit of the position with `--units position=...` (mrad" in found.out
    # What the message says is the remedy.
    [data] = json.loads(run("info", path, "--units", "position=mrad", "--json").out)
    [plain] = json.loads(run("info", write_log(tmp_path / "plain.csv", 1), "--json").out)
    assert data["joints"][0]["position"] == pytest.approx(plain["joints"][0]["position"])
    assert data["issues"] == plain["issues"]


def test_not_finite_values_are_errors_and_valid_json(tmp_path: Path) -> None:
    def with_gap(table: np.ndarray) -> np.ndarray:
        table[100:110, 3] = np.nan
        return table

    [data] = json.loads(run("info", write_log(tmp_path / "nan.csv", 1, with_gap), "--json").out)
    assert "error" in {issue["severity"] for issue in data["issues"]}


def test_table_of_denavit_hartenberg_parameters(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(
        'convention = "standard"\nname = "arm"\njoints = ["shoulder", "elbow"]\n'
        "[[rows]]\na = 0.5\nalpha = 0.0\nd = 0.0\ntheta = 0.0\nmass = 2.0\n"
        "[[rows]]\na = 0.4\nalpha = 0.0\nd = 0.0\ntheta = 0.0\nmass = 1.0\n"
    )
    [data] = json.loads(run("info", path, "--json").out)
    assert [joint["name"] for joint in data["joints"]] == ["shoulder", "elbow"]
    assert data["moving_mass_kg"] == 3.0


def test_quiet_is_quiet() -> None:
    found = run("info", "puma560", "--quiet")
    assert (found.code, found.out, found.err) == (0, "", "")
