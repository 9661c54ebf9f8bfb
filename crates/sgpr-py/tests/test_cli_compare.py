"""`sgpr compare` and its limits."""

import json
from pathlib import Path

import pytest
import sgpr
from cli_support import run, write_log


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("model")
    train = [sgpr.read(write_log(folder / f"train_{seed}.csv", seed)) for seed in (1, 2)]
    identified = sgpr.identify(sgpr.robots.two_link(), train, effects=["viscous_friction", "coulomb_friction"])
    identified.save(folder / "model.sgpr")
    return str(folder / "model.sgpr")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_log(tmp_path_factory.mktemp("log") / "test.csv", 3)


def test_figures_are_those_of_the_library(model: str, log: str) -> None:
    data = json.loads(run("compare", model, log, "--json").out)
    expected = sgpr.compare(sgpr.load(model), [sgpr.read(log)])
    joints = data["comparison"]["joints"]
    assert [joint["rmse"] for joint in joints] == pytest.approx(list(expected.rmse))
    assert [joint["rmse_gravity"] for joint in joints] == [joint.rmse_gravity for joint in expected.joints]
    assert data["verdict"] is None


def test_a_robot_is_compared_too(log: str) -> None:
    found = run("compare", "two_link", log)
    assert found.code == 0
    for text in ("RMSE", "gravity only", "fit %", "largest", "joint_2"):
        assert text in found.out


def test_limits(model: str, log: str) -> None:
    found = run("compare", model, log, "--limit", "fit_percent=80", "joint_2:rmse=1e-6", "--json")
    data = json.loads(found.out)
    assert found.code == 0
    assert [entry["verdict"] for entry in data["limits"]] == ["pass", "pass", "fail"]
    assert data["verdict"] == "fail"
    assert run("compare", model, log, "--limit", "joint_2:rmse=1e-6", "--strict").code == 1
    assert run("compare", model, log, "--limit", "r2=0.5", "--strict").code == 0


def test_limits_from_a_file(model: str, log: str, tmp_path: Path) -> None:
    path = tmp_path / "limits.json"
    path.write_text('{"fit_percent": 80, "joint_1": {"rmse": 100}}')
    data = json.loads(run("compare", model, log, "--limits", path, "--json").out)
    assert data["verdict"] == "pass"
    assert len(data["limits"]) == 3
    path.write_text('{"fit": 80}')
    found = run("compare", model, log, "--limits", path)
    assert found.code == 1
    assert "fit_percent" in found.err


@pytest.mark.parametrize("limit", ["rmse", "rmse=x", "rmsee=1", "joint_9:rmse=1", "rmse=nan"])
def test_wrong_limits_are_wrong_use(model: str, log: str, limit: str) -> None:
    found = run("compare", model, log, "--limit", limit)
    assert found.code == 2
    assert "--limit" in found.err


def test_against_another_model_with_a_report(model: str, log: str, tmp_path: Path) -> None:
    found = run("compare", model, log, "--against", "two_link", "--limit", "r2=0.5", "--out", tmp_path, "--json")
    data = json.loads(found.out)
    assert data == json.loads((tmp_path / "comparison.json").read_text())
    ours, other = data["comparison"], data["comparison_against"]
    assert ours["relative_error_percent"] < other["relative_error_percent"]
    page = (tmp_path / "report.html").read_text()
    for text in ("joint_1", "joint_2", "two_link", "All 2 limits met"):
        assert text in page
