"""Which effect is missing: the function, what it returns, and `sgpr diagnose`."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from cli_support import COULOMB, run, write_log

HIDDEN = 4.0  # N·m/rad at the first joint
NOISE = 0.05  # N·m
RATE = 100.0


def spring_log(number: int, seconds: float = 20.0) -> sgpr.Recording:
    """A log of the two-link arm with friction and a spring that the model does not know."""
    robot = sgpr.robots.two_link()
    rng = np.random.default_rng(number)
    t = np.arange(round(seconds * RATE)) / RATE
    phase = np.arange(2) + 2.0 * number
    waves = [(0.7, 0.9), (0.4, 2.3), (0.2, 4.1)]
    turned = [(size, pulse * (1 + 0.13 * phase)) for size, pulse in waves]
    q = sum(a * np.sin(np.outer(t, w) + phase) for a, w in turned)
    dq = sum(a * w * np.cos(np.outer(t, w) + phase) for a, w in turned)
    ddq = sum(-a * w * w * np.sin(np.outer(t, w) + phase) for a, w in turned)
    tau = robot.inverse_dynamics(q, dq, ddq) + 0.8 * dq + 0.5 * np.sign(dq) + rng.normal(0, NOISE, q.shape)
    tau[:, 0] += HIDDEN * q[:, 0]
    time_ns = np.round((t + seconds * number) * 1e9).astype(np.int64)
    noisy = q + rng.normal(0, 1e-6, q.shape)
    return sgpr.Recording(time_ns, noisy, None, tau, joint_names=robot.joint_names, source=f"log {number}")


@pytest.fixture(scope="module")
def logs() -> list[sgpr.Recording]:
    return [spring_log(number) for number in range(3)]


@pytest.fixture(scope="module")
def model(logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(sgpr.robots.two_link(), logs[:2], effects=["viscous_friction", "coulomb_friction"])


@pytest.fixture(scope="module")
def diagnosis(model: sgpr.Model, logs: list[sgpr.Recording]) -> sgpr.Diagnosis:
    return sgpr.diagnose(model, train=logs[:2], test=logs[2:])


def test_the_spring_is_found(diagnosis: sgpr.Diagnosis) -> None:
    assert diagnosis.verdict == "effects_found"
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joints) == ("cable_stiffness", ["joint_1"])
    value, deviation, unit = finding.parameters["joint_1.k"]
    assert value == pytest.approx(HIDDEN, rel=0.02)
    assert deviation is not None and 0 < deviation < 0.1
    assert unit == "N·m/rad"
    assert 0.8 < finding.probability <= 1.0
    assert finding.rmse_after["joint_1"] < 0.5 * finding.rmse_before["joint_1"]
    assert finding.rmse_after["joint_1"] < 1.5 * NOISE
    assert diagnosis.probability_nothing_missing < 0.1


def test_an_own_ripple_is_found_over_a_wide_range_and_is_unexplained_without_it() -> None:
    def ripple(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, n: float) -> np.ndarray:
        return np.column_stack([np.sin(n * q[:, joint]), np.cos(n * q[:, joint])])

    def rippled(log: sgpr.Recording) -> sgpr.Recording:
        tau = np.array(log.tau)
        tau[:, 0] += 0.8 * np.sin(18.0 * log.q[:, 0]) - HIDDEN * log.q[:, 0]
        return sgpr.Recording(log.time_ns, log.q, None, tau, joint_names=log.joint_names, source=log.source)

    logs = [rippled(spring_log(number)) for number in range(2)]
    model = sgpr.identify(sgpr.robots.two_link(), logs, effects=["viscous_friction", "coulomb_friction"])
    effect = sgpr.Effect("my_ripple", ripple, ["a", "b"], constants={"n": (2, 60, "1/rad")})
    diagnosis = sgpr.diagnose(model, logs, effects=[effect])
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joints) == ("my_ripple", ["joint_1"])
    assert finding.parameters["joint_1.n"][0] == pytest.approx(18.0, rel=0.01)
    without = sgpr.diagnose(model, logs, effects=["stribeck_friction"])
    assert without.verdict == "unexplained_structure"
    assert "joint_1: torque that depends on position" in " ".join(without.unexplained)


def coarse_logs(seconds: float) -> list[sgpr.Recording]:
    """Encoders of 0.3 mrad at the first joint: what that makes of its acceleration is as large as NOISE above 3 Hz."""

    def coarse(log: sgpr.Recording) -> sgpr.Recording:
        q = np.array(log.q)
        q[:, 0] = 3e-4 * np.round(q[:, 0] / 3e-4)
        return sgpr.Recording(log.time_ns, q, None, log.tau, joint_names=log.joint_names, source=log.source)

    return [coarse(spring_log(number, seconds)) for number in range(2)]


def diagnosed(logs: list[sgpr.Recording]) -> tuple[sgpr.Model, sgpr.Diagnosis]:
    model = sgpr.identify(sgpr.robots.two_link(), logs, effects=["viscous_friction", "coulomb_friction"])
    return model, sgpr.diagnose(model, logs)


def test_nothing_is_found_in_the_noise_of_encoders() -> None:
    _, diagnosis = diagnosed(coarse_logs(8.0))
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joints) == ("cable_stiffness", ["joint_1"])
    value, deviation, _ = finding.parameters["joint_1.k"]
    assert deviation is not None and abs(value - HIDDEN) < 3 * deviation


def test_what_follows_the_acceleration_is_not_looked_for_in_the_noise_of_encoders(diagnosis: sgpr.Diagnosis) -> None:
    driven = ("link_flexibility", "transmission_hysteresis")
    assert not any(effect in diagnosis.not_testable for effect in driven)
    # 5 s are too short for a band below that noise.
    logs = coarse_logs(2.5)
    model, coarse = diagnosed(logs)
    testable = {(size["effect"], *size["joints"]) for size in coarse.detectable}
    for effect in driven:
        assert "not at joint_1: noise of the position" in coarse.not_testable[effect]
        assert (effect, "joint_1") not in testable and (effect, "joint_2") in testable
    # Who asks for it by hand gets it.
    assert model.add("link_flexibility@joint_1", logs).terms


def test_a_gap_is_no_time_that_a_band_can_be_chosen_for() -> None:
    def gapped(log: sgpr.Recording) -> sgpr.Recording:
        there = np.r_[0:150, 250:400]
        time_ns, q, tau = log.time_ns[there], log.q[there], np.array(log.tau)[there]
        return sgpr.Recording(time_ns, q, None, tau, joint_names=log.joint_names, source=log.source)

    # Eight seconds would be long enough for a band below the noise, the six of them that are there are not.
    _, diagnosis = diagnosed([gapped(log) for log in coarse_logs(4.0)])
    assert "not at joint_1: noise of the position" in diagnosis.not_testable["link_flexibility"]


@pytest.mark.parametrize(("order", "repeats"), [(4.0, False), (9.0, True)])
def test_a_ripple_repeats(order: float, repeats: bool) -> None:
    """Of 4 per turn the first joint, which moves by 2.5 rad, shows 1.6 periods, of 9 per turn 3.6."""

    def rippled(log: sgpr.Recording) -> sgpr.Recording:
        tau = np.array(log.tau)
        tau[:, 0] += np.sin(order * log.q[:, 0] + 0.5) - HIDDEN * log.q[:, 0]
        return sgpr.Recording(log.time_ns, log.q, None, tau, joint_names=log.joint_names, source=log.source)

    _, diagnosis = diagnosed([rippled(spring_log(number)) for number in range(2)])
    assert diagnosis.verdict != "nothing_missing"
    ripples = {finding.effect for finding in diagnosis.findings} & {"torque_ripple", "kinematic_error"}
    assert ripples == ({"torque_ripple"} if repeats else set())


def test_what_was_found_can_be_added(
    model: sgpr.Model, diagnosis: sgpr.Diagnosis, logs: list[sgpr.Recording], tmp_path: Path
) -> None:
    better = model.add(diagnosis.findings[0])
    assert "viscous_friction, coulomb_friction, cable_stiffness at joint_1" in repr(better)
    before, after = sgpr.compare(model, logs[2:]), sgpr.compare(better, logs[2:])
    assert after.rmse[0] < 0.25 * before.rmse[0]
    assert after.rmse[0] < NOISE
    assert any("cable_stiffness" in line for line in better.history)
    better.save(tmp_path / "better.sgpr")
    again = sgpr.load(tmp_path / "better.sgpr")
    assert np.array_equal(sgpr.compare(again, logs[2:]).rmse, after.rmse)


def test_candidates_alone_are_not_added(model: sgpr.Model, diagnosis: sgpr.Diagnosis) -> None:
    mere = next(one for one in diagnosis.candidates if one.effect != "cable_stiffness")
    with pytest.raises(sgpr.SgprError, match="candidate"):
        model.add(mere)


def test_what_a_candidate_would_gain(model: sgpr.Model, diagnosis: sgpr.Diagnosis, logs: list[sgpr.Recording]) -> None:
    told: list[list[dict[str, Any]]] = []

    def stop(stage: str, done: int, total: int) -> None:
        if told:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sgpr.diagnose(model, logs[:2], progress=stop, ranked=told.append)
    (candidates,) = told
    listed = {(one.effect, *one.joints): one.score for one in diagnosis.candidates[1:]}
    assert set(listed) < {(one["effect"], *one["joints"]) for one in candidates}
    # A spring has no constants to be refined: added by hand it is the fit that the ranking has judged.
    spring = candidates[0]
    assert (spring["effect"], spring["joints"]) == ("cable_stiffness", ["joint_1"])
    (added,) = sgpr.diagnose(model, logs[:2], effects=["cable_stiffness"], add=["cable_stiffness@joint_1"]).findings
    for rmse, expected in (("rmse_before", added.rmse_before), ("rmse_after", added.rmse_after)):
        assert spring[rmse]["joint_1"] == pytest.approx(expected["joint_1"], rel=0.05)
    share = 100 * (1 - spring["rmse_after"]["joint_1"] / spring["rmse_before"]["joint_1"])
    assert spring["error_gained_percent"] == pytest.approx(share)
    finding = diagnosis.findings[0]
    fall = 100 * (1 - finding.rmse_after["joint_1"] / finding.rmse_before["joint_1"])
    assert finding.error_gained_percent >= fall > 50.0
    weak = [one for one in candidates if one["score"] <= 0.0]
    assert weak and all(one["error_gained_percent"] == 0.0 for one in weak)


def test_what_hears_of_candidates_may_fail(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    def hears(candidates: list[dict[str, Any]]) -> None:
        raise RuntimeError("no room on the page")

    with pytest.raises(RuntimeError, match="no room"):
        sgpr.diagnose(model, logs[:2], effects=["cable_stiffness"], ranked=hears)


def test_an_effect_that_cannot_act_there_is_refused_at_once(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    def never(stage: str, done: int, total: int) -> None:
        raise AssertionError(stage)

    for name, why in (("torque_ripple", "give `effect@joint`"), ("torque_riple@joint_1", "torque_ripple")):
        with pytest.raises(sgpr.SgprError, match=why):
            sgpr.diagnose(model, logs[:2], add=[name], progress=never)


def test_plain_data_has_the_keys_of_the_file(diagnosis: sgpr.Diagnosis) -> None:
    data = diagnosis.to_dict()
    assert data["schema"] == 2
    assert data["verdict"] == diagnosis.verdict
    keys = {"effect", "joints", "probability", "parameters", "rmse_before", "rmse_after", "evidence"}
    keys |= {"confusable_with", "separating_experiment", "error_gained_percent"}
    assert keys <= set(data["findings"][0])
    assert set(data["joints"]["joint_1"]) == {
        "rmse_before",
        "rmse_after",
        "noise",
        "fit_percent_before",
        "fit_percent_after",
    }
    assert "temperature_dependent_friction" in diagnosis.not_testable
    assert data["detectable"] == diagnosis.detectable
    offset = next(one for one in diagnosis.detectable if one["effect"] == "torque_offset")
    assert offset["unit"] == "N·m"
    assert 0.0 < offset["seen_from"] <= offset["told_apart_from"]
    assert offset["torque"] == pytest.approx(offset["seen_from"], rel=1e-6), "a constant's mean square is its own"


def test_an_effect_that_is_a_function(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    def column(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return q[:, joint]

    effect = sgpr.Effect("my_spring", column, ["k"], unit="N·m/rad")
    found = sgpr.diagnose(model, logs[:2], effects=[effect, "quadratic_viscous_friction"])
    assert [(one.effect, one.joints) for one in found.findings] == [("my_spring", ["joint_1"])]
    assert found.findings[0].parameters["joint_1.k"][0] == pytest.approx(HIDDEN, rel=0.02)


def test_what_a_function_raises_is_raised(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    def column(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("by design")

    with pytest.raises(ZeroDivisionError, match="by design"):
        sgpr.diagnose(model, logs[:2], effects=[sgpr.Effect("broken", column, ["a"])])


def test_progress_can_stop_it(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    def stop(stage: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sgpr.diagnose(model, logs[:2], progress=stop)


@pytest.mark.parametrize("still", [0, 1])
def test_a_joint_that_stands_still(logs: list[sgpr.Recording], still: int) -> None:
    robot = sgpr.robots.two_link()
    held = []
    for log in logs[:2]:
        assert log.tau is not None
        q, tau = log.q.copy(), log.tau.copy()
        q[:, still] = 0.3
        tau[:, still] = robot.gravity_torque(q)[:, still]
        held.append(sgpr.Recording(log.time_ns, q, None, tau, joint_names=robot.joint_names))
    model = sgpr.identify(robot, held, effects=["viscous_friction", "coulomb_friction"])
    found = sgpr.diagnose(model, held)
    moving = robot.joint_names[1 - still]
    friction = [one for one in found.detectable if one["effect"] == "stribeck_friction"]
    assert [one["joints"] for one in friction] == [[moving]]


def test_wrong_arguments(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    with pytest.raises(sgpr.SgprError, match="no_such_effect"):
        sgpr.diagnose(model, logs[:2], effects=["no_such_effect"])
    with pytest.raises(sgpr.SgprError, match="already"):
        sgpr.Effect("viscous_friction", lambda joint, q, dq, ddq: q[:, joint], ["a"])
    with pytest.raises(TypeError):
        sgpr.diagnose(model, logs[:2], effects="stribeck_friction")


def test_command(tmp_path: Path) -> None:
    logs = [write_log(tmp_path / f"log_{seed}.csv", seed) for seed in (1, 2, 3)]
    out = tmp_path / "out"
    done = run(
        "diagnose",
        "--robot",
        "two_link",
        "--train",
        *logs[:2],
        "--test",
        logs[2],
        "--effects",
        "viscous_friction",
        "--look-for",
        "coulomb_friction",
        "stribeck_friction",
        "--out",
        out,
        "--json",
    )
    assert done.code == 0, done.err
    assert {path.name for path in out.iterdir()} == {"diagnosis.json", "report.html", "predictions.csv", "model.sgpr"}
    data = json.loads(done.out)
    assert data == json.loads((out / "diagnosis.json").read_text())
    assert data["findings"][0]["effect"] == "coulomb_friction"
    at_joints = [finding for finding in data["findings"] if finding["effect"] == "coulomb_friction"]
    assert sorted(finding["joints"][0] for finding in at_joints) == ["joint_1", "joint_2"]
    found = {p["name"]: p["value"] for finding in at_joints for p in finding["parameters"]}
    for joint, size in zip(("joint_1", "joint_2"), np.broadcast_to(COULOMB, 2), strict=True):
        assert found[f"{joint}.Fc"] == pytest.approx(size, rel=0.1)
    # An effect at several joints is named once in the first line of the page.
    assert re.search(r"The model lacks coulomb friction at joint_[12], joint_[12]\.", (out / "report.html").read_text())
    with (out / "predictions.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:5] == ["file", "t", "joint_1_measured", "joint_1_before", "joint_1_after"]

    def error(which: str) -> float:
        return float(np.std([float(row["joint_1_measured"]) - float(row[f"joint_1_{which}"]) for row in rows]))

    assert error("after") < 0.5 * error("before")
    assert sgpr.load(out / "model.sgpr").effects == ["viscous_friction"]
    assert "coulomb friction" in (out / "report.html").read_text()


@pytest.mark.parametrize("options", [{}, {"prior_deviation": 0.5}, {"prior": None}])
def test_a_prior_that_was_asked_for_stays_in_force(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], options: dict[str, Any]
) -> None:
    log = demo_logs[0]
    short = sgpr.Recording(log.time_ns[:1100], log.q[:1100], None, log.tau[:1100], joint_names=log.joint_names)

    model = sgpr.identify(demo_robot, [short], **options)
    added = model.add("coulomb_transition@joint_4", [short])

    before, after = (each.fit["prior_standard_deviation"] for each in (model, sgpr.Model.from_bytes(added.to_bytes())))
    assert (before is None, after is None) == (options == {"prior": None},) * 2
    if "prior_deviation" in options:
        assert before == after == options["prior_deviation"]
    assert added.history[0] == model.history[0]
    said = [line for line in added.history if line.startswith("with the effects that follow, identified by")]
    # A bare estimate says the same again.
    assert len(said) == (options != {"prior": None})


def test_an_effect_is_added_by_hand(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    model = sgpr.identify(demo_robot, demo_logs, effects=["viscous_friction", "coulomb_friction", "rotor_inertia"])
    added = sgpr.diagnose(model, demo_logs, [demo_test], add=["coulomb_transition@joint_4"])
    assert [(finding.effect, finding.joints) for finding in added.findings] == [("coulomb_transition", ["joint_4"])]
    before, after = (sgpr.compare(each, [demo_test]).joints[3].rmse for each in (model, added.model))
    assert after < 0.5 * before
    same = model.add("coulomb_transition@joint_4", demo_logs)
    assert same.to_bytes() == added.model.to_bytes()
    with pytest.raises(sgpr.SgprError, match="there is no joint `joint_7`"):
        model.add("coulomb_transition@joint_7", demo_logs)
    with pytest.raises(sgpr.SgprError, match="fitted to logs"):
        model.add("coulomb_transition@joint_4")
    with pytest.raises(TypeError, match="expected a Finding"):
        model.add(3, demo_logs)  # type: ignore[arg-type]
