"""The experiments of the thesis in their short version."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import run


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("thesis")
    found = run("reproduce", "thesis", "--short", "--out", out, "--quiet")
    assert (found.code, found.out, found.err) == (0, "", "")
    return out


@pytest.fixture(scope="module")
def data(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "thesis.json").read_text())
    return found


def test_the_printed_amplitudes_are_beaten(data: dict[str, Any]) -> None:
    for found in data["excitation"].values():
        assert len(found["rows"]) == 8
        for row in found["rows"]:
            assert row["found"] < row["published"] and row["utilisation"] <= 1.0, row


def test_case_1_orders_as_claimed(data: dict[str, Any]) -> None:
    for name, found in data["case_1"].items():
        errors: dict[str, dict[str, float]] = {}
        for each in found["tracking"]:
            errors.setdefault(each["motion"], {})[each["model"]] = sum(each["rmse"])
        for motion, each in errors.items():
            assert each["identified"] < each["internal"], (name, motion)
            assert each["identified, all effects"] < each["internal"], (name, motion)


def test_every_training_set_gives_a_good_model(data: dict[str, Any]) -> None:
    # Joint 1 sticks or breaks away by chance: no gravity, much friction, weak feedback.
    for row in data["table_5_8"]:
        assert sum(row["all_effects"][1:]) < 0.2 < sum(row["published"][1:]), row["motion"]


def test_case_2_recovers_the_error_of_the_internal_model(data: dict[str, Any]) -> None:
    case = data["case_2"]
    assert np.allclose(case["true_error"], [1, -1, 1, 1])
    assert case["largest_deviation"] < 0.02
    errors = {(run["motion"], run["model"]): np.array(run["rmse"]) for run in case["tracking"]}
    for motion in ("train", "test"):
        assert (errors[motion, "compensated"] < errors[motion, "internal"]).all()


def test_page_and_tables(out: Path) -> None:
    page = (out / "report.html").read_text()
    for figure in ("5-2", "5-3", "5-4", "5-5", "5-12", "5-13", "5-14", "5-15", "5-16", "5-18", "5-19"):
        assert f"Figure {figure}" in page, figure
    text = (out / "thesis.md").read_text()
    assert text.count("| cond(W_fe) |") >= 3 and "Largest deviation" in text


def test_wrong_use(tmp_path: Path) -> None:
    found = run("reproduce", "book", "--out", tmp_path / "out")
    assert found.code == 2 and "thesis" in found.err and not (tmp_path / "out").exists()
