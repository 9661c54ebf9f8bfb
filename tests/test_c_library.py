"""Models that Python made, in the C library: the same bits."""

import ctypes
import os
from pathlib import Path

import numpy as np
import pytest
import sgpr

ROOT = Path(__file__).resolve().parents[1]
EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia", "presliding_friction@joint_2", "torque_delay"]
RATE_HZ = 250.0


class Options(ctypes.Structure):
    """sgpr_options of the header."""

    _fields_ = (
        ("rate_hz", ctypes.c_double),
        ("purpose", ctypes.c_int32),
        ("deviation", ctypes.c_int32),
        ("keep", ctypes.POINTER(ctypes.c_char_p)),
        ("keep_length", ctypes.c_size_t),
    )


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    # Built by itself, or for the tests in Rust.
    places = [profile + deps for profile in ("release", "checked", "debug") for deps in ("", "/deps")]
    found = [target / place / "libsgpr.so" for place in places]
    built = [path for path in found if path.exists()]
    if not built:
        pytest.skip(f"the C library is not built in {target}: cargo build --package sgpr-c")
    library = ctypes.CDLL(str(max(built, key=lambda path: path.stat().st_mtime)))
    library.sgpr_last_error.restype = ctypes.c_char_p
    return library


@pytest.fixture(scope="module")
def logs() -> list[sgpr.Recording]:
    return [sgpr.read(ROOT / "data" / "demo" / f"{name}.csv.gz") for name in ("train_1", "test")]


@pytest.fixture(scope="module")
def robot() -> sgpr.Robot:
    return sgpr.Robot.from_urdf(ROOT / "data" / "demo" / "robot.urdf")


def torques(library: ctypes.CDLL, path: Path, motion: np.ndarray, *, deviation: bool, keep: str = "") -> np.ndarray:
    """Torques of a model file over a motion, (samples, 3, n), and if asked for, deviations and novelties behind."""

    def call(function: str, *arguments: object) -> None:
        assert getattr(library, function)(*arguments) == 0, library.sgpr_last_error()

    model, predictor = ctypes.c_void_p(), ctypes.c_void_p()
    names = (ctypes.c_char_p * 1)(keep.encode())
    options = Options(RATE_HZ, 0, int(deviation), names, 1 if keep else 0)
    call("sgpr_model_load", str(path).encode(), ctypes.byref(model))
    call("sgpr_predictor_new_with", model, ctypes.byref(options), ctypes.byref(predictor))
    n = motion.shape[2]
    out = np.zeros((len(motion), 3 if deviation else 1, n))
    for row, (q, dq, ddq) in zip(out, motion, strict=True):
        arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in (q, dq, ddq, row[0])]
        call("sgpr_predictor_torque", predictor, *arrays, ctypes.c_size_t(n))
        for function, to in zip(("sgpr_predictor_deviation", "sgpr_predictor_novelty"), row[1:], strict=False):
            call(function, predictor, to.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(n))
    library.sgpr_predictor_free(predictor)
    library.sgpr_model_free(model)
    return out


def motion_of(log: sgpr.Recording) -> np.ndarray:
    """(samples, 3, n): position, velocity, and the difference of velocities."""
    acceleration = np.gradient(log.dq, 1.0 / RATE_HZ, axis=0)
    return np.ascontiguousarray(np.stack([log.q, log.dq, acceleration], axis=1)[:2000])


@pytest.mark.parametrize("keep", ["", "torque_delay"])
def test_an_identified_model(
    library: ctypes.CDLL, robot: sgpr.Robot, logs: list[sgpr.Recording], tmp_path: Path, keep: str
) -> None:
    model = sgpr.identify(robot, logs[:1], effects=EFFECTS)
    model.save(tmp_path / "model.sgpr")
    motion = motion_of(logs[1])
    predictor = model.predictor(rate_hz=RATE_HZ, purpose="feed_forward", keep=[keep] if keep else None)
    wanted = np.array([predictor.torque(*sample) for sample in motion])
    found = torques(library, tmp_path / "model.sgpr", motion, deviation=False, keep=keep)
    np.testing.assert_array_equal(found[:, 0], wanted)


def test_a_learned_model(library: ctypes.CDLL, robot: sgpr.Robot, logs: list[sgpr.Recording], tmp_path: Path) -> None:
    model = sgpr.SemiParametricModel(robot, inputs="own_joint", points=60, max_evaluations=5).fit(logs[:1])
    model.save(tmp_path / "model.sgpr")
    motion = motion_of(logs[1])[::10]
    mean = model.predictor(variance_rank=0, rate_hz=RATE_HZ, purpose="feed_forward")
    sure = model.predictor(variance_rank=None, rate_hz=RATE_HZ, purpose="feed_forward")
    found = torques(library, tmp_path / "model.sgpr", motion, deviation=False)
    np.testing.assert_array_equal(found[:, 0], np.array([mean.torque(*sample) for sample in motion]))
    wanted = np.array([[*sure.torque_and_std(*sample), sure.novelty] for sample in motion])
    found = torques(library, tmp_path / "model.sgpr", motion, deviation=True)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-7)
    assert np.ptp(found[:, 2]) > 0.0
