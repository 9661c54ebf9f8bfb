"""Parameters of bodies: the proof, the limits, and robot files that other codes read."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import sgpr
from conftest import DATA

URDF = DATA / "demo" / "robot.urdf"


@pytest.fixture(scope="module")
def consistent(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(demo_robot, demo_logs, consistent=True)


def test_consistency_costs_little_and_is_proven(
    consistent: sgpr.Model, demo_model: sgpr.Model, demo_test: sgpr.Recording, tmp_path: Path
) -> None:
    free, bound = (sgpr.compare(model, [demo_test]).relative_error_percent for model in (demo_model, consistent))
    assert bound < 1.02 * free
    certificate = consistent.certificate
    assert certificate is not None
    assert demo_model.certificate is None
    assert [link["joint"] for link in certificate["links"]] == consistent.robot.joint_names
    for link, values in zip(certificate["links"], consistent.all_parameters[:60].reshape(6, 10), strict=True):
        m, mx, my, mz, xx, xy, yy, xz, yz, zz = values
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
        pseudo[:3, 3] = pseudo[3, :3] = mx, my, mz
        pseudo[3, 3] = m
        smallest = np.linalg.eigvalsh(pseudo).min()
        assert smallest > 0.0
        assert np.isclose(smallest, link["smallest_eigenvalue"], rtol=1e-6, atol=1e-12)
    friction = dict(zip(consistent.all_parameter_names, consistent.all_parameters, strict=True))
    assert all(value > -1e-6 for name, value in friction.items() if name.endswith((".Fv", ".Fc", ".Ia")))
    consistent.save(tmp_path / "model.sgpr")
    assert sgpr.load(tmp_path / "model.sgpr").certificate == certificate


def test_limits_have_prices_and_the_data_choose_the_pull(
    consistent: sgpr.Model, demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], tmp_path: Path
) -> None:
    name = f"{demo_robot.joint_names[0]}.Fc"
    coulomb = dict(zip(consistent.all_parameter_names, consistent.all_parameters, strict=True))[name]
    bounds = {name: (3.0 * coulomb, None)}
    model = sgpr.identify(demo_robot, demo_logs[:1], consistent=True, bounds=bounds)
    assert model.certificate is not None
    dearest = model.certificate["prices"][0]
    assert name in dearest["limit"]
    assert 0.5 < dearest["share"] <= 1.0
    stage = model.certificate["stages"][0]
    assert stage["limit"] == dearest["limit"]
    assert stage["residual_percent"] < 0.5 * model.certificate["residual_percent"]
    # The limit is wrong, so it costs where the motion is new, too.
    kept_out = model.certificate["kept_out"]
    assert kept_out["consistent_percent"] > kept_out["unconstrained_percent"] > 0.0
    assert model.report is not None
    (text,) = (text for text in model.report.warnings if "consistency costs" in text)
    assert name in text and "they cost where the motion is new, too" in text
    assert f"Check what you set: {dearest['limit']}." in text
    model.save(tmp_path / "model.sgpr")
    assert sgpr.load(tmp_path / "model.sgpr").certificate == model.certificate
    chosen = sgpr.identify(demo_robot, demo_logs[:1], consistent=True, prior_deviation="auto")
    assert chosen.certificate is not None
    assert chosen.certificate["prior_deviation"] in (1.0, 3.0, 10.0, 30.0, 100.0)
    assert chosen.report is not None
    assert any("error by relative deviation" in text for text in chosen.report.warnings)


def test_logs_without_noise_are_solved(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    # Torques that a model gives for the motion as it is processed: nothing is left but rounding.
    truth = sgpr.identify(demo_robot, demo_logs, consistent=True)
    exact = []
    for log in demo_logs:
        (motion,) = sgpr.compare(truth, [log]).logs
        tau = truth.predict(motion.q, motion.dq, motion.ddq)
        exact.append(sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names, source=log.source))
    assert truth.processing is not None
    model = sgpr.identify(demo_robot, exact, consistent=True, cutoff_hz=truth.processing.cutoff_hz)
    values, expected = (np.array([p.value for p in each.parameters]) for each in (model, truth))
    assert np.abs(values - expected).max() < 1e-5 * np.abs(expected).max()


def test_limits_are_kept_and_contradictions_named(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    names = demo_robot.joint_names
    bounds: dict[str, Any] = {
        names[5]: {"mass": (0.5, 0.6), "ellipsoid": ([0.0, 0.0, 0.03], [0.02, 0.02, 0.05])},
        f"{names[0]}.Fv": (0.1, None),
    }
    model = sgpr.identify(demo_robot, demo_logs[:1], consistent=True, bounds=bounds)
    assert model.certificate is not None
    assert 0.5 - 1e-4 <= model.certificate["links"][5]["mass"] <= 0.6 + 1e-4
    with pytest.raises(sgpr.IdentificationError) as refused:
        limits = {names[5]: {"mass": (5.0, 6.0)}, names[4]: {"mass": (1.0, 9.0)}, "total_mass": (0.0, 4.0)}
        sgpr.identify(demo_robot, demo_logs[:1], consistent=True, bounds=limits)
    message = str(refused.value)
    assert "at least 5 kg" in message
    assert "at most 4 kg" in message
    assert names[4] not in message


@pytest.mark.parametrize(
    "options",
    [
        {"prior": "entropic"},
        {"consistent": True, "prior": "guess"},
        {"consistent": True, "prior_deviation": -1.0},
        {"consistent": True, "prior_deviation": "guess"},
        {"consistent": True, "bounds": {"elbow": {"mass": (0, 1)}}},
        {"consistent": True, "bounds": {"total_mass": 3.0}},
        {"consistent": True, "bounds": {"joint_1": {"volume": (0, 1)}}},
        {"consistent": True, "start": "zero"},
        {"consistent": True, "essential": True},
    ],
)
def test_options_that_make_no_sense_are_refused(
    options: dict[str, Any], demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]
) -> None:
    with pytest.raises(sgpr.SgprError):
        sgpr.identify(demo_robot, demo_logs[:1], **options)


def states(robot: sgpr.Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(4)
    return tuple(random.uniform(-1.0, 1.0, (20, robot.dof)) for _ in range(3))  # type: ignore[return-value]


def test_the_urdf_that_is_written_is_the_model(consistent: sgpr.Model, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    consistent.write_urdf(URDF, path)
    robot = sgpr.Robot.from_urdf(path)
    motion = states(robot)
    expected = consistent.identified_robot.inverse_dynamics(*motion)
    assert np.allclose(robot.inverse_dynamics(*motion), expected, rtol=1e-9, atol=1e-9)


def test_friction_is_written_where_robot_files_have_a_place_for_it(consistent: sgpr.Model, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    consistent.write_urdf(URDF, path)
    # What reads the file has the same friction as the model: the file's own is gone.
    nominal = sgpr.Model.nominal(sgpr.Robot.from_urdf(path))
    assert nominal.effects == ["viscous_friction", "coulomb_friction"]
    names = nominal.all_parameter_names
    written = dict(zip(names, nominal.all_parameters, strict=True))
    found = dict(zip(consistent.all_parameter_names, consistent.all_parameters, strict=True))
    friction = [name for name in names if name.endswith((".Fv", ".Fc"))]
    assert len(friction) == 12
    assert max(written[name] for name in friction) > 0.1
    assert all(written[name] == found[name] for name in friction)
    # A second writing changes nothing.
    consistent.write_urdf(path, tmp_path / "again.urdf")
    assert (tmp_path / "again.urdf").read_text().count("<dynamics") == 6
    again = sgpr.Model.nominal(sgpr.Robot.from_urdf(tmp_path / "again.urdf"))
    assert np.allclose(again.all_parameters, nominal.all_parameters, rtol=1e-9, atol=1e-12)


def test_pinocchio_reads_the_urdf_and_gives_our_torque(consistent: sgpr.Model, tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    path = tmp_path / "robot.urdf"
    consistent.write_urdf(URDF, path)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    q, dq, ddq = states(consistent.robot)
    theirs = np.array([pin.rnea(model, data, *sample) for sample in zip(q, dq, ddq, strict=True)])
    assert np.allclose(theirs, consistent.identified_robot.inverse_dynamics(q, dq, ddq), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("source", ["urdf", "mjcf"])
def test_mujoco_reads_the_file_and_gives_our_torque(consistent: sgpr.Model, tmp_path: Path, source: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    if source == "urdf":
        path = tmp_path / "robot.urdf"
        consistent.write_urdf(URDF, path)
        # MuJoCo lumps links of URDFs together and balances inertias unless told otherwise.
        text = path.read_text()
        extra = '<mujoco><compiler balanceinertia="false" fusestatic="true"/></mujoco></robot>'
        model = mujoco.MjModel.from_xml_string(text.replace("</robot>", extra))
    else:
        model = mujoco.MjModel.from_xml_string(consistent.to_mjcf())
    armature = np.array(model.dof_armature)
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    q, dq, ddq = states(consistent.robot)
    expected = consistent.identified_robot.inverse_dynamics(q, dq, ddq) + armature * ddq
    for sample, tau in zip(zip(q, dq, ddq, strict=True), expected, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = sample
        mujoco.mj_inverse(model, data)
        assert np.allclose(data.qfrc_inverse, tau, rtol=1e-6, atol=1e-6)


def test_what_is_no_body_is_not_written(demo_model: sgpr.Model, tmp_path: Path) -> None:
    with pytest.raises(sgpr.RobotError, match="no body"):
        demo_model.write_urdf(URDF, tmp_path / "robot.urdf")
    assert not (tmp_path / "robot.urdf").exists()
    with pytest.raises(sgpr.RobotError, match="no body"):
        demo_model.to_mjcf()
    with pytest.raises(FileNotFoundError):
        demo_model.write_urdf(tmp_path / "nothing.urdf", tmp_path / "robot.urdf")


def test_a_consistent_model_with_an_effect_of_the_trajectory_writes_its_bodies(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording, tmp_path: Path
) -> None:
    joint = demo_robot.joint_names[1]
    effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", f"stribeck_friction@{joint}"]
    model = sgpr.identify(demo_robot, demo_logs, effects=effects, consistent=True)
    (term,) = model.terms
    assert (term["effect"], term["joints"]) == ("stribeck_friction", [joint])
    size, deviation, unit = term["parameters"][f"{joint}.dFs"]
    assert abs(size) < 1e-6 and deviation > 0.0 and unit == "N·m"
    # The arm has no such friction, so below which speed it would act is not known.
    value, deviation, unit = term["parameters"][f"{joint}.vs"]
    assert value > 0.0 and deviation is None and unit == "rad/s"
    assert model.certificate is not None
    assert all(link["smallest_eigenvalue"] > 0.0 for link in model.certificate["links"])
    plain = sgpr.identify(demo_robot, demo_logs, effects=effects[:3], consistent=True)
    error, without = (sgpr.compare(m, [demo_test]).relative_error_percent for m in (model, plain))
    assert error < 1.01 * without
    assert "<mujoco" in model.to_mjcf()
    model.save(tmp_path / "model.sgpr")
    again = sgpr.load(tmp_path / "model.sgpr")
    assert again.terms == model.terms and again.certificate == model.certificate

    with pytest.raises(sgpr.IdentificationError, match="cannot be at"):
        sgpr.identify(demo_robot, demo_logs[:1], effects=["stribeck_friction@elbow"])


def test_friction_of_a_single_joint_is_in_the_files_of_other_codes(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], tmp_path: Path
) -> None:
    joint = demo_robot.joint_names[1]
    effects = ["coulomb_friction", "rotor_inertia", f"viscous_friction@{joint}"]
    model = sgpr.identify(demo_robot, demo_logs, effects=effects, consistent=True)
    (term,) = model.terms
    ((value, *_),) = term["parameters"].values()
    damping = [float(found) for found in re.findall(r'damping="([^"]*)"', model.to_mjcf())]
    assert [found for found in damping if found] == [pytest.approx(value)]
    model.write_urdf(URDF, tmp_path / "robot.urdf")

    def damping_of(path: Path) -> dict[str | None, float]:
        found = [(each.get("name"), each.find("dynamics")) for each in ElementTree.parse(path).getroot().iter("joint")]
        return {name: float(dynamics.get("damping", "0")) for name, dynamics in found if dynamics is not None}

    after = damping_of(tmp_path / "robot.urdf")
    assert after[joint] == pytest.approx(value)
    assert not any(damping for name, damping in after.items() if name != joint)
