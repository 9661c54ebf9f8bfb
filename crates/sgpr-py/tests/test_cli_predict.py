"""`sgpr predict`."""

import csv
import gzip
import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run, write_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_log(tmp_path_factory.mktemp("log") / "log.csv", 3)


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_table(log: str, tmp_path: Path) -> None:
    out = tmp_path / "torque.csv"
    data = json.loads(run("predict", "two_link", log, "--out", out, "--json").out)
    rows = rows_of(out)
    assert len(rows) == data["samples"] == len(sgpr.read(log))
    assert list(rows[0]) == ["t", *(f"joint_{k}_{which}" for k in (1, 2) for which in ("measured", "predicted"))]
    assert run("predict", "two_link", log, "--out", tmp_path / "torque.csv.gz").code == 0
    assert gzip.decompress((tmp_path / "torque.csv.gz").read_bytes()).decode() == out.read_text()


def test_topics(log: str, tmp_path: Path) -> None:
    out = tmp_path / "torque.mcap"
    assert run("predict", "two_link", log, "--out", out).code == 0
    tau = {name: sgpr.read(out, topics=[f"/{name}"]).tau for name in ("measured", "predicted", "residual")}
    np.testing.assert_allclose(tau["measured"] - tau["predicted"], tau["residual"], atol=1e-12)


def test_a_log_without_torque(log: str, tmp_path: Path) -> None:
    table = np.loadtxt(log, delimiter=",", skiprows=1)[:, :3]
    path = tmp_path / "positions.csv"
    np.savetxt(path, table, delimiter=",", header="t,q_1,q_2", comments="", fmt="%.12g")
    out = tmp_path / "torque.csv"
    assert run("predict", "two_link", path, "--out", out).code == 0
    rows = rows_of(out)
    assert list(rows[0]) == ["t", "joint_1_predicted", "joint_2_predicted"]
    assert run("predict", "two_link", log, "--out", tmp_path / "with.csv").code == 0
    with_torque = rows_of(tmp_path / "with.csv")
    assert [row["joint_1_predicted"] for row in rows] == [row["joint_1_predicted"] for row in with_torque]


def test_bands_of_an_identified_model(log: str, tmp_path: Path) -> None:
    robot, recording = sgpr.robots.two_link(), sgpr.read(log)
    model = sgpr.identify(robot, [recording], effects=["viscous_friction", "coulomb_friction"])
    model.save(tmp_path / "model.sgpr")
    out = tmp_path / "torque.csv"
    assert run("predict", tmp_path / "model.sgpr", log, "--out", out).code == 0
    rows = rows_of(out)
    endings = ("measured", "predicted", "std", "std_with_noise")
    assert list(rows[0]) == ["t", *(f"joint_{k}_{which}" for k in (1, 2) for which in endings)]
    assert model.fit is not None
    [piece] = sgpr.compare(model, [recording]).logs
    _, expected = model.predict(piece.q, piece.dq, piece.ddq, return_std=True)
    for joint in (1, 2):
        plain = np.array([float(row[f"joint_{joint}_std"]) for row in rows])
        noisy = np.array([float(row[f"joint_{joint}_std_with_noise"]) for row in rows])
        np.testing.assert_allclose(plain, expected[:, joint - 1], rtol=1e-8)
        np.testing.assert_allclose(noisy**2 - plain**2, model.fit["noise"][joint - 1] ** 2, rtol=1e-6)
    # Topics hold torques only.
    assert run("predict", tmp_path / "model.sgpr", log, "--out", tmp_path / "torque.mcap").code == 0


def test_unknown_format_is_wrong_use(log: str, tmp_path: Path) -> None:
    found = run("predict", "two_link", log, "--out", tmp_path / "torque.xlsx")
    assert found.code == 2
    assert ".csv.gz" in found.err
