"""`sgpr excite` and `sgpr simulate`."""

import json
import re
from pathlib import Path
from typing import Any

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


def drawn(page: Path, place: str) -> dict[str, Any]:
    """A figure of a report."""
    found = re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page.read_text(), re.DOTALL)
    assert found is not None
    figure: dict[str, Any] = json.loads(found[1])["figures"][place]
    return figure


@pytest.mark.parametrize(
    ("robot", "criterion"),
    [("two_link", "condition"), ("two_link", "static_conditions"), ("puma560", "sum_of_conditions")],
)
def test_the_search_is_drawn_with_numbers_at_its_axis(robot: str, criterion: str, tmp_path: Path) -> None:
    options = ("--max-acceleration", 2, "--criterion", criterion, "--starts", 2, "--evaluations", 60, "--quiet")
    found = run("excite", "--robot", robot, "--out", tmp_path / "out", *options)
    assert (found.code, found.err) == (0, "")
    figure = drawn(tmp_path / "out" / "report.html", "search-plot")
    values = [y for line in figure["data"] for y in line["y"] if y is not None]
    low, high = min(values), max(values)
    settings = figure["layout"]["yaxis"]
    if settings.get("type") == "log":
        ticks = settings.get("tickvals", [10.0**k for k in range(-3, 20)])
        assert sum(low <= tick <= high for tick in ticks) >= 2, (low, high, settings)
    else:
        assert low <= 0.0 or high < 10.0 * low, "a decade or more"


def test_excite_keeps_out_of_a_box_and_takes_a_series(tmp_path: Path) -> None:
    common = ("excite", "--robot", "puma560", "--max-acceleration", 6, "--starts", 1, "--evaluations", 60, "--json")
    series = ("--harmonics", 4, 12, "--criterion", "d_optimality", "--torque-noise", 2, 2, 1, 0.5, 0.5, 0.5)
    free = run(*common, *series, "--out", tmp_path / "free")
    # A box beside the farthest that the tool goes.
    reach = tool(tmp_path / "free")[:, 0].max()
    box = [reach - 0.02, -1.0, -1.0, reach + 1.0, 1.0, 1.0]
    found = run(*common, *series, "--box", *box, "--clearance", 0.01, "--link-radius", 0.0, "--out", tmp_path / "out")
    assert (free.code, free.err, found.code, found.err) == (0, "", 0, "")
    data = json.loads(found.out)
    assert data["settings"]["harmonics"] == [4, 12] and data["settings"]["boxes"] == [[box[:3], box[3:]]]
    assert tool(tmp_path / "out")[:, 0].max() <= reach - 0.03 + 1e-9
    # Harmonics 1 to 3 are not in it.
    shares = np.abs(np.fft.rfft(sgpr.read(tmp_path / "out" / "trajectory.csv").dq[:-1, 0]))
    assert shares[:4].max() < 1e-9 * shares.max() < shares[4:13].min()


def tool(out: Path) -> Any:
    """Places of the tool along a motion, (N, 3), m."""
    return sgpr.robots.puma560().forward_kinematics(sgpr.read(out / "trajectory.csv").q)[:, :3, 3]


def test_excite_checks_torques_with_a_model(tmp_path: Path) -> None:
    robot = sgpr.robots.two_link().with_gravity([0.0, 0.0, -9.81])
    friction = ["viscous_friction", "coulomb_friction"]
    model = sgpr.Model.from_parameters(robot, [*robot.standard_parameters, 1.0, 0.5, 4.0, 2.0], friction)
    model.save(tmp_path / "model.sgpr")
    common = ("excite", "--robot", "two_link", "--gravity", 0, 0, -9.81, "--max-acceleration", 2, *QUICK, "--json")
    limits = ("--max-torque", 9, 5)
    found = run(*common, *limits, "--model", tmp_path / "model.sgpr", "--out", tmp_path / "out")
    assert (found.code, found.err) == (0, "")
    log = sgpr.read(tmp_path / "out" / "trajectory.csv")
    ddq = np.column_stack([log.channels[f"{name}_acceleration"] for name in log.joint_names])
    assert (np.abs(model.predict(log.q, log.dq, ddq)) <= np.array([9, 5]) + 1e-6).all()
    assert np.array_equal(json.loads(found.out)["settings"]["effects"], model.effects)


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
    told = run("simulate", "two_link", motion, "--out", tmp_path / "told.csv").out.splitlines()[-1]
    assert told == f"next: sgpr identify --robot two_link --train {tmp_path / 'told.csv'} --out result"
    again = run("simulate", "two_link", motion, "--out", tmp_path / "again.csv", "--torque-noise", 0.1, "--quiet")
    assert (again.code, again.out, again.err) == (0, "", "")
    assert np.array_equal(sgpr.read(tmp_path / "again.csv").tau, recording.tau)


WRONG_USE = {
    "count": (["excite", "--robot", "two_link", "--max-acceleration", "1", "2", "3", "--out", "OUT"], "3 numbers"),
    "box": (
        ["excite", "--robot", "two_link", "--max-acceleration", "1", "--out", "OUT", "--box", "1", "2"],
        "a box has six",
    ),
    "harmonics": (
        ["excite", "--robot", "two_link", "--max-acceleration", "1", "--out", "OUT", "--harmonics", "3"],
        "the first and the last harmonic",
    ),
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
