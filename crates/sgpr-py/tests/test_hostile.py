"""Values and names that no arm has, through the command line: an answer or one message that says what to do."""

import os
import stat
import subprocess
import sys
import threading
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import sgpr
from cli_support import DEMO_ROBOT, DEMO_TRAIN, Array, run, torque, write_log

ROBOT = "two_link"


def _scaled(columns: slice, factor: float) -> Callable[[Array], Array]:
    def change(table: Array) -> Array:
        table[:, columns] *= factor
        return table

    return change


def _jump(seconds: float) -> Callable[[Array], Array]:
    def change(table: Array) -> Array:
        table[len(table) // 2 :, 0] += seconds
        return table

    return change


TORQUE, POSITION, TIME = slice(3, 5), slice(1, 3), slice(0, 1)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_scaled(TORQUE, 1e300), "give the unit of the torque"),
        (_scaled(TORQUE, 1e-310), "was not measured"),
        (_scaled(POSITION, 1e150), "give the unit of the position"),
        (_scaled(TIME, 1e4), "give the unit of the time"),
        (_scaled(TIME, 1e-5), "give the unit of the time"),
    ],
)
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_values_that_no_arm_makes(command: str, change: Callable[[Array], Array], named: str, tmp_path: Path) -> None:
    log, test = write_log(tmp_path / "log.csv", 1, change), write_log(tmp_path / "test.csv", 2)
    done = run(command, "--robot", ROBOT, "--train", log, "--test", test, "--out", tmp_path / "out", "--quiet")
    assert done.code == 1, done
    assert named in done.err
    assert "should not happen" not in done.err
    assert not (tmp_path / "out" / "report.html").exists()


def test_info_names_values_that_no_arm_makes(tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv", 1, _scaled(TORQUE, 1e300))
    done = run("info", "--robot", ROBOT, log)
    assert done.code in (0, 1)
    assert "give the unit of the torque" in done.out + done.err
    assert "implausible" in [issue.kind for issue in sgpr.read(log).issues]


def test_a_jump_of_the_clock_takes_no_memory(tmp_path: Path) -> None:
    """Thirty years in the middle of a log: what is asked of every moment would be asked of thirty years."""
    log, test = write_log(tmp_path / "log.csv", 1, _jump(1e9)), write_log(tmp_path / "test.csv", 2)
    command = [sys.executable, "-c", LIMITED, "diagnose", "--robot", ROBOT, "--train", log, "--test", test, "--out"]
    done = subprocess.run([*command, str(tmp_path / "out"), "--quiet"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


LIMITED = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
except ImportError:
    pass
from sgpr.cli import main
sys.exit(main(sys.argv[1:]))
"""
"""The command line in 6 GB, where the system can be told so."""

ODD_NAMES = [
    "first joint",
    'the "second", of six',
    "<a href='javascript:alert(1)'>third</a>",
    "</script><script>alert(4)</script>",
    "5 + 1e-9 x",
    "sechstes Gelenk \u2603",
]


def test_reports_of_joints_with_odd_names(tmp_path: Path) -> None:
    tree = ElementTree.parse(DEMO_ROBOT)
    known = [f"joint_{number}" for number in range(1, 7)]
    text = ElementTree.tostring(tree.getroot(), encoding="unicode")
    for name, odd in zip(known, ODD_NAMES, strict=True):
        text = text.replace(f'joint name="{name}"', f"joint name={quoteattr(odd)}")
    robot = tmp_path / "odd.urdf"
    robot.write_text(text)
    logs = [sgpr.read(Path(DEMO_ROBOT).parent / f"{name}.csv.gz") for name in ("train_1", "test")]
    paths = []
    for k, log in enumerate(logs):
        part = slice(500, 1500)
        odd = sgpr.Recording(log.time_ns[part], log.q[part], tau=log.tau[part], joint_names=ODD_NAMES)
        paths.append(tmp_path / f"log_{k}.mcap")
        odd.save(paths[-1])
    effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
    arguments = ["--robot", robot, "--train", paths[0], "--test", paths[1], "--effects", *effects]
    done = run("identify", *arguments, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<a href='javascript" not in page
    assert "<script>alert(4)" not in page
    assert "first joint" in page
    model = sgpr.load(tmp_path / "out" / "model.sgpr")
    assert model.robot.joint_names == ODD_NAMES


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
def test_models_go_through_pipes_and_onto_devices(tmp_path: Path) -> None:
    model = sgpr.Model.nominal(sgpr.robots.two_link())
    pipe, whole = tmp_path / "pipe", tmp_path / "model.sgpr"
    os.mkfifo(pipe)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    model.save(pipe)
    reader.join()
    model.save(whole)
    assert received == [whole.read_bytes()]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    device = tmp_path / "null"
    device.symlink_to(os.devnull)
    model.save(device)
    assert stat.S_ISCHR(device.stat().st_mode)


def test_a_model_that_needs_more_memory_than_there_is() -> None:
    """A record of a simulation that nobody can keep."""
    robot = sgpr.robots.two_link()
    motion = sgpr.excite(robot, terms=3, max_acceleration=[2, 2], starts=1, max_evaluations=20).trajectory
    with pytest.raises(sgpr.SimulationError, match="record_period"):
        sgpr.simulate(robot, motion, duration=1e7)


def test_odd_arrays_are_refused_with_a_message() -> None:
    robot = sgpr.robots.two_link()
    t = np.arange(0.0, 1.0, 0.01)
    with pytest.raises(sgpr.SgprError, match="log"):
        wave = np.column_stack([np.sin(t), np.cos(t)])
        log = sgpr.Recording(t, 1e200 * wave, tau=wave, joint_names=robot.joint_names, source="log")
        sgpr.identify(robot, [log])


@pytest.mark.parametrize("which", ["dq", "ddq"])
def test_a_deviation_of_a_motion_that_no_arm_makes_is_an_error(which: str) -> None:
    t, q, tau = torque(1)
    model = sgpr.identify(sgpr.robots.two_link(), [sgpr.Recording(t, q, tau=tau)])
    motion = {"q": q[:10], "dq": np.zeros((10, 2)), "ddq": np.zeros((10, 2))}
    motion[which][4, 1] = 1e120
    with pytest.raises(sgpr.IdentificationError, match=r"sample 4: .* which no arm makes: check the motion"):
        model.predict(**motion, return_std=True)


def test_ridge_refuses_what_rounding_hides() -> None:
    log = sgpr.read(DEMO_TRAIN[0]).slice(0, 1500)
    log = sgpr.Recording(log.t, log.q, tau=1e12 * log.tau).accept(["torque_scale"])
    with pytest.raises(sgpr.IdentificationError, match=r"ridge: .* check the unit of the torque"):
        sgpr.identify(sgpr.Robot.from_urdf(DEMO_ROBOT), [log], method="ridge")


def test_inertias_that_no_arm_has_are_refused() -> None:
    robot = sgpr.robots.two_link()
    parameters = robot.standard_parameters.copy()
    for value in (1e100, -1e160):
        parameters[4] = value
        with pytest.raises(sgpr.RobotError, match=r"`joint_1.Ixx` has the value .*, which no arm has: check the units"):
            robot.with_standard_parameters(parameters)


def test_columns_almost_without_noise_are_refused_and_end_no_process() -> None:
    t, q, tau = torque(1)
    with pytest.raises(sgpr.IdentificationError, match="relative noise of the columns: 5e-324 is out of range"):
        sgpr.identify(sgpr.robots.two_link(), [sgpr.Recording(t, q, tau=tau)], method="tls:5e-324")
