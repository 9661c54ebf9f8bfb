"""What the error depends on, formulas, what to record next, and effects of the user with constants."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from cli_support import run

NOISE = 0.05  # N·m
RATE = 100.0
SPEED, HEIGHT = 0.25, 1.2  # rad/s, N·m
KNOWN = ["viscous_friction", "coulomb_friction"]


def log(number: int, seconds: float = 20.0, channels: bool = False) -> sgpr.Recording:
    """A log of the two-link arm with friction and a peak of it at low speeds that the model does not know."""
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
    tau[:, 1] += HEIGHT * np.sign(dq[:, 1]) / (1 + (dq[:, 1] / SPEED) ** 2)
    time_ns = np.round((t + seconds * number) * 1e9).astype(np.int64)
    noisy = q + rng.normal(0, 1e-6, q.shape)
    more: dict[str, Any] = {"channels": {"humidity": 0.5 + 0.1 * np.sin(0.3 * t)}} if channels else {}
    return sgpr.Recording(time_ns, noisy, None, tau, joint_names=robot.joint_names, source=f"log {number}", **more)


@pytest.fixture(scope="module")
def logs() -> list[sgpr.Recording]:
    return [log(number) for number in range(3)]


@pytest.fixture(scope="module")
def model(logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(sgpr.robots.two_link(), logs[:2], effects=KNOWN)


def peak(joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, v: float) -> np.ndarray:
    return np.sign(dq[:, joint]) / (1 + (dq[:, joint] / v) ** 2)


def peak_effect(name: str) -> sgpr.Effect:
    return sgpr.Effect(name, peak, ["a"], constants={"v": (0.01, 2.0, "rad/s")}, unit="N·m")


def test_what_the_residual_depends_on(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    first, second = sgpr.residual_structure(model, sgpr.compare(model, logs[2:]))
    assert second["inputs"][0]["variable"] == "speed of joint_2"
    assert second["shares"]["state"] > 0.8
    assert sum(second["shares"].values()) == pytest.approx(1.0)
    assert "odd in the speed" in second["shape"]
    assert second["whiteness"] < min(1e-6, first["whiteness"])
    assert first["shares"]["noise"] > 0.9
    with pytest.raises(sgpr.SgprError, match="another robot"):
        sgpr.residual_structure(sgpr.Model.nominal(sgpr.robots.puma560()), sgpr.compare(model, logs[2:]))


def test_an_effect_with_a_constant_is_found_saved_and_read(
    model: sgpr.Model, logs: list[sgpr.Recording], tmp_path: Path
) -> None:
    effect = peak_effect("low_speed_peak")
    diagnosis = sgpr.diagnose(model, logs[:2], effects=[effect, "cable_stiffness"])
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joints) == ("low_speed_peak", ["joint_2"])
    speed, deviation, unit = finding.parameters["joint_2.v"]
    assert speed == pytest.approx(SPEED, rel=0.05) and deviation is not None and unit == "rad/s"
    assert finding.parameters["joint_2.a"][0] == pytest.approx(HEIGHT, rel=0.05)
    better = model.add(finding)
    path = tmp_path / "better.sgpr"
    better.save(path)
    with pytest.raises(sgpr.ModelFileError, match="register_effect"):
        sgpr.load(path)
    sgpr.register_effect(effect)
    again = sgpr.load(path)
    assert np.array_equal(sgpr.compare(again, logs[2:]).rmse, sgpr.compare(better, logs[2:]).rmse)
    assert sgpr.Model.from_bytes(better.to_bytes()).history == better.history
    # What is registered is looked for by its name.
    assert sgpr.diagnose(model, logs[:2], effects=["low_speed_peak"]).findings[0].effect == "low_speed_peak"
    sgpr.unregister_effect(effect)
    with pytest.raises(sgpr.ModelFileError, match="register_effect"):
        sgpr.load(path)


def test_an_effect_sees_channels(model: sgpr.Model, logs: list[sgpr.Recording]) -> None:
    seen: dict[str, tuple[int, ...]] = {}

    def column(
        joint: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, channels: dict[str, np.ndarray]
    ) -> np.ndarray:
        seen.update({name: values.shape[1:] for name, values in channels.items()})
        return channels["humidity"] * np.sign(dq[:, joint]) * np.abs(channels["load"][:, joint]) + 0 * channels["time"]

    effect = sgpr.Effect("damp_friction", column, ["a"], channels=["humidity", "load", "time"])
    without = sgpr.diagnose(model, logs[:2], effects=[effect])
    assert without.not_testable == {"damp_friction": "no channel `humidity` in the logs"}
    assert seen == {}
    sgpr.diagnose(model, [log(0, channels=True), log(1, channels=True)], effects=[effect])
    assert seen == {"humidity": (), "load": (2,), "time": ()}


@pytest.mark.parametrize(
    ("constants", "words"),
    [
        ({"v": (1.0, 0.5)}, "lowest below a highest"),
        ({"v": 3.0}, "needs"),
        ({"dq": (0.1, 1.0)}, "argument of the function"),
    ],
)
def test_wrong_constants(constants: dict[str, Any], words: str) -> None:
    with pytest.raises(sgpr.SgprError, match=words):
        sgpr.Effect("wrong", peak, ["a"], constants=constants)


def swinging() -> sgpr.Recording:
    """Joint 2 swings with one frequency, its friction a quarter of the noise: sgn(dq) and dq look alike."""
    robot = sgpr.robots.two_link()
    rng = np.random.default_rng(0)
    t = np.arange(1200) / RATE
    waves = [[(0.7, 1.1, 0.3), (0.3, 2.9, 1.0)], [(0.5, 3.0, 0.5)]]
    q, dq, ddq = (
        np.stack([sum(f(a, w, p) for a, w, p in joint) for joint in waves], axis=1)
        for f in (
            lambda a, w, p: a * np.sin(w * t + p),
            lambda a, w, p: a * w * np.cos(w * t + p),
            lambda a, w, p: -a * w * w * np.sin(w * t + p),
        )
    )
    tau = robot.inverse_dynamics(q, dq, ddq) + rng.normal(0, NOISE, q.shape)
    tau[:, 1] += 0.0118 * dq[:, 1]
    noisy = q + rng.normal(0, 1e-6, q.shape)
    time_ns = np.round(t * 1e9).astype(np.int64)
    return sgpr.Recording(time_ns, noisy, None, tau, joint_names=robot.joint_names, source="swing")


def test_the_next_experiment_is_written(tmp_path: Path) -> None:
    file = tmp_path / "swing.csv"
    swinging().save(file)
    out = tmp_path / "out"
    pair = ("viscous_friction", "coulomb_friction")
    done = run(
        *("diagnose", "--robot", "two_link", "--train", file, "--effects", "none"),
        *("--look-for", *pair, "--out", out, "--json"),
    )
    assert done.code == 0, done.err
    data = json.loads(done.out)
    (proposal,) = data["next_experiment"]
    assert set(pair) <= set(proposal["about"])
    assert proposal["separation_expected"] > proposal["separation_now"] + 3
    assert data["next_experiment_file"] == "next_experiment.csv"
    motion = sgpr.read(out / "next_experiment.csv", joints=["joint_1", "joint_2"])
    assert motion.dq is not None and np.abs(motion.dq[[0, -1]]).max() == 0.0
    assert np.abs(motion.q[:, 1]).max() < 0.51
    assert len(motion.time_ns) == pytest.approx(100 * proposal["seconds"], abs=3)
    assert (out / "next_experiment.mcap").stat().st_size > 1000
    report = (out / "report.html").read_text()
    assert "What to record next" in report and proposal["experiment"] in report


def test_without_a_next_experiment_none_is_written(
    model: sgpr.Model, logs: list[sgpr.Recording], tmp_path: Path
) -> None:
    diagnosis = sgpr.diagnose(model, logs[:2], effects=["cable_stiffness"])
    assert diagnosis.next_motion is None
    with pytest.raises(sgpr.SgprError, match="no next experiment"):
        diagnosis.save_next_motion(tmp_path / "none.csv")
    assert not (tmp_path / "none.csv").exists()
