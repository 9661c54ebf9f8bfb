"""Dynamics against values that three independent codes agree on, and what comes of strange input."""

import gc
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
import sgpr
from conftest import Reference
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_st

TOLERANCE = 1e-12


def test_torques_agree(reference: Reference) -> None:
    robot, tolerance = reference.robot, TOLERANCE * reference.info["max_abs_tau"]
    q, dq, ddq = reference.q, reference.dq, reference.ddq
    assert np.abs(robot.inverse_dynamics(q, dq, ddq) - reference["tau"]).max() < tolerance
    assert np.abs(robot.bias_forces(q, dq) - reference["bias"]).max() < tolerance
    assert np.abs(robot.gravity_torque(q) - reference["gravity_torque"]).max() < tolerance


def test_mass_matrix_and_accelerations_agree(reference: Reference) -> None:
    robot, M = reference.robot, reference["mass_matrix"]
    assert np.abs(robot.mass_matrix(reference.q) - M).max() < TOLERANCE * np.abs(M).max()
    ddq = robot.forward_dynamics(reference.q, reference.dq, reference["tau_fd"])
    scale = np.maximum(1.0, np.abs(reference["qdd_fd"]).max(axis=1, keepdims=True))
    assert np.abs((ddq - reference["qdd_fd"]) / scale).max() < 2e-12


def test_regressor_agrees_and_multiplies_to_the_torque(reference: Reference) -> None:
    robot, expected = reference.robot, reference["regressor_joint"]
    Y = robot.regressor(reference.q, reference.dq, reference.ddq)
    assert Y.shape == (200, robot.dof, 10 * robot.dof)
    assert np.abs(Y - expected).max() < TOLERANCE * np.abs(expected).max()
    assert np.abs(Y @ robot.standard_parameters - reference["tau"]).max() < TOLERANCE * reference.info["max_abs_tau"]


def test_poses_and_energies_agree(reference: Reference) -> None:
    robot, q, dq = reference.robot, reference.q, reference.dq
    pose = robot.forward_kinematics(q, reference.info["tool_frame"])
    assert np.abs(pose - reference["tool_pose"]).max() < 1e-13
    assert np.allclose(robot.kinetic_energy(q, dq), reference["kinetic"], rtol=1e-12, atol=1e-12)
    assert np.allclose(robot.potential_energy(q), reference["potential"], rtol=1e-12, atol=1e-11)


def test_jacobian_is_the_derivative_of_the_pose(reference: Reference) -> None:
    robot, q, dq = reference.robot, reference.q[:20], reference.dq[:20]
    step = 1e-6
    velocity = np.einsum("sij,sj->si", robot.jacobian(q, reference.info["tool_frame"]), dq)
    ahead, behind = (robot.forward_kinematics(q + s * step * dq, reference.info["tool_frame"]) for s in (1, -1))
    assert np.allclose((ahead - behind)[:, :3, 3] / (2 * step), velocity[:, :3], atol=1e-7)
    turn = (
        (ahead - behind)[:, :3, :3]
        / (2 * step)
        @ np.swapaxes(robot.forward_kinematics(q, reference.info["tool_frame"])[:, :3, :3], 1, 2)
    )
    assert np.allclose(turn[:, [2, 0, 1], [1, 2, 0]], velocity[:, 3:], atol=1e-7)


def test_the_default_frame_is_the_tip() -> None:
    robot = sgpr.robots.puma560()
    q = np.linspace(-1, 1, 6)
    assert np.array_equal(robot.forward_kinematics(q), robot.forward_kinematics(q, "tool"))
    assert np.array_equal(robot.jacobian(q), robot.jacobian(q, "tool"))
    with pytest.raises(sgpr.RobotError, match="there is no frame `hand`; the robot has `tool`"):
        robot.forward_kinematics(q, "hand")


def calls(robot: sgpr.Robot) -> dict[str, tuple[Callable[..., np.ndarray], int, tuple[int, ...]]]:
    """Every method with its number of inputs and the shape of one result."""
    n = robot.dof
    return {
        "inverse_dynamics": (robot.inverse_dynamics, 3, (n,)),
        "forward_dynamics": (robot.forward_dynamics, 3, (n,)),
        "mass_matrix": (robot.mass_matrix, 1, (n, n)),
        "bias_forces": (robot.bias_forces, 2, (n,)),
        "gravity_torque": (robot.gravity_torque, 1, (n,)),
        "regressor": (robot.regressor, 3, (n, 10 * n)),
        "forward_kinematics": (robot.forward_kinematics, 1, (4, 4)),
        "jacobian": (robot.jacobian, 1, (6, n)),
        "kinetic_energy": (robot.kinetic_energy, 2, ()),
        "potential_energy": (robot.potential_energy, 1, ()),
    }


METHODS = list(calls(sgpr.robots.two_link()))


@pytest.mark.parametrize("method", METHODS)
def test_one_sample_many_samples_none(method: str) -> None:
    reference = Reference("ur5e_like")
    function, count, shape = calls(reference.robot)[method]
    arrays = [reference.q, reference.dq, reference.ddq][:count]
    many = function(*arrays)
    assert many.shape == (200, *shape)
    assert many.dtype == np.float64
    for k in (0, 3, 199):
        one = function(*(rows[k] for rows in arrays))
        assert np.shape(one) == shape
        assert np.array_equal(one, many[k])
    assert function(*(rows[:0] for rows in arrays)).shape == (0, *shape)
    # Any length, so that the last group of samples is filled in every way.
    for length in range(1, 18):
        assert np.array_equal(function(*(rows[:length] for rows in arrays)), many[:length])


@pytest.mark.parametrize("method", METHODS)
def test_input_of_any_layout(method: str) -> None:
    reference = Reference("scara")
    function, count, _ = calls(reference.robot)[method]
    arrays = [reference.q, reference.dq, reference.ddq][:count]
    expected = function(*arrays)
    wide = np.zeros((200, 2 * reference.robot.dof))
    big_endian, misaligned = [], []
    for rows in arrays:
        big_endian.append(rows.astype(">f8"))
        raw = np.zeros(rows.nbytes + 1, np.uint8)
        shifted = raw[1:].view(np.float64).reshape(rows.shape) if sys.byteorder == "little" else rows
        shifted[:] = rows
        misaligned.append(shifted)
    for given_arrays in (
        [np.asfortranarray(rows) for rows in arrays],
        [rows.tolist() for rows in arrays],
        [np.repeat(rows, 2, axis=0)[::2] for rows in arrays],
        big_endian,
        misaligned,
    ):
        assert np.array_equal(function(*given_arrays), expected)
    wide[:, ::2] = arrays[0]
    assert np.array_equal(function(wide[:, ::2], *arrays[1:]), expected)
    single = function(*(rows.astype(np.float32) for rows in arrays))
    assert np.array_equal(single, function(*(rows.astype(np.float32).astype(np.float64) for rows in arrays)))


def test_shapes_are_explained() -> None:
    robot = sgpr.robots.puma560()
    with pytest.raises(ValueError, match=r"q: got \(100, 7\), expected \(N, 6\), or \(6,\) for one sample"):
        robot.gravity_torque(np.zeros((100, 7)))
    with pytest.raises(ValueError, match=r"dq: got \(99, 6\), expected \(100, 6\) as q"):
        robot.bias_forces(np.zeros((100, 6)), np.zeros((99, 6)))
    with pytest.raises(ValueError, match=r"dq: got \(6,\), expected \(1, 6\) as q"):
        robot.bias_forces(np.zeros((1, 6)), np.zeros(6))
    with pytest.raises(ValueError, match=r"q: got \(\), expected"):
        robot.gravity_torque(1.0)
    with pytest.raises(ValueError, match=r"q: got \(2, 3, 6\), expected"):
        robot.gravity_torque(np.zeros((2, 3, 6)))


def test_what_is_no_number_is_refused_with_its_place() -> None:
    robot = sgpr.robots.puma560()
    dq = np.zeros((100, 6))
    dq[7, 2] = np.nan
    with pytest.raises(ValueError, match=r"dq\[7, 2\] is NaN"):
        robot.inverse_dynamics(np.zeros((100, 6)), dq, np.zeros((100, 6)))
    with pytest.raises(ValueError, match=r"q\[5\] is -inf"):
        robot.gravity_torque([0, 0, 0, 0, 0, -np.inf])
    for wrong in (["a"] * 6, [1j] * 6, [None] * 6, [True] * 6, np.zeros(6, "datetime64[s]")):
        with pytest.raises(ValueError, match=r"q: got values of type .*, expected an array of real numbers"):
            robot.gravity_torque(wrong)
    with pytest.raises(ValueError, match="q: expected an array of real numbers"):
        robot.gravity_torque([[1.0], [2.0, 3.0]])


@settings(max_examples=60, deadline=None)
@given(
    numpy_st.arrays(
        np.float64,
        numpy_st.array_shapes(min_dims=0, max_dims=3, max_side=7),
        elements=st.floats(allow_nan=True, allow_infinity=True),
    ),
    st.sampled_from(METHODS),
)
def test_no_array_makes_it_panic(array: np.ndarray, method: str) -> None:
    function, count, shape = calls(sgpr.robots.two_link())[method]
    try:
        result = function(*[array] * count)
    except sgpr.SgprError:
        return
    assert np.shape(result)[array.ndim - 1 :] == shape


def test_a_contiguous_array_is_not_copied() -> None:
    robot = sgpr.robots.puma560()
    q = np.zeros((200_000, 6))
    robot.gravity_torque(q[:10])
    tracemalloc.start()
    try:
        robot.forward_kinematics(q)
        _, contiguous = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        robot.forward_kinematics(np.asfortranarray(q))
        _, converted = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # numpy reports its arrays; what Rust makes and moves into the result is not seen.
    assert contiguous < 100_000
    assert converted > q.nbytes


def test_a_result_owns_its_memory() -> None:
    robot = sgpr.robots.two_link()
    first = robot.gravity_torque(np.zeros((1000, 2)))
    kept = first.copy()
    gc.collect()
    robot.gravity_torque(np.ones((1000, 2)))
    assert np.array_equal(first, kept)
    assert first.flags.writeable
    first[:] = 0


def test_memory_that_is_not_there_is_a_memory_error() -> None:
    robot = sgpr.robots.puma560()
    # 10^11 samples that are all the same take no memory; their regressor would take 288 TB.
    try:
        q = np.broadcast_to(np.zeros(6), (10**11, 6))
    except ValueError:
        pytest.skip("no such array on this machine")
    with pytest.raises(MemoryError):
        robot.regressor(q, q, q)


def test_python_goes_on_while_numbers_are_made() -> None:
    robot = sgpr.robots.puma560()
    q = np.random.default_rng(1).uniform(-1, 1, (60_000, 6))
    seen: list[float] = []
    stop = threading.Event()

    def count() -> None:
        while not stop.is_set():
            seen.append(time.perf_counter())
            time.sleep(1e-3)

    thread = threading.Thread(target=count)
    thread.start()
    start = time.perf_counter()
    robot.regressor(q, q, q)
    robot.mass_matrix(q)
    end = time.perf_counter()
    stop.set()
    thread.join()
    during = [t for t in seen if start + 0.1 * (end - start) < t < end - 0.1 * (end - start)]
    assert len(during) >= 3, f"{len(during)} steps in {end - start:.3f} s"


def test_threads_share_a_robot() -> None:
    reference = Reference("panda_like")
    results: list[np.ndarray] = [np.empty(0)] * 4

    def work(k: int) -> None:
        for _ in range(20):
            results[k] = reference.robot.inverse_dynamics(reference.q, reference.dq, reference.ddq)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(result, results[0]) for result in results)
