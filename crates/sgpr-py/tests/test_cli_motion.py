"""`sgpr excite` and `sgpr simulate`."""

import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run

QUICK = ("--terms", 3, "--starts", 1, "--evaluations", 100)


@pytest.fixture(scope="module")
def excited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("excite")
    found = run("excite", "--robot", "two_link", "--max-acceleration", 2, "--out", out, *QUICK, "--json")
    assert (found.code, found.err) == (0, "")
    data = json.loads(found.out)
    assert data["report"]["rank"] == 10 and data["utilisation"] <= 1.0
    assert data == json.loads((out / "excitation.json").read_text())
    return out


def test_excite_writes_all_files(excited: Path) -> None:
    names = {path.name for path in excited.iterdir()}
    assert names == {"trajectory.csv", "trajectory.mcap", "excitation.json", "report.html"}
    page = (excited / "report.html").read_text()
    assert "motion-plot" not in page and "position-plot" in page and "search-plot" in page


def test_simulate_follows_a_motion(excited: Path, tmp_path: Path) -> None:
    motion, log = excited / "trajectory.csv", tmp_path / "log.csv"
    found = run(
        "simulate", "two_link", motion, "--out", log, "--torque-noise", 0.1, "--report", tmp_path / "run.html", "--json"
    )
    assert (found.code, found.err) == (0, "")
    data = json.loads(found.out)
    recording = sgpr.read(log)
    assert len(recording) == data["samples"] and recording.tau is not None
    assert max(data["tracking_rmse"]) < 1.0
    page = (tmp_path / "run.html").read_text()
    assert "Position minus wanted position" in page and "joint_2" in page
    again = run("simulate", "two_link", motion, "--out", tmp_path / "again.csv", "--torque-noise", 0.1, "--quiet")
    assert (again.code, again.out, again.err) == (0, "", "")
    assert np.array_equal(sgpr.read(tmp_path / "again.csv").tau, recording.tau)


WRONG_USE = {
    "count": (["excite", "--robot", "two_link", "--max-acceleration", "1", "2", "3", "--out", "OUT"], "3 numbers"),
    "criterion": (
        ["excite", "--robot", "two_link", "--max-acceleration", "1", "--out", "OUT", "--criterion", "condtion"],
        "did you mean condition",
    ),
    "suffix": (["simulate", "two_link", "MOTION", "--out", "log.txt"], "must end in"),
    "report": (["simulate", "two_link", "MOTION", "--out", "log.csv", "--report", "a.pdf"], "must end in .html"),
    "controller": (["simulate", "two_link", "MOTION", "--out", "log.csv", "--controller", "pid"], "feed_forward"),
}


@pytest.mark.parametrize("case", WRONG_USE)
def test_wrong_use(case: str, excited: Path, tmp_path: Path) -> None:
    arguments, expected = WRONG_USE[case]
    places = {"MOTION": excited / "trajectory.csv", "OUT": tmp_path / "out"}
    found = run(*(places.get(word, word) for word in arguments))
    assert found.code == 2 and found.out == ""
    assert expected in " ".join(found.err.replace("│", " ").split())


def test_bad_data(excited: Path, tmp_path: Path) -> None:
    common = ("--robot", "two_link", "--max-acceleration", 2, "--out", tmp_path)
    found = run("excite", *common, "--max-torque", 5, *QUICK)
    assert found.code == 1 and found.err.count("\n") == 1
    assert "torque of joint `joint_1` against gravity" in found.err
    found = run(
        "simulate", "two_link", excited / "trajectory.csv", "--out", tmp_path / "log.csv", "--kp", 1e7, "--kd", 1e6
    )
    assert found.code == 1 and "ran away" in found.err and found.err.count("\n") == 1
    assert "raise `--speed-limit`" in " ".join(found.err.split())
    assert list(tmp_path.iterdir()) == []
