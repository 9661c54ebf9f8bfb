"""The experiments of the thesis in their short version."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import run
from sgpr_thesis import published
from sgpr_thesis.experiments import Arm, Settings, puma560, two_link


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


def by_model(tracking: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Errors of the joints by motion and model."""
    errors: dict[str, dict[str, Any]] = {}
    for each in tracking:
        errors.setdefault(each["motion"], {})[each["model"]] = np.array(each["rmse"])
    return errors


@pytest.mark.parametrize("robot", ["puma560", "two_link"])
def test_case_1_orders_as_claimed(data: dict[str, Any], robot: str) -> None:
    for motion, each in by_model(data["case_1"][robot]["tracking"]).items():
        assert each["identified"].sum() < each["internal"].sum(), motion
        assert each["semi-parametric"].sum() < each["internal"].sum(), motion
        assert each["semi-parametric"].sum() < each["non-parametric"].sum(), motion
        assert each["identified, all effects"].sum() < each["internal"].sum(), motion


def test_a_process_takes_what_the_parameters_lack(data: dict[str, Any]) -> None:
    # The rotors: on the PUMA 560 at every joint, on motions that neither has seen, too.
    for motion, each in by_model(data["case_1"]["puma560"]["tracking"]).items():
        worse = each["semi-parametric"] - each["identified"]
        assert worse.max() < 1e-3, (motion, worse)
        # Where nothing is lacking it stays out: a tenth of a milliradian is ten steps of the encoder.
        worse = each["semi-parametric, all effects"] - each["identified, all effects"]
        assert worse.max() < 1e-4, (motion, worse)
    for motion, each in by_model(data["case_1"]["two_link"]["tracking"]).items():
        assert each["semi-parametric"].sum() < each["identified"].sum(), motion


def test_every_training_set_gives_a_good_model(data: dict[str, Any]) -> None:
    # Joint 1 sticks or breaks away by chance: no gravity, much friction, weak feedback.
    for row in data["table_5_8"]:
        errors = np.array(row["errors"]["identified, all effects"])
        assert errors[1:].sum() < 0.1 < sum(row["published"][1:]), row["motion"]


def test_more_data_never_hurts(data: dict[str, Any]) -> None:
    rows = {row["motion"]: row["errors"] for row in data["table_5_8"]}
    for motion, errors in rows.items():
        for model in ("identified, all effects", "semi-parametric, all effects"):
            if motion.startswith("HFS + "):
                before, after = sum(rows[motion.removeprefix("HFS + ")][model]), sum(errors[model])
                assert after < 1.1 * before, (motion, model, before, after)


def test_case_2_recovers_the_error_of_the_internal_model(data: dict[str, Any]) -> None:
    case = data["case_2"]
    assert np.allclose(case["true_error"], [1, -1, 1, 1])
    assert case["largest_deviation"] < 0.02
    assert data["case_2_puma"]["deviation"] < 0.02
    for tracking in (case["tracking"], data["case_2_puma"]["tracking"]):
        for motion, each in by_model(tracking).items():
            assert each["identified, all effects"].sum() < 0.5 * each["internal"].sum(), motion
            assert each["semi-parametric"].sum() < each["internal"].sum(), motion


def test_processes_beside_the_parameters_gain(data: dict[str, Any]) -> None:
    for row in data["table_5_8"]:
        errors = {label: np.array(each) for label, each in row["errors_of_tests"].items()}
        assert (errors["semi-parametric, all effects"] <= errors["identified, all effects"] + 1e-4).all(), row["motion"]
        assert errors["semi-parametric"].sum() < errors["identified"].sum(), row["motion"]
        if not row["motion"].startswith("HFS"):
            # 1 of 72 joints of test motions loses.
            assert (errors["semi-parametric"] > errors["identified"] + 1e-4).sum() <= 1, row["motion"]
            assert errors["semi-parametric"].sum() < 0.5 * errors["identified"].sum(), row["motion"]


@pytest.mark.parametrize("arm", [puma560(), two_link()], ids=lambda arm: arm.name)
def test_the_needed_torque_is_that_of_the_simulated_machine(arm: Arm) -> None:
    settings = Settings.short()
    motion = arm.test_motions(settings)[0]
    wanted = arm.wanted(motion, settings.test_seconds)
    lacking = arm.needed_torque(*wanted) - arm.robot.inverse_dynamics(*wanted)
    run = arm.follow(motion, published.TEST_GAINS, [arm.robot], settings.test_seconds, feed_forward=lacking)
    # What is left is the time between two calls of the controller.
    assert run.tracking_rmse.max() < 5e-4


def test_torque_errors_order_as_claimed(data: dict[str, Any]) -> None:
    for row in data["table_5_8"]:
        errors = {label: np.array(each) for label, each in row["torque_errors_of_tests"].items()}
        assert errors["semi-parametric"].shape == (3, 6)
        # 1e-3 N·m turn a joint by a tenth of a milliradian at test gains.
        for more in ("", ", all effects"):
            worse = errors[f"semi-parametric{more}"] - errors[f"identified{more}"]
            assert worse.max() < 1e-3, (row["motion"], more)


def test_other_control_laws_gain_too(data: dict[str, Any]) -> None:
    for robot in ("puma560", "two_link"):
        # Computed torque multiplies the feedback by the model's inertia: without that of rotors it holds no wrist.
        shares = {row["model"]: np.array(row["share"]) for row in data["inertias"] if row["robot"] == robot}
        known = shares["identified"] > 0.1
        assert known.sum() >= min(4, len(known))
        for law in ("computed torque", "joint impedance"):
            rows = [row for row in data["control_laws"] if (row["robot"], row["law"]) == (robot, law)]
            errors = {row["model"]: np.array(row["rmse"]) for row in rows}
            held = known | (law == "joint impedance")
            assert errors["identified"][held].sum() < errors["internal"][held].sum(), (robot, law)
            assert errors["semi-parametric"].sum() < errors["internal"].sum(), (robot, law)
            if law == "joint impedance":
                assert errors["semi-parametric"].sum() < 0.2 * errors["internal"].sum(), robot


def test_a_payload_is_compensated_within_a_second(data: dict[str, Any]) -> None:
    for gains in ([75.0, 5.0], [300.0, 30.0]):
        rows = {row["model"]: row for row in data["payload"]["rows"] if row["gains"] == gains}
        plain, tracked = rows["identified model"], rows["payload tracked"]
        assert plain["after"] > 3.0 * plain["before"] and plain["recovered"] is None
        assert tracked["after"] < 0.2 * plain["after"]
        assert abs(tracked["mass"] - data["payload"]["mass"]) < 0.2
        assert tracked["recovered"] < 1.0


def test_page_and_tables(out: Path) -> None:
    page = (out / "report.html").read_text()
    for figure in ("5-2", "5-3", "5-4", "5-5", "5-10", "5-11", "5-12", "5-13", "5-14", "5-15", "5-16", "5-18", "5-19"):
        assert f"Figure {figure}" in page, figure
    text = (out / "thesis.md").read_text()
    assert text.count("| cond(W_fe) |") >= 3 and "Largest deviation" in text


def test_bars_have_lengths_and_numbers_at_their_axis(out: Path) -> None:
    found = re.search(r'id="payload">(.*?)</script>', (out / "report.html").read_text(), re.DOTALL)
    assert found is not None
    figures = json.loads(found[1])["figures"].values()
    bars = [figure for figure in figures if figure["data"][0]["type"] == "bar"]
    assert len(bars) >= 13
    for figure in bars:
        low, high = figure["layout"]["yaxis"]["range"]
        sizes = np.log10([size for group in figure["data"] for size in group["y"]])
        assert low <= sizes.min() and sizes.max() <= high and high >= low + 1


def test_wrong_use(tmp_path: Path) -> None:
    found = run("reproduce", "book", "--out", tmp_path / "out")
    assert found.code == 2 and "thesis" in found.err and not (tmp_path / "out").exists()


def test_without_its_package_the_command_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sgpr_thesis", None)
    found = run("reproduce", "thesis", "--out", tmp_path / "out")
    assert found.code == 1 and not (tmp_path / "out").exists()
    assert "pip install examples/thesis" in " ".join(found.err.split())
