"""What a notebook shows and keeps: tables, figures, pages, pickles, parts of logs."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import sgpr
from conftest import assert_same


@pytest.fixture(scope="module")
def diagnosis(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording) -> sgpr.Diagnosis:
    model = sgpr.identify(demo_robot, demo_logs[:1], effects=["viscous_friction", "rotor_inertia"])
    return sgpr.diagnose(model, demo_logs[:1], [demo_test], effects=["coulomb_friction"])


def test_parts_of_a_log(log: sgpr.Recording) -> None:
    assert_same(log[10:20], log.slice(10, 20))
    assert_same(log[-5:], log.slice(45, 50))
    part = log.between(0.1, 0.2)
    assert (len(part), part.t[0]) == (11, 0.0)
    assert part.time_ns[0] - log.time_ns[0] == 100_000_000
    for wrong in (3, "a"):
        with pytest.raises(TypeError, match="a slice of sample numbers"):
            log[wrong]  # type: ignore[index]
    with pytest.raises(sgpr.SgprError, match="step"):
        log[::2]
    with pytest.raises(sgpr.SgprError, match="no sample is left"):
        log.between(7.0, 8.0)


def test_pickles(demo_model: sgpr.Model, demo_test: sgpr.Recording) -> None:
    back = pickle.loads(pickle.dumps(demo_test))
    assert_same(back, demo_test)
    assert back.layout == demo_test.layout and back.content_hash == demo_test.content_hash
    accepted = demo_test.accept(["torque_scale"])
    assert pickle.loads(pickle.dumps(accepted)).accepted == ["torque_scale"]
    found = sgpr.compare(demo_model, [demo_test])
    again = pickle.loads(pickle.dumps(found))
    assert again.to_dict() == found.to_dict()
    for one, other in zip(again.logs, found.logs, strict=True):
        for name in (
            "time_ns",
            "measured",
            "predicted",
            "measured_in_band",
            "predicted_in_band",
            "counted",
            "q",
            "ddq",
        ):
            assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=name != "counted"), name
    assert np.array_equal(demo_model.standard_deviation(again.logs[0]), demo_model.standard_deviation(found.logs[0]))
    base = demo_model.robot.base_parameters(["rotor_inertia"], recursion=True)
    assert pickle.loads(pickle.dumps(base)).expressions == base.expressions


def test_pickled_diagnoses(diagnosis: sgpr.Diagnosis, demo_model: sgpr.Model) -> None:
    back = pickle.loads(pickle.dumps(diagnosis))
    assert repr(back) == repr(diagnosis) and back.to_dict() == diagnosis.to_dict()
    assert back.model.to_bytes() == diagnosis.model.to_bytes()
    finding = diagnosis.findings[0]
    again = pickle.loads(pickle.dumps(finding))
    assert repr(again) == repr(finding) == repr(back.findings[0])
    # What it is made of is there as well: added to another model it makes the same one.
    assert demo_model.add(again).to_bytes() == demo_model.add(finding).to_bytes()
    mere = next(one for one in diagnosis.candidates if repr(one) != repr(finding))
    assert repr(pickle.loads(pickle.dumps(mere))) == repr(mere)


def test_motions_and_simulations(tmp_path: Path) -> None:
    robot = sgpr.robots.two_link()
    found = sgpr.excite(robot, terms=2, max_acceleration=[2, 2], starts=1, max_evaluations=20)
    lines = found.plot().data
    time = np.linspace(0.0, found.trajectory.duration, 1000)
    assert len(lines) == 6 and np.allclose(lines[3].y, found.trajectory.at(time)[1][:, 1])
    assert "tightest limit" in found._repr_html_()
    back = pickle.loads(pickle.dumps(found))
    assert repr(back) == repr(found) and back._repr_html_() == found._repr_html_()
    assert np.array_equal(back.history, found.history) and np.array_equal(back.values, found.values)
    assert repr(back.report) == repr(found.report) and repr(back.peaks) == repr(found.peaks)
    assert np.array_equal(back.trajectory.at(time)[0], found.trajectory.at(time)[0])
    found.save_report(tmp_path / "motion.html")
    assert "Excitation trajectory" in (tmp_path / "motion.html").read_text()
    run = sgpr.simulate(robot, found.trajectory, duration=0.2)
    back = pickle.loads(pickle.dumps(run))
    for name in ("t", "q", "ddq", "friction", "q_measured", "tau_measured", "ddq_wanted"):
        assert np.array_equal(getattr(back, name), getattr(run, name))
    assert back.recording().q.tobytes() == run.recording().q.tobytes()
    assert np.array_equal(run.plot().data[2].y, run.tau[:, 0])
    assert "joint_2" in run._repr_html_()
    back.report(tmp_path / "run.html")
    assert "Position error" in (tmp_path / "run.html").read_text()
    state = run.__reduce__()[1]
    with pytest.raises(sgpr.SgprError, match="do not belong together"):
        type(run)._from_parts(state[0], state[1][:-1], state[2])


def test_prediction_for_a_recording(demo_model: sgpr.Model, demo_test: sgpr.Recording) -> None:
    [stretch] = sgpr.compare(demo_model, [demo_test]).logs
    torque, deviation = demo_model.predict(demo_test, return_std=True)
    assert torque.shape == demo_test.q.shape
    assert np.array_equal(torque, stretch.predicted)
    assert np.array_equal(deviation, demo_model.standard_deviation(stretch))
    silent = sgpr.Recording(demo_test.time_ns, demo_test.q, joint_names=demo_test.joint_names)
    assert np.array_equal(demo_model.predict(silent), torque)
    # A sample far before the others is in no stretch.
    strayed = np.concatenate([[demo_test.time_ns[0] - 10**10], demo_test.time_ns])
    longer = sgpr.Recording(strayed, np.concatenate([demo_test.q[:1], demo_test.q]), joint_names=demo_test.joint_names)
    found = demo_model.predict(longer)
    assert np.isnan(found[0]).all() and np.array_equal(found[1:], torque)
    with pytest.raises(sgpr.SgprError, match="give no dq"):
        demo_model.predict(demo_test, demo_test.q, demo_test.q)
    with pytest.raises(sgpr.SgprError, match="or a recording"):
        demo_model.predict(demo_test.q)


def test_tables(
    demo_model: sgpr.Model, demo_test: sgpr.Recording, demo_robot: sgpr.Robot, diagnosis: sgpr.Diagnosis
) -> None:
    shown = {
        "joint_6": [demo_robot, demo_test, demo_model],
        "joint_1.Fv": [demo_model],
        "coulomb_friction": [diagnosis, diagnosis.findings[0]],
    }
    for text, things in shown.items():
        for thing in things:
            html = thing._repr_html_()
            assert text in html and html.count("<table>") == 1
    name = sgpr.Recording([0.0, 0.1], [[0.0], [1.0]], source="<script>", joint_names=["<b>"])._repr_html_()
    assert "<script>" not in name and "<b>&lt;" in name and "&lt;b&gt;" in name


def test_figures(
    demo_model: sgpr.Model, demo_test: sgpr.Recording, demo_robot: sgpr.Robot, diagnosis: sgpr.Diagnosis
) -> None:
    assert len(demo_test.plot().data) == 3 * 6
    assert len(demo_model.plot([demo_test]).data) == 2 * 6
    measured = demo_model.plot([demo_test]).data[0].y
    torque = demo_test.tau[:, 0]
    assert np.nanmax(measured) == torque.max() and np.nanmin(measured) == torque.min()
    arm = demo_robot.plot().data[0]
    assert len(arm.x) == len(demo_robot.frames) + 1
    finding = diagnosis.findings[0]
    steps = diagnosis.plot().data
    # The model as it was, then with one finding after the other.
    assert len(steps) == 1 + len(diagnosis.findings)
    for joint in finding.joints:
        assert steps[-1].y[steps[-1].x.index(joint)] < 0.9 * steps[0].y[steps[0].x.index(joint)]
    assert list(finding.plot().data[1].y) == list(finding.rmse_after.values())


def test_a_diagnosis_says_its_answer_in_five_lines(diagnosis: sgpr.Diagnosis) -> None:
    lines = repr(diagnosis).splitlines()
    assert len(lines) == 5
    assert lines[0].startswith("Diagnosis: effects_found.")
    assert "coulomb_friction at joint_" in lines[1]
    assert lines[4].startswith("next: ")


def test_pages(tmp_path: Path, demo_model: sgpr.Model, demo_test: sgpr.Recording, diagnosis: sgpr.Diagnosis) -> None:
    diagnosis.report(tmp_path / "new" / "diagnosis.html")
    assert "Diagnosis of the model of" in (tmp_path / "new" / "diagnosis.html").read_text()
    demo_model.save_report(tmp_path / "new" / "model.html", [demo_test])
    assert "What the error depends on" in (tmp_path / "new" / "model.html").read_text()
    demo_model.save(tmp_path / "another" / "model.sgpr")
    assert sgpr.load(tmp_path / "another" / "model.sgpr").robot.dof == 6


def test_a_model_keeps_how_its_logs_were_read(tmp_path: Path, demo_model: sgpr.Model) -> None:
    assert demo_model.reading is None
    noted = demo_model.with_reading({"units": {"position": "deg"}})
    noted.save(tmp_path / "model.sgpr")
    assert sgpr.load(tmp_path / "model.sgpr").reading == {"units": {"position": "deg"}}


def test_processes() -> None:
    rng = np.random.default_rng(0)
    x = np.sort(rng.uniform(0.0, 6.0, (120, 1)), axis=0)
    y = np.sin(x[:, 0]) + 0.1 * rng.standard_normal(120)
    gp = sgpr.GaussianProcess()
    assert "<pre>" in gp._repr_html_()
    gp.fit(x, y)
    assert gp.theta_names_[0] in gp._repr_html_()
    measured, low, high, mean = gp.plot(x, y).data
    assert np.array_equal(measured.y, y) and np.array_equal(mean.y, gp.predict(x))
    inside = (np.asarray(low.y) <= y) & (y <= np.asarray(high.y))
    assert 0.88 < inside.mean() <= 1.0
    two = np.column_stack([x, rng.standard_normal(120)])
    wide = sgpr.GaussianProcess().fit(two, y)
    assert np.array_equal(wide.plot(two, y).data[0].x, y)
    with pytest.raises(ValueError, match="y: the measured outputs"):
        wide.plot(two)


def test_physics_and_processes(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    log = demo_logs[0].between(0.0, 6.0)
    model = sgpr.SemiParametricModel(demo_robot, points=20, inputs="own_velocity", max_evaluations=3)
    assert "<pre>" in model._repr_html_()
    model.fit([log])
    assert "joint_6" in model._repr_html_() and model._repr_html_().count("<tr>") == 7
    figure = model.plot([log])
    assert len(figure.data) == 3 * 6
    assert [line.name for line in figure.data[:3]] == ["measured", "physics", "with processes"]
