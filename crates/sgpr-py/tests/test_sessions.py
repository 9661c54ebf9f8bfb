"""What changed between sessions: the command, its page and its files, on logs whose friction grows."""

import json
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import DEMO_ROBOT, DEMO_TRAIN, run

GROWN = 0.2


def with_more_friction(log: sgpr.Recording, joint: int, share: float) -> sgpr.Recording:
    """The log of an arm whose Coulomb friction at a joint (5.2 N·m at joint 2) has grown."""
    speed = np.gradient(log.q, log.time_ns * 1e-9, axis=0)
    tau = log.tau.copy()
    tau[:, joint] += share * 5.2 * np.sign(speed[:, joint])
    return sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names, source=f"worn {log.source}")


@pytest.fixture(scope="module")
def logs() -> list[sgpr.Recording]:
    return [sgpr.read(path) for path in DEMO_TRAIN]


def test_friction_that_grew_is_told_and_modelled(logs: list[sgpr.Recording]) -> None:
    robot = sgpr.Robot.from_urdf(DEMO_ROBOT)
    worn = with_more_friction(logs[0], 1, GROWN)
    found = sgpr.compare_sessions(robot, {"before": logs[1:], "after": [worn]})
    changed = [test for test in found.tests if test["changed"]]
    assert [(test["cause"], test["joint"]) for test in changed] == [("friction", "joint_2")], found.sentences
    [sentence] = found.sentences
    assert sentence.startswith("friction of joint_2 is ")
    assert sentence.endswith(" % higher in after than in before")
    [test] = changed
    difference = test["values"][1] - test["values"][0]
    assert abs(difference - GROWN * 5.2) < 4.0 * np.hypot(*test["standard_deviations"])
    assert test["unit"] == "N·m"
    assert test["chance"] < 1e-4
    errors = {name: sgpr.compare(found.model(name), [worn]).joints[1].rmse for name in found.names}
    assert errors["after"] < 0.9 * errors["before"]
    assert found.model("after").parameters["joint_2.Fc"].standard_deviation > 0.0
    with pytest.raises(ValueError, match="sessions are before, after"):
        found.model("monday")


def test_the_command_writes_a_page_and_a_model_of_each_session(logs: list[sgpr.Recording], tmp_path: Path) -> None:
    worn = tmp_path / "worn.csv"
    with_more_friction(logs[2], 1, GROWN).save(worn)
    pairs = [f"before={DEMO_TRAIN[0]}", f"before={DEMO_TRAIN[1]}", f"after={worn}"]
    out = tmp_path / "out"
    found = run("sessions", "--robot", DEMO_ROBOT, "--logs", *pairs, "--out", out)
    assert found.code == 0, found.err
    assert "one thing changed between before, after" in found.out
    assert "friction of joint_2 is" in found.out
    data = json.loads((out / "sessions.json").read_text())
    assert [test["cause"] for test in data["tests"] if test["changed"]] == ["friction"]
    assert {path.name for path in out.glob("*.sgpr")} == {"model_1_before.sgpr", "model_2_after.sgpr"}
    page = (out / "report.html").read_text()
    assert "friction of joint_2 is" in page.replace("Friction of joint_2", "friction of joint_2")
    assert sgpr.load(out / "model_2_after.sgpr").history[0].startswith("session after: its own friction of joint_2")


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([DEMO_TRAIN[0]], "expected SESSION=FILE"),
        ([f"a={DEMO_TRAIN[0]}", f"a={DEMO_TRAIN[1]}"], "two or more make a comparison"),
    ],
)
def test_wrong_use_is_explained(pairs: list[str], said: str) -> None:
    found = run("sessions", "--robot", DEMO_ROBOT, "--logs", *pairs)
    assert found.code == 2
    assert said in " ".join(found.err.replace("│", " ").split())


def test_sessions_that_cannot_be_compared(logs: list[sgpr.Recording]) -> None:
    robot = sgpr.Robot.from_urdf(DEMO_ROBOT)
    with pytest.raises(sgpr.IdentificationError, match="two or more"):
        sgpr.compare_sessions(robot, {"only": logs[:1]})
    # A copy counts in the first session alone.
    with pytest.raises(sgpr.IdentificationError, match="`again` has 0 parts"):
        sgpr.compare_sessions(robot, {"once": logs[:1], "again": logs[:1]})
    with pytest.raises(sgpr.IdentificationError, match="stribeck_friction"):
        sgpr.compare_sessions(robot, {"a": logs[:1], "b": logs[1:2]}, effects=["stribeck_friction"])
    with pytest.raises(TypeError, match="prior"):
        sgpr.compare_sessions(robot, {"a": logs[:1], "b": logs[1:2]}, prior=None)


def test_a_torque_with_the_other_sign_is_named(logs: list[sgpr.Recording], tmp_path: Path) -> None:
    log, turned = logs[2], tmp_path / "turned.csv"
    sign = np.where(np.arange(log.dof) == 1, -1.0, 1.0)
    sgpr.Recording(log.time_ns, log.q, log.dq, sign * log.tau, joint_names=log.joint_names).save(turned)
    pairs = [f"before={DEMO_TRAIN[0]}", f"before={DEMO_TRAIN[1]}", f"after={turned}"]
    found = run("sessions", "--robot", DEMO_ROBOT, "--logs", *pairs)
    assert found.code == 1
    said = " ".join(found.err.split())
    assert "the torque of joint_2 has the other sign in `after`, where friction would drive the joint" in said
    assert "negate it there, or leave that session out" in said


def test_torques_with_the_other_sign_in_all_sessions_are_named(logs: list[sgpr.Recording], tmp_path: Path) -> None:
    pairs = []
    for name, log in zip("ab", logs, strict=False):
        path = tmp_path / f"{name}.csv"
        sgpr.Recording(log.time_ns, log.q, log.dq, -log.tau, joint_names=log.joint_names).save(path)
        pairs.append(f"{name}={path}")
    found = run("sessions", "--robot", DEMO_ROBOT, "--logs", *pairs, "--out", tmp_path / "out")
    assert found.code == 0, found.err
    assert "look: all torques look negated" in " ".join(found.err.split())
    data = json.loads((tmp_path / "out" / "sessions.json").read_text())
    assert any("all torques look negated" in message["text"] for message in data["messages"])
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("Please note") < page.index("ll torques look negated") < page.index("Values of each session")
    right = run("sessions", "--robot", DEMO_ROBOT, "--logs", f"a={DEMO_TRAIN[0]}", f"b={DEMO_TRAIN[1]}")
    assert right.code == 0
    assert "look:" not in right.err


def test_identify_tells_that_logs_are_of_several_days(logs: list[sgpr.Recording], tmp_path: Path) -> None:
    march = 1_772_600_000 * 10**9
    starts = [march, march + 600 * 10**9, march + 3 * 86_400 * 10**9]
    paths = []
    for k, (log, start) in enumerate(zip(logs, starts, strict=True)):
        time = log.time_ns - log.time_ns[0] + start
        paths.append(tmp_path / f"log_{k}.mcap")
        sgpr.Recording(time, log.q, log.dq, log.tau, joint_names=log.joint_names).save(paths[-1])
    found = run("identify", "--robot", DEMO_ROBOT, "--train", *paths, "--out", tmp_path / "out", "--no-report")
    assert found.code == 0, found.err
    said = " ".join(found.err.split())
    assert "the training logs are of 2 sessions over 3.0 days" in said
    assert f"--logs session_1={paths[0]} session_1={paths[1]} session_2={paths[2]}" in said
    found = run("identify", "--robot", DEMO_ROBOT, "--train", *paths[:2], "--out", tmp_path / "one", "--no-report")
    assert "sessions" not in found.err
