"""`sgpr learn`, and what other commands make of its model."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run, write_log
from sgpr.report.rest import fewer_rows_were_better

SMALL = ("--points", 60, "--inputs", "own_velocity")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("logs")
    return [write_log(folder / f"log_{seed}.csv", seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def learned(logs: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rest of physics without friction."""
    out = tmp_path_factory.mktemp("learned")
    training = ("--robot", "two_link", "--train", *logs[:2], "--test", logs[2], "--effects", "none")
    found = run("learn", *training, *SMALL, "--out", out)
    assert found.code == 0, found.err
    assert "of the torque; the physics alone leaves" in found.out
    return out


def test_files(learned: Path) -> None:
    data = json.loads((learned / "learned.json").read_text())
    errors = {name: data["comparison"][name]["relative_error_percent"] for name in ("before", "after")}
    assert errors["after"] < 0.5 * errors["before"]
    assert [joint["inputs"] for joint in data["joints"]] == ["own_velocity"] * 2
    rows = list(csv.DictReader((learned / "predictions.csv").read_text().splitlines()))
    endings = ("measured", "before", "after", "std", "interval_95")
    assert list(rows[0]) == ["file", "t", *(f"joint_{k}_{ending}" for k in (1, 2) for ending in endings)]
    column = {name: np.array([float(row[f"joint_1_{name}"]) for row in rows]) for name in endings}
    within = np.abs(column["measured"] - column["after"]) <= column["interval_95"]
    assert within.mean() > 0.8
    assert np.all((column["std"] > 0) & (column["interval_95"] > column["std"]))
    assert np.std(column["measured"] - column["after"]) < 0.5 * np.std(column["measured"] - column["before"])


def test_report(learned: Path) -> None:
    report = (learned / "report.html").read_text()
    for title in ("What was learned", "How sure it is", "predicted interval of 95 %"):
        assert title in report
    assert '"interval":' in report
    assert '"type":"bar"' in report


def test_other_commands_take_the_model(learned: Path, logs: list[str], tmp_path: Path) -> None:
    model = learned / "model.sgpr"
    assert run("predict", model, logs[2], "--out", tmp_path / "torque.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "torque.csv").read_text().splitlines()))
    before = list(csv.DictReader((learned / "predictions.csv").read_text().splitlines()))
    assert [row["joint_2_predicted"] for row in rows] == [row["joint_2_after"] for row in before]
    assert [row["joint_2_std"] for row in rows] == [row["joint_2_std"] for row in before]
    assert run("predict", model, logs[2], "--out", tmp_path / "torque.mcap").code == 0
    assert "own_velocity" in run("info", model).out
    compared = json.loads(run("compare", model, logs[2], "--against", "two_link", "--json").out)
    data = json.loads((learned / "learned.json").read_text())
    assert compared["comparison"] == data["comparison"]["after"]


def test_on_top_of_a_model(logs: list[str], tmp_path: Path) -> None:
    physics = sgpr.identify(sgpr.robots.two_link(), [sgpr.read(log) for log in logs[:2]], effects=["viscous_friction"])
    physics.save(tmp_path / "physics.sgpr")
    arguments = ("learn", "--robot", tmp_path / "physics.sgpr", "--train", *logs[:2], "--out", tmp_path / "out")
    found = run(*arguments, "--test", logs[2], *SMALL, "--no-report", "--json")
    data = json.loads(found.out)
    assert data["history"][:-1] == physics.history
    assert "process of 2 of 2 joints" in data["history"][-1]
    assert not (tmp_path / "out" / "report.html").exists()
    assert run(*arguments, "--effects", "none").code == 2


def test_what_speaks_against_the_logs_is_said(logs: list[str], tmp_path: Path) -> None:
    def negated(table: np.ndarray) -> np.ndarray:
        table[:, -1] *= -1.0
        return table

    wrong = write_log(tmp_path / "negated.csv", 1, negated)
    arguments = ("learn", "--robot", "two_link", *SMALL, "--no-report", "--out", tmp_path / "out")
    found = run(*arguments, "--train", wrong)
    assert found.code == 0 and "look: the torque of joint_2 looks negated" in found.out + found.err
    data = json.loads((tmp_path / "out" / "learned.json").read_text())
    assert any("joint_2 looks negated" in message["text"] for message in data["messages"])
    found = run(*arguments, "--train", logs[0])
    assert found.code == 0 and "look: the torque" not in found.out + found.err


def test_it_is_said_where_fewer_rows_were_better_than_all() -> None:
    def said(subset: float, sparse: float, chosen: str) -> str | None:
        tried = [{"inputs": "all", "inference": "subset", "rmse": subset}]
        tried += [{"inputs": "all", "inference": "sparse", "rmse": sparse}]
        # Another selection of inputs says nothing of the one that was chosen.
        tried += [{"inputs": "positions", "inference": "subset", "rmse": 0.1}]
        return fewer_rows_were_better({"joint": "elbow", "inputs": "all", "inference": chosen, "candidates": tried})

    text = said(0.4, 0.5, "sparse")
    assert text is not None and text.startswith("elbow") and "error 0.400, not 0.500" in text
    assert said(0.5, 0.4, "sparse") is None
    assert said(0.4, 0.5, "subset") is None


def test_wrong_use(logs: list[str], tmp_path: Path) -> None:
    training = ("learn", "--robot", "two_link", "--train", logs[0], "--out", tmp_path)
    assert "cannot test it" in run(*training, "--test", logs[0]).err
    assert "matern32" in run(*training, "--kernel", "matern23").err
    assert "positions_and_velocities" in run(*training, "--inputs", "everything").err
    assert run(*training, "--points", 1).code == 2


def test_stopping_keeps_what_there_is(logs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = sgpr.SemiParametricModel.fit

    def stopped(model: sgpr.SemiParametricModel, recordings: list[sgpr.Recording]) -> sgpr.SemiParametricModel:
        def stop(stage: str, done: int, total: int) -> None:
            if stage == "processes":
                raise KeyboardInterrupt

        model.progress = stop
        return original(model, recordings)

    monkeypatch.setattr(sgpr.SemiParametricModel, "fit", stopped)
    found = run("learn", "--robot", "two_link", "--train", *logs[:2], "--out", tmp_path, "--no-report", "--json")
    assert found.code == 0
    assert "stopped" in found.err
    assert json.loads(found.out)["stopped"] is True
    assert isinstance(sgpr.load(tmp_path / "model.sgpr"), sgpr.SemiParametricModel)
