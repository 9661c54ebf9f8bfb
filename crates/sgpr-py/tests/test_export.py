"""Models as source files: compiled, and run over a recorded motion."""

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sgpr
from cli_support import run

EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia", "presliding_friction@joint_2", "torque_delay"]

WRAPPER = """
#include "arm.h"
static sgpr_arm_state state;
void reset(void);
void reset(void) { sgpr_arm_reset(&state); }
int torque(const NUMBER *q, const NUMBER *dq, const NUMBER *ddq, NUMBER *tau);
int torque(const NUMBER *q, const NUMBER *dq, const NUMBER *ddq, NUMBER *tau)
{
    return sgpr_arm_torque(&state, q, dq, ddq, tau);
}
"""


@pytest.fixture(scope="module")
def model(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(demo_robot, demo_logs[:1], effects=EFFECTS)


def library(folder: Path, number: str = "double") -> ctypes.CDLL:
    """The functions of `arm.h` in a folder, compiled."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here")
    (folder / "arm.c").write_text(WRAPPER.replace("NUMBER", number))
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run([compiler, *strict, "-o", "libarm.so", "arm.c", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "libarm.so"))


def pointer(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


@pytest.mark.parametrize("purpose", ["feed_forward", "expected_measurement"])
def test_c_over_a_recorded_motion_is_the_predictor(
    model: sgpr.Model, demo_test: sgpr.Recording, tmp_path: Path, purpose: str
) -> None:
    rate = demo_test.sample_rate_hz
    model.export("c", tmp_path / "arm.h", name="arm", rate_hz=rate, purpose=purpose)
    arm = library(tmp_path)
    part = sgpr.compare(model, [demo_test]).logs[0]
    predictor = model.predictor(rate_hz=rate, purpose=purpose)
    arm.reset()
    tau = np.zeros(part.q.shape)
    for k, rows in enumerate(zip(part.q, part.dq, part.ddq, strict=True)):
        q, dq, ddq = (np.ascontiguousarray(row) for row in rows)
        assert arm.torque(pointer(q), pointer(dq), pointer(ddq), pointer(tau[k])) == 0
        expected = predictor.torque(q, dq, ddq)
        np.testing.assert_allclose(tau[k], expected, rtol=0, atol=1e-12 * np.abs(part.predicted).max())


def test_c_in_32_bits_is_the_predictor_but_for_rounding(
    model: sgpr.Model, demo_test: sgpr.Recording, tmp_path: Path
) -> None:
    rate = demo_test.sample_rate_hz
    model.export("c", tmp_path / "arm.h", name="arm", precision="single", rate_hz=rate)
    arm = library(tmp_path, "float")
    part = sgpr.compare(model, [demo_test]).logs[0]
    predictor = model.predictor(rate_hz=rate, purpose="feed_forward")
    arm.reset()
    tau = np.zeros(part.q.shape, np.float32)
    expected = np.zeros(part.q.shape)
    for k, rows in enumerate(zip(part.q, part.dq, part.ddq, strict=True)):
        q, dq, ddq = (np.ascontiguousarray(row, np.float32) for row in rows)
        assert arm.torque(pointer(q), pointer(dq), pointer(ddq), pointer(tau[k])) == 0
        expected[k] = predictor.torque(*(row.astype(float) for row in (q, dq, ddq)))
    np.testing.assert_allclose(tau, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_the_head_says_what_the_file_is(model: sgpr.Model, tmp_path: Path) -> None:
    model.export("rust", tmp_path / "new" / "arm.rs", rate_hz=500.0, purpose="expected_measurement")
    code = (tmp_path / "new" / "arm.rs").read_text()
    for words in (sgpr.__version__, "expected_measurement", "500.0 times per second", "N m", *model.robot.joint_names):
        assert words in code
    assert "presliding_friction@joint_2" in code


def test_what_cannot_be_exported_is_refused(model: sgpr.Model, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="fortran"):
        model.export("fortran", tmp_path / "arm.f")
    with pytest.raises(ValueError, match="left arm"):
        model.export("c", tmp_path / "arm.h", name="left arm")
    with pytest.raises(ValueError, match="half"):
        model.export("c", tmp_path / "arm.h", precision="half")
    with pytest.raises(sgpr.SgprError, match=r"torque_delay.*rate_hz"):
        model.export("c", tmp_path / "arm.h", purpose="expected_measurement")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_the_same_file(model: sgpr.Model, tmp_path: Path) -> None:
    model.save(tmp_path / "arm.sgpr")
    model.export("c", tmp_path / "wanted.h", name="arm")
    done = run("export", tmp_path / "arm.sgpr", "--language", "c", "--out", tmp_path / "arm.h", "--name", "arm")
    assert done.code == 0, done.err
    assert (tmp_path / "arm.h").read_text() == (tmp_path / "wanted.h").read_text()
    model.export("c", tmp_path / "wanted.h", name="arm", precision="single")
    options = ["--language", "c", "--precision", "single", "--name", "arm", "--out"]
    done = run("export", tmp_path / "arm.sgpr", *options, tmp_path / "arm.h")
    assert done.code == 0 and "32 bits" in done.out, done.err
    assert (tmp_path / "arm.h").read_text() == (tmp_path / "wanted.h").read_text()
    missing = run("export", tmp_path / "none.sgpr", "--language", "c", "--out", tmp_path / "x.h")
    assert missing.code != 0 and "none.sgpr" in missing.err and not (tmp_path / "x.h").exists()


def test_robot_files_hold_bodies_and_friction_and_say_what_they_leave_out(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], data: Path, tmp_path: Path
) -> None:
    model = sgpr.identify(demo_robot, demo_logs[:1], effects=EFFECTS, consistent=True)
    model.save(tmp_path / "arm.sgpr")
    source, urdf, mjcf = data / "demo" / "robot.urdf", tmp_path / "arm.urdf", tmp_path / "arm.xml"
    done = run("export", tmp_path / "arm.sgpr", "--language", "urdf", "--robot", source, "--out", urdf)
    assert done.code == 0, done.err
    assert "urdf has no place for rotor_inertia, presliding_friction, torque_delay" in done.out + done.err
    again = sgpr.Robot.from_urdf(urdf)
    np.testing.assert_allclose(
        again.standard_parameters, model.identified_robot.standard_parameters, rtol=1e-6, atol=1e-9
    )
    done = run("export", tmp_path / "arm.sgpr", "--language", "mjcf", "--out", mjcf, "--json")
    assert json.loads(done.out)["left_out"] == ["presliding_friction", "torque_delay"]
    assert mjcf.read_text() == model.to_mjcf()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--language", "urdf"], "--robot: a URDF is written from the one"),
        (["--language", "mjcf", "--robot", "robot.urdf"], "--robot: for urdf"),
        (["--language", "mjcf", "--rate", "100"], "--rate: for c and rust"),
        (["--language", "c", "--robot", "robot.urdf"], "--robot: for urdf"),
        (["--language", "mjcf"], "is no body: identify with physical consistency"),
    ],
)
def test_robot_files_that_are_none_are_refused(
    model: sgpr.Model, tmp_path: Path, arguments: list[str], words: str
) -> None:
    model.save(tmp_path / "arm.sgpr")
    done = run("export", tmp_path / "arm.sgpr", "--out", tmp_path / "out" / "arm", *arguments)
    assert done.code != 0 and words in " ".join(done.err.split()), done.err
    assert not (tmp_path / "out").exists()
