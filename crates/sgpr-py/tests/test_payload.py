"""Payloads and drive gains, through Python and the command line."""

import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run

LOAD = np.array([2.0, 0.1, -0.04, 0.2, 0.0248, 0.002, 0.029, -0.01, 0.004, 0.0098])
GAINS = np.array([10.0, 11.0, 8.5, 9.0, 9.5, 10.1])
FRICTION = np.array([3.0, 3.0, 2.0, 0.5, 0.4, 0.3])


def log(load: np.ndarray, seed: int, gains: np.ndarray | float = 1.0) -> sgpr.Recording:
    """The PUMA in motion, at 100 Hz, without velocities."""
    robot = sgpr.robots.puma560()
    parameters = robot.standard_parameters.copy()
    parameters[50:] += load
    t = np.arange(4000) / 100.0
    q, dq, ddq = (np.zeros((len(t), 6)) for _ in range(3))
    for joint in range(6):
        for h in range(1, 6):
            w, a, phase = 0.6 * h + 0.11 * joint, 0.8 / h, 1.7 * h * (joint + 1)
            q[:, joint] += a * np.sin(w * t + phase)
            dq[:, joint] += a * w * np.cos(w * t + phase)
            ddq[:, joint] -= a * w * w * np.sin(w * t + phase)
    tau = robot.with_standard_parameters(parameters).inverse_dynamics(q, dq, ddq) + FRICTION * np.sign(dq)
    tau += 0.05 * np.random.default_rng(seed).standard_normal(tau.shape)
    time = (t * 1e9).round().astype(np.int64)
    return sgpr.Recording(time, q, None, tau / gains, joint_names=robot.joint_names, source=f"run {seed}")


def test_a_payload_is_found_with_its_deviations() -> None:
    robot = sgpr.robots.puma560()
    payload = sgpr.identify_payload(robot, [log(0 * LOAD, 1)], [log(LOAD, 2)], effects=["coulomb_friction"])
    assert payload.link == robot.joint_names[-1]
    assert abs(payload.mass / 2.0 - 1.0) < 0.02
    assert (np.abs(payload.parameters - LOAD) < 5.0 * payload.standard_deviations + 1e-3).all()
    assert payload.covariance.shape == (10, 10)
    assert np.allclose(payload.centre, payload.parameters[1:4] / payload.mass)
    assert payload.to_dict()[0]["name"] == "m"
    with pytest.raises(sgpr.SgprError, match="link"):
        sgpr.identify_payload(robot, [log(0 * LOAD, 1)], [log(LOAD, 2)], link="elbow")


def test_gains_follow_from_a_known_mass() -> None:
    robot = sgpr.robots.puma560()
    logs = [log(0 * LOAD, 3, GAINS)], [log(LOAD, 4, GAINS)]
    found = sgpr.identify_drive_gains(robot, *logs, payload={"m": 2.0}, effects=["coulomb_friction"])
    assert np.abs(found.gains / GAINS - 1.0).max() < 0.05
    assert found.payload[0] == 2.0
    for payload in ({}, {"m": float("nan")}, {"weight": 2.0}, {"m": "heavy"}):
        with pytest.raises(sgpr.SgprError):
            sgpr.identify_drive_gains(robot, *logs, payload=payload)  # type: ignore[arg-type]


def noisy(log: sgpr.Recording, noise: float, seed: int) -> sgpr.Recording:
    """The same with white noise of the torques, N·m, in its currents."""
    current = log.tau + noise * np.random.default_rng(seed).standard_normal(log.tau.shape) / GAINS
    return sgpr.Recording(log.time_ns, log.q, None, current, joint_names=log.joint_names, source=log.source)


def test_gains_know_how_good_they_are() -> None:
    # White noise has a memory of the filter's length where it arrives.
    robot, without, with_it = sgpr.robots.puma560(), log(0 * LOAD, 3, GAINS), log(LOAD, 4, GAINS)
    errors = []
    for seed in range(8):
        logs = [noisy(without, 1.0, seed)], [noisy(with_it, 1.0, 100 + seed)]
        found = sgpr.identify_drive_gains(robot, *logs, payload={"m": 2.0}, effects=["coulomb_friction"])
        errors.append((found.gains - GAINS) / found.standard_deviations)
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_gains_that_noise_would_draw_below_zero_are_found() -> None:
    robot = sgpr.robots.puma560()
    logs = [noisy(log(0 * LOAD, 3, GAINS), 3.0, 1)], [noisy(log(LOAD, 4, GAINS), 3.0, 2)]
    found = sgpr.identify_drive_gains(robot, *logs, payload={"m": 2.0}, effects=["coulomb_friction"])
    assert (np.abs(found.gains - GAINS) < 4.0 * found.standard_deviations).all()


def test_torques_with_the_other_sign_are_named(tmp_path: Path) -> None:
    files = []
    for name, recording in (("without.mcap", log(0 * LOAD, 5)), ("with.mcap", log(LOAD, 6))):
        turned = sgpr.Recording(recording.time_ns, recording.q, None, -recording.tau, joint_names=recording.joint_names)
        turned.save(tmp_path / name)
        files.append(str(tmp_path / name))
    arguments = ["payload", "--robot", "puma560", "--unloaded", files[0], "--loaded", files[1]]
    found = run(*arguments, "--effects", "coulomb_friction", "--json")
    assert found.code == 0, found.err
    data = json.loads(found.out)
    assert data["mass"] < 1.0
    assert any(one["rank"] == "look" and "look negated" in one["text"] for one in data["messages"])


def test_the_command_says_what_hangs_on_the_arm(tmp_path: Path) -> None:
    files = []
    for name, recording in (("without.mcap", log(0 * LOAD, 5)), ("with.mcap", log(LOAD, 6))):
        recording.save(tmp_path / name)
        files.append(str(tmp_path / name))
    arguments = ["payload", "--robot", "puma560", "--unloaded", files[0], "--loaded", files[1]]
    arguments += ["--effects", "coulomb_friction", "--out", str(tmp_path / "out")]
    found = run(*arguments)
    assert found.code == 0, found.err
    assert "payload of 2.0" in found.out or "payload of 1.9" in found.out
    data = json.loads((tmp_path / "out" / "payload.json").read_text())
    assert abs(data["mass"] / 2.0 - 1.0) < 0.02
    assert not any("negated" in one["text"] for one in data["messages"])
    found = run(*arguments, "--known", "m=2", "--json")
    assert found.code == 0, found.err
    assert np.allclose(json.loads(found.out)["gains"], 1.0, atol=0.05)
    bodies = ["--known", "m=2", "--consistent", "--estimator", "least_squares", "--lowest-gains", *["0.95"] * 6]
    found = run(*arguments, *bodies, "--json")
    assert found.code == 0, found.err
    gains = np.array(json.loads(found.out)["gains"])
    assert np.allclose(gains, 1.0, atol=0.06)
    assert (gains > 0.95 - 1e-5).all()
    for extra in (["--estimator", "least_squares"], ["--known", "m=2", "--estimator", "guess"]):
        assert run(*arguments, *extra).code == 2
    # What would change nothing is refused, and what holds without a word is what holds in Python.
    for extra in (["--prior", "entropic"], ["--bounds", files[0]], ["--method", "ols"]):
        assert run(*arguments, *extra).code == 2
    robot = sgpr.robots.puma560()
    without, with_it = ([sgpr.read(file)] for file in files)
    for options, expected in (
        ([], {}),
        (["--consistent"], {"consistent": True}),
        (["--no-consistent"], {"consistent": False}),
    ):
        found = run(*arguments, *options, "--json")
        assert found.code == 0, found.err
        payload = sgpr.identify_payload(robot, without, with_it, effects=["coulomb_friction"], **expected)
        values = [p["value"] for p in json.loads(found.out)["parameters"]]
        assert np.array_equal(values, payload.parameters)
    with pytest.raises(sgpr.SgprError, match="method"):
        sgpr.identify_payload(robot, without, with_it, method="ols")
    with pytest.raises(sgpr.SgprError, match="bounds"):
        sgpr.identify_payload(robot, without, with_it, bounds={})
    for extra in (["--known", "m"], ["--link", "elbow"], ["--loaded", files[0]]):
        assert run(*arguments, *extra).code == 2
