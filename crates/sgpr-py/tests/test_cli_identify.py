"""`sgpr identify`: what it leaves behind, and that it is right."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import COULOMB, DEMO_ROBOT, DEMO_TRAIN, VISCOUS, Finished, run, write_log
from sgpr.report.numbers import significant

Run = tuple[Finished, Path]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("logs")
    return [write_log(folder / f"log_{seed}.csv", seed) for seed in (1, 2, 3, 4)]


@pytest.fixture(scope="module")
def finished(logs: list[str], tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("results") / "new" / "folder"
    return identify(logs, out, "--mcap", out / "test.mcap"), out


def identify(logs: list[str], out: Path, *options: object) -> Finished:
    effects = ("--effects", "viscous_friction", "coulomb_friction")
    return run(
        "identify",
        "--robot",
        "two_link",
        "--train",
        *logs[:2],
        "--test",
        *logs[2:],
        *effects,
        "--out",
        out,
        "--json",
        *options,
    )


def rows_of(out: Path) -> list[dict[str, str]]:
    with (out / "predictions.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in rows])


def test_files_and_json(finished: Run) -> None:
    done, out = finished
    assert done.code == 0
    names = {"model.sgpr", "report.html", "predictions.csv", "identification.json", "test.mcap"}
    assert {path.name for path in out.iterdir()} == names
    data = json.loads(done.out)
    assert data == json.loads((out / "identification.json").read_text())
    for key in ("parameters", "comparison", "cutoff_influence", "settings", "versions", "messages", "fit", "logs"):
        assert key in data


def test_finds_the_friction(finished: Run) -> None:
    parameters = {p["name"]: p for p in json.loads(finished[0].out)["parameters"]}
    for joint, (viscous, coulomb) in enumerate(zip(VISCOUS, COULOMB, strict=True), start=1):
        for name, truth in ((f"joint_{joint}.Fv", viscous), (f"joint_{joint}.Fc", coulomb)):
            found = parameters[name]
            assert abs(found["value"] - truth) < max(5.0 * found["standard_deviation"], 0.02)


def test_better_than_before_on_unseen_logs(finished: Run) -> None:
    comparison = json.loads(finished[0].out)["comparison"]
    assert comparison["logs"] == "test"
    assert comparison["after"]["relative_error_percent"] < 0.2 * comparison["before"]["relative_error_percent"]


def test_predictions_are_those_of_the_model(finished: Run, logs: list[str]) -> None:
    rows = rows_of(finished[1])
    joints = ["joint_1", "joint_2"]
    expected = ["file", "t", *(f"{joint}_{which}" for joint in joints for which in ("measured", "before", "after"))]
    assert list(rows[0]) == expected
    model = sgpr.load(finished[1] / "model.sgpr")
    before = sgpr.Model.nominal(sgpr.robots.two_link())
    for path in logs[2:]:
        own = [row for row in rows if row["file"] == path]
        recording = sgpr.read(path)
        assert len(own) == len(recording)
        np.testing.assert_allclose(column(own, "t"), recording.time_ns * 1e-9, rtol=0, atol=1e-12)
        residual = sgpr.compare(model, [recording]).logs[0]
        again = model.predict(residual.q, residual.dq, residual.ddq)
        nominal = before.predict(residual.q, residual.dq, residual.ddq)
        for k, joint in enumerate(joints):
            np.testing.assert_allclose(column(own, f"{joint}_measured"), recording.tau[:, k], rtol=1e-8)
            np.testing.assert_allclose(column(own, f"{joint}_after"), again[:, k], rtol=1e-7, atol=1e-9)
            np.testing.assert_allclose(column(own, f"{joint}_before"), nominal[:, k], rtol=1e-7, atol=1e-9)


def test_figures_follow_from_the_predictions(finished: Run) -> None:
    rows = rows_of(finished[1])
    joint = json.loads(finished[0].out)["comparison"]["after"]["joints"][0]
    error = column(rows, "joint_1_measured") - column(rows, "joint_1_after")
    # The figure leaves out the ends of the logs, where derivatives are uncertain.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(joint["rmse_full_band"], rel=0.3)


def test_topics_of_the_mcap_file(finished: Run, logs: list[str]) -> None:
    path = finished[1] / "test.mcap"
    measured = sgpr.read(path, topics=["/log_1/measured"])
    predicted = sgpr.read(path, topics=["/log_1/predicted"])
    residual = sgpr.read(path, topics=["/log_1/residual"])
    assert len(measured) == len(sgpr.read(logs[2]))
    np.testing.assert_allclose(residual.tau, measured.tau - predicted.tau, atol=1e-12)


def test_same_input_same_bytes(logs: list[str], tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert identify(logs, tmp_path / name).code == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_an_existing_folder_is_reused(logs: list[str], tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "predictions.csv").write_text("old")
    assert identify(logs, tmp_path, "--no-report").code == 0
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "predictions.csv").read_text().startswith("file,t,")
    assert not (tmp_path / "report.html").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_failure_leaves_the_folder_as_it_was(logs: list[str], tmp_path: Path) -> None:
    (tmp_path / "predictions.csv").write_text("old")
    found = run("identify", "--robot", "two_link", "--train", logs[0], "--test", tmp_path / "no.csv", "--out", tmp_path)
    assert found.code == 1
    assert [path.name for path in tmp_path.iterdir()] == ["predictions.csv"]
    assert (tmp_path / "predictions.csv").read_text() == "old"


def test_a_test_log_that_repeats_the_training_is_named(finished: Run, logs: list[str], tmp_path: Path) -> None:
    assert json.loads((finished[1] / "identification.json").read_text())["repeated_motions"] == []
    # Another run of the same motion has other noise.
    noise = np.random.default_rng(3)
    again = write_log(tmp_path / "again.csv", 1, lambda table: table[100:] + noise.normal(0.0, 1e-9, table[100:].shape))
    out = tmp_path / "out"
    found = run("identify", "--robot", "two_link", "--train", *logs[:2], "--test", logs[2], again, "--out", out)
    assert found.code == 0, found.err
    (text,) = json.loads((out / "identification.json").read_text())["repeated_motions"]
    assert text.startswith(f"{again} repeats motions of the training logs for 100 %")
    assert "repeats motions" in " ".join(found.err.split()) + " ".join(found.out.split())
    assert "repeats motions of the training logs" in (out / "report.html").read_text()


def test_samples_that_training_and_test_share_are_named_with_both_files(logs: list[str], tmp_path: Path) -> None:
    again = write_log(tmp_path / "again.csv", 1, lambda table: table[100:])
    out = tmp_path / "out"
    found = run("identify", "--robot", "two_link", "--train", *logs[:2], "--test", logs[2], again, "--out", out)
    assert found.code == 0, found.err
    (text,) = json.loads((out / "identification.json").read_text())["repeated_motions"]
    assert f"samples of the test log {again} are in the training log {logs[0]}" in text
    count, _, whole, *_ = text.split()
    assert count == whole, "the whole log"
    assert "are in the training log" in " ".join(found.err.split()) + " ".join(found.out.split())
    assert "are in the training log" in (out / "report.html").read_text()
    # The model knows which logs trained it.
    found = run("compare", out / "model.sgpr", logs[2], again, "--json", "--out", tmp_path / "compared")
    assert json.loads(found.out)["repeated_motions"] == [text]
    assert "are in the training log" in (tmp_path / "compared" / "report.html").read_text()
    for command in (("diagnose", "--look-for", "stribeck_friction"), ("learn", "--points", "100")):
        out = tmp_path / command[0]
        found = run(*command, "--robot", "two_link", "--train", *logs[:2], "--test", again, "--out", out)
        assert found.code == 0, found.err
        assert "are in the training log" in " ".join(found.err.split())
        assert "are in the training log" in (out / "report.html").read_text()


def test_without_test_logs_the_training_logs_are_shown_as_such(logs: list[str], tmp_path: Path) -> None:
    found = run("identify", "--robot", "two_link", "--train", *logs[:2], "--out", tmp_path)
    assert found.code == 0
    assert "training logs" in found.out
    assert not (tmp_path / "predictions.csv").exists()
    assert json.loads((tmp_path / "identification.json").read_text())["comparison"]["logs"] == "train"
    assert "the model was fitted to" in (tmp_path / "report.html").read_text()


def test_settings_reach_the_identification(logs: list[str], tmp_path: Path) -> None:
    options = (
        "--cutoff",
        8,
        "--order",
        2,
        "--decimation",
        3,
        "--torque-band",
        "full",
        "--method",
        "ols",
        "--no-report",
    )
    data = json.loads(identify(logs, tmp_path, *options).out)
    assert data["processing"]["cutoff_hz"] == 8.0
    assert data["processing"]["order"] == 2
    assert data["processing"]["decimation"] == 3
    assert data["processing"]["torque_cutoff_hz"] is None
    assert data["fit"]["method"] == "ols"
    assert data["settings"]["method"] == "ols"


def test_resampled_logs_are_predicted_at_their_own_samples(logs: list[str], tmp_path: Path) -> None:
    random = np.random.default_rng(5)

    def jittered(table: np.ndarray) -> np.ndarray:
        fine = table[:, 0] + random.uniform(-0.003, 0.003, len(table))
        return np.column_stack([fine, *(np.interp(fine, table[:, 0], column) for column in table[:, 1:].T)])

    path = write_log(tmp_path / "jittered.csv", 6, jittered)
    options = ("--resample", "100", "--out", tmp_path / "out", "--no-report")
    found = run("identify", "--robot", "two_link", "--train", *logs[:2], "--test", path, *options)
    assert found.code == 0
    assert "resample" in found.err
    rows = rows_of(tmp_path / "out")
    recording = sgpr.read(path)
    times = column(rows, "t")
    assert len(recording) - 3 <= len(rows) <= len(recording)
    assert (
        set(times) <= set(recording.time_ns * 1e-9)
        or np.isin(np.round(times, 9), np.round(recording.time_ns * 1e-9, 9)).all()
    )
    error = column(rows, "joint_1_measured") - column(rows, "joint_1_after")
    assert np.sqrt(np.mean(error[50:-50] ** 2)) < 0.15 * np.std(column(rows, "joint_1_measured"))


def test_the_report_proves_consistency_and_shows_the_screening(tmp_path: Path) -> None:
    base = ["identify", "--robot", DEMO_ROBOT, "--train", DEMO_TRAIN[0], "--consistent", "--prior-deviation", "10"]
    done = run(*base, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    data = json.loads((tmp_path / "out" / "identification.json").read_text())
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Links as bodies" in page
    for link in data["certificate"]["links"]:
        assert significant(link["smallest_eigenvalue"], 3) in page
    assert data["certificate"]["prior_deviation"] == 10.0
    assert "58 base parameters" in data["screening"][0]
    assert data["screening"][0] in page
    without = run(*base[:-3], "--out", tmp_path / "free")
    assert without.code == 0, without.err
    assert "Links as bodies" not in (tmp_path / "free" / "report.html").read_text()
    assert run(*base[:-1], "much", "--out", tmp_path / "none").code == 2


def test_consistent_arms_come_with_proof_and_robot_files(tmp_path: Path) -> None:
    limits = tmp_path / "limits.json"
    limits.write_text('{"total_mass": [1.0, 60.0], "joint_6": {"mass": [0.01, 2.0]}}')
    base = ["identify", "--robot", DEMO_ROBOT, "--train", DEMO_TRAIN[0], "--no-report"]
    done = run(*base, "--consistent", "--bounds", limits, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert "Links as bodies" in done.out
    names = {"model.sgpr", "identification.json", "robot.urdf", "robot.xml"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    data = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert all(link["smallest_eigenvalue"] > 0.0 for link in data["certificate"]["links"])
    assert "Links as bodies" in run("info", tmp_path / "out" / "model.sgpr").out
    robot = sgpr.Robot.from_urdf(tmp_path / "out" / "robot.urdf")
    assert 1.0 <= robot.standard_parameters[::10].sum() <= 60.0

    limits.write_text('{"total_mass": [0.0, 1.0], "joint_6": {"mass": [2.0, null]}}')
    done = run(*base, "--consistent", "--bounds", limits, "--out", tmp_path / "none")
    assert done.code == 1
    assert "at least 2 kg" in done.err
    assert "at most 1 kg" in done.err
    limits.write_text("no json")
    assert run(*base, "--consistent", "--bounds", limits, "--out", tmp_path / "none").code == 1
    for wrong in (["--prior", "entropic"], ["--consistent", "--essential"], ["--consistent", "--prior", "none"]):
        assert run(*base, *wrong, "--out", tmp_path / "none").code == 2


@pytest.mark.parametrize(
    "options",
    [["--method", "irls:2"], ["--method", "rls"], ["--essential"], ["--uncertainty", "hac"]],
)
def test_other_estimators_by_command(options: list[str], logs: list[str], tmp_path: Path) -> None:
    done = identify(logs, tmp_path / "out", *options, "--no-report")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["comparison"]["after"]["relative_error_percent"] < 2.0
    assert (data["essential"] is not None) == ("--essential" in options)


@pytest.mark.parametrize(
    "options",
    [["--method", "wls:2"], ["--method", "lasso"], ["--uncertainty", "hac:3"], ["--uncertainty", "bootstrap:1"]],
)
def test_other_estimators_that_are_not(options: list[str], logs: list[str], tmp_path: Path) -> None:
    assert identify(logs, tmp_path / "out", *options).code == 2


def test_instruments_and_controllers_by_command(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 1e-3)
    q = np.stack([0.6 * np.sin(1.1 * t) + 0.3 * np.sin(2.9 * t), 0.5 * np.sin(1.7 * t + 1) + 0.3 * np.sin(3.7 * t)], 1)
    dq = np.gradient(q, 1e-3, axis=0)
    robot = sgpr.robots.two_link()
    gains: dict[str, list[float]] = {"kp": [400.0, 300.0], "kd": [40.0, 30.0]}
    reference = (1000.0, q, dq, np.gradient(dq, 1e-3, axis=0))
    found = sgpr.simulate(robot, reference, controller="pd", record_period=5e-3, **gains)
    time = (found.t * 1e9).round().astype(np.int64)
    log, wanted = tmp_path / "log.mcap", tmp_path / "reference.mcap"
    names = robot.joint_names
    sgpr.Recording(time, found.q, None, found.tau, joint_names=names, source="log").save(log)
    sgpr.Recording(time, found.q_wanted, None, None, joint_names=names, source="reference").save(wanted)
    base = ["identify", "--robot", "two_link", "--train", log, "--effects", "none", "--cutoff", 20, "--no-report"]
    controller = ["--kp", 400, 300, "--kd", 40, 30]
    expected = robot.base_parameters().matrix @ robot.standard_parameters
    for options in (["--method", "iv"], ["--method", "iv", *controller], ["--method", "output_error", *controller]):
        done = run(*base, *options, "--instruments", wanted, "--out", tmp_path / "out", "--json")
        assert done.code == 0, done.err
        data = json.loads(done.out)
        assert data["fit"]["method"] == options[1]
        assert np.abs(np.array([p["value"] for p in data["parameters"]]) - expected).max() < 0.02
        # Without its instruments a method is no method, and they belong to no other.
        assert run(*base, *options, "--out", tmp_path / "none").code == 2
        assert run(*base, *options, "--instruments", wanted, "--method", "wls", "--out", tmp_path / "none").code == 2
    half = ["--method", "output_error", "--instruments", wanted, "--kp", 400, 300]
    assert run(*base, *half, "--out", tmp_path / "none").code == 2


def test_the_report_says_what_was_left_out_and_why(tmp_path: Path) -> None:
    base = ["identify", "--robot", DEMO_ROBOT, "--train", DEMO_TRAIN[0], "--essential"]
    done = run(*base, "--out", tmp_path)
    assert done.code == 0, done.err
    page = (tmp_path / "report.html").read_text()
    data = json.loads((tmp_path / "identification.json").read_text())
    dropped = data["essential"]["dropped"]
    assert dropped
    section = page.split("Parameters left out</h2>")[1].split("</section>")[0]
    for index, rise in zip(dropped, data["essential"]["rise"], strict=True):
        assert data["parameters"][index]["name"] in section
        assert significant(rise, 3) in section
    assert f", {len(dropped)} left out: the report and" in done.out
    assert run("info", tmp_path / "model.sgpr").out.count("left out") == len(dropped)
