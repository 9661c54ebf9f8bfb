"""Model against measurement."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import sgpr
from scipy import signal


@pytest.fixture(scope="module")
def comparison(demo_model: sgpr.Model, demo_test: sgpr.Recording) -> sgpr.Comparison:
    return sgpr.compare(demo_model, [demo_test])


def test_figures_are_those_of_the_curves(comparison: sgpr.Comparison) -> None:
    (log,) = comparison.logs
    for joint, row in enumerate(comparison.joints):
        counted = log.counted[:, joint]
        measured = log.measured_in_band[counted, joint]
        residual = measured - log.predicted_in_band[counted, joint]
        assert row.samples == counted.sum()
        assert row.rmse == pytest.approx(np.sqrt(np.mean(residual**2)))
        assert row.relative_error_percent == pytest.approx(100 * np.linalg.norm(residual) / np.linalg.norm(measured))
        spread = np.linalg.norm(measured - measured.mean())
        assert row.fit_percent == pytest.approx(100 * (1 - np.linalg.norm(residual) / spread))
        assert row.r2 == pytest.approx(1 - (np.linalg.norm(residual) / spread) ** 2)
        assert row.largest_error == np.abs(residual).max()
        place = np.flatnonzero(counted)[np.abs(residual).argmax()]
        assert row.largest_error_time == pytest.approx(log.t[place])
        assert row.largest_error_log == log.source
        full = log.measured[counted, joint] - log.predicted[counted, joint]
        assert row.rmse_full_band == pytest.approx(np.sqrt(np.mean(full**2)))
        assert row.rmse_zero == pytest.approx(np.sqrt(np.mean(measured**2)))


def test_curves_are_those_of_log_and_model(
    comparison: sgpr.Comparison, demo_model: sgpr.Model, demo_test: sgpr.Recording
) -> None:
    (log,) = comparison.logs
    assert log.source == demo_test.source
    assert np.array_equal(log.time_ns, demo_test.time_ns)
    assert np.allclose(log.t, demo_test.t)
    assert np.array_equal(log.measured, demo_test.tau)
    assert log.counted.dtype == np.bool_
    assert np.array_equal(log.predicted, demo_model.predict(log.q, log.dq, log.ddq))
    assert np.shares_memory(log.q, log.q)
    assert not log.measured.flags.writeable


def test_a_set_of_logs_is_predicted_log_by_log(
    demo_model: sgpr.Model, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    bare = sgpr.Recording(demo_test.time_ns, demo_test.q, joint_names=demo_test.joint_names, source="bare")
    found = demo_model.predict(sgpr.LogSet([*demo_logs, bare]), return_std=True)
    assert len(found) == len(demo_logs) + 1
    for (torque, deviation), log in zip(found, [*demo_logs, demo_test], strict=True):
        assert torque.shape == deviation.shape == log.q.shape
        assert np.array_equal(torque, demo_model.predict(log))
    (compared,) = sgpr.compare(demo_model, [demo_test]).logs
    assert np.array_equal(found[-1][0], compared.predicted)
    assert np.array_equal(found[-1][1], demo_model.standard_deviation(compared))
    with pytest.raises(sgpr.SgprError, match="give q, dq and ddq, or a recording or LogSet"):
        demo_model.predict(demo_test.q)


def test_torques_in_the_band_are_those_of_scipy(comparison: sgpr.Comparison, demo_model: sgpr.Model) -> None:
    (log,) = comparison.logs
    processing = demo_model.processing
    assert processing is not None and processing.torque_cutoff_hz is not None
    sections = signal.butter(processing.order, processing.torque_cutoff_hz, fs=log.rate_hz, output="sos")
    expected = signal.sosfiltfilt(sections, log.measured, axis=0)
    assert np.allclose(log.measured_in_band, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert np.array_equal(processing.in_band(log.measured, log.rate_hz), log.measured_in_band)
    assert np.array_equal(processing.in_band(log.predicted[:, 2], log.rate_hz), log.predicted_in_band[:, 2])
    with pytest.raises(sgpr.SgprError, match="too few"):
        processing.in_band(log.measured[:5], log.rate_hz)
    with pytest.raises(ValueError, match="expected"):
        processing.in_band(np.zeros((3, 2, 2)), log.rate_hz)


def test_a_comparison_has_a_page(comparison: sgpr.Comparison, tmp_path: Path) -> None:
    for number, one in enumerate([comparison, pickle.loads(pickle.dumps(comparison))]):
        path = tmp_path / f"{number}.html"
        one.report(path)
        page = path.read_text(encoding="utf-8")
        assert comparison.logs[0].source in page
        assert all(joint.joint in page for joint in comparison.joints)
    assert (tmp_path / "0.html").read_text() == (tmp_path / "1.html").read_text()


def test_columns_and_tables(comparison: sgpr.Comparison, demo_robot: sgpr.Robot) -> None:
    assert [row.joint for row in comparison.joints] == demo_robot.joint_names
    for name in ("rmse", "fit_percent", "r2"):
        assert np.array_equal(getattr(comparison, name), [getattr(row, name) for row in comparison.joints])
    table = comparison.to_dict()
    assert json.loads(json.dumps(table, allow_nan=False)) == table
    attributes = {name for name in dir(comparison.joints[0]) if not name.startswith("_")}
    assert set(table["joints"][0]) == attributes
    assert table["relative_error_percent"] == comparison.relative_error_percent
    assert comparison.relative_error_with_rests_percent >= 0
    assert len(repr(comparison).splitlines()) == 8
    assert comparison._repr_html_().count("<tr>") == 7
    assert repr(comparison.joints[0])
    assert repr(comparison.logs[0])


def test_the_identified_model_is_better(
    comparison: sgpr.Comparison, demo_model: sgpr.Model, demo_robot: sgpr.Robot, demo_test: sgpr.Recording
) -> None:
    for processing in (demo_model, demo_model.processing):
        before = sgpr.compare(demo_robot, [demo_test], processing=processing)
        assert np.all(before.rmse > comparison.rmse)
        assert np.array_equal(before.logs[0].measured_in_band, comparison.logs[0].measured_in_band)
    nominal = sgpr.compare(sgpr.Model.nominal(demo_robot), [demo_test], processing=demo_model)
    assert np.array_equal(nominal.rmse, before.rmse)
    chosen = sgpr.compare(demo_robot, [demo_test])
    assert np.all(np.isfinite(chosen.rmse))


def test_a_joint_that_stands_has_no_figures(demo_model: sgpr.Model, demo_test: sgpr.Recording) -> None:
    q = demo_test.q.copy()
    q[:, 5] = 0.1
    still = sgpr.Recording(demo_test.time_ns, q, tau=demo_test.tau)
    table = sgpr.compare(demo_model, [still]).to_dict()
    assert table["joints"][5]["samples"] == 0
    assert table["joints"][5]["r2"] is None
    json.dumps(table, allow_nan=False)


def test_what_cannot_be_compared(demo_model: sgpr.Model, demo_robot: sgpr.Robot, demo_test: sgpr.Recording) -> None:
    with pytest.raises(TypeError, match="model: got str, expected Model or Robot"):
        sgpr.compare("model", [demo_test])  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="processing: got int, expected Model or Processing"):
        sgpr.compare(demo_model, [demo_test], processing=3)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="recordings: got Recording, expected a list of Recording"):
        sgpr.compare(demo_model, demo_test)  # type: ignore[arg-type]
    with pytest.raises(sgpr.RecordingError, match="there is no joint"):
        sgpr.compare(demo_model, [demo_test.select(["joint_1"])])
    with pytest.raises(sgpr.RecordingError, match="there is no torque"):
        sgpr.compare(demo_model, [sgpr.Recording(demo_test.time_ns, demo_test.q)])
    two = sgpr.Recording(demo_test.time_ns, demo_test.q[:, :2], tau=demo_test.tau[:, :2])
    with pytest.raises(sgpr.SgprError, match="processing: it is for 6 joints, the model has 2"):
        sgpr.compare(sgpr.robots.two_link(), [two], processing=demo_model)
    for nothing in (demo_robot, demo_model):
        with pytest.raises(sgpr.IdentificationError, match="no recording was given"):
            sgpr.compare(nothing, [])


def test_another_log_at_the_stamps_of_the_session_is_told(
    demo_model: sgpr.Model, demo_logs: list[sgpr.Recording]
) -> None:
    demo_train = demo_logs[0]
    assert demo_train.dq is not None and demo_train.tau is not None
    half = len(demo_train.time_ns) // 2
    first, second = [
        sgpr.Recording(demo_train.time_ns[:half], q, dq, tau, joint_names=demo_train.joint_names, source=source)
        for source, q, dq, tau in (
            ("train.csv", demo_train.q[:half], demo_train.dq[:half], demo_train.tau[:half]),
            (
                "test.csv",
                demo_train.q[half : 2 * half],
                demo_train.dq[half : 2 * half],
                demo_train.tau[half : 2 * half],
            ),
        )
    ]
    plain = sgpr.identify(demo_model.robot, [first])
    assert sgpr.compare(plain, [second]).notes == []
    warming = plain.add(f"friction_warmup@{demo_model.robot.joint_names[1]}", [first])
    assert sgpr.compare(warming, [first]).notes == []
    with pytest.warns(UserWarning, match=r"test\.csv: another log at the time stamps .*friction_warmup.* one clock"):
        found = sgpr.compare(warming, [second])
    assert len(found.notes) == 1


def test_a_set_of_logs_goes_wherever_a_list_goes(
    demo_robot: sgpr.Robot, demo_model: sgpr.Model, demo_logs: list[sgpr.Recording]
) -> None:
    log, other, _ = demo_logs
    half = len(log) // 2
    pieces = [log[:half], log[half // 2 :]]
    with pytest.warns(UserWarning, match="would count twice"):
        logs = sgpr.LogSet(pieces)
    assert [len(own) for own in logs] == [half, len(log) - half]
    assert (logs.origins, len(logs.notes), logs[-1].source) == ([0, 1], 1, log.source)
    with pytest.raises(IndexError):
        logs[2]
    again = pickle.loads(pickle.dumps(logs))
    assert [own.content_hash for own in again] == [own.content_hash for own in logs]

    def figures(found: sgpr.Comparison) -> list[float]:
        return [found.relative_error_percent, *found.rmse]

    with pytest.warns(UserWarning, match="would count twice"):
        of_list = sgpr.compare(demo_model, pieces)
    of_set = sgpr.compare(demo_model, logs)
    assert figures(of_set) == figures(of_list)
    assert of_set.notes == of_list.notes == logs.notes
    assert sum(len(part.t) for part in of_set.logs) == len(log)
    assert figures(sgpr.compare_streaming(demo_model, logs)) == figures(sgpr.compare_streaming(demo_model, pieces))
    before = sgpr.compare(demo_robot, logs, processing=demo_model)
    whole = sgpr.LogSet(pieces, whole=True)
    assert sum(len(part.t) for part in sgpr.compare(demo_model, whole).logs) == sum(map(len, pieces))
    assert before.relative_error_percent > of_set.relative_error_percent

    own = list(logs)
    model = sgpr.identify(demo_robot, logs)
    np.testing.assert_array_equal(model.all_parameters, sgpr.identify(demo_robot, own).all_parameters)
    assert sgpr.screen(model, logs) == sgpr.screen(model, own)
    assert repr(sgpr.choose_processing(demo_robot, logs)) == repr(sgpr.choose_processing(demo_robot, own))
    assert sgpr.repeated_share(logs, log) == sgpr.repeated_share(own, log)
    assert sgpr.shared_samples(logs, log) == sgpr.shared_samples(own, log)
    joined = sgpr.compare_sessions(demo_robot, {"a": logs, "b": [other]})
    apart = sgpr.compare_sessions(demo_robot, {"a": own, "b": [other]})
    assert joined.sentences == apart.sentences
    assert joined.tests[0]["saved_percent"] == apart.tests[0]["saved_percent"]
