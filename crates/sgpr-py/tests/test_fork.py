"""Processes that are forked from one that has used the library compute, too: no thread of the pool is there in them."""

import multiprocessing
import os
from collections.abc import Callable

import numpy as np
import pytest
import sgpr

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork"),
    # Python 3.12 and later warn of a fork beside threads, which is what is tested.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

PATIENCE_S = 300
"""A child that waits for threads which are not there waits for ever; one that computes is there much earlier."""


def learned() -> np.ndarray:
    """The mean of a process that is learned on two threads."""
    x = np.linspace(0.0, 6.0, 400)[:, None]
    process = sgpr.GaussianProcess(n_jobs=2, max_evaluations=5, random_state=1)
    return process.fit(x, np.sin(x[:, 0])).predict(x[::40])


def inspected() -> list[str]:
    """What the errors of a log depend on: joints are looked at in parallel."""
    robot = sgpr.robots.two_link()
    t = np.arange(0.0, 10.0, 0.01)
    q = np.column_stack([np.sin(2.0 * t), np.cos(3.0 * t)])
    dq = np.column_stack([2.0 * np.cos(2.0 * t), -3.0 * np.sin(3.0 * t)])
    ddq = np.column_stack([-4.0 * np.sin(2.0 * t), -9.0 * np.cos(3.0 * t)])
    tau = robot.inverse_dynamics(q, dq, ddq) + np.tanh(20.0 * dq)
    log = sgpr.Recording(t, q, tau=tau, joint_names=robot.joint_names)
    model = sgpr.identify(robot, [log], effects=["viscous_friction"])
    return [str(found) for found in sgpr.residual_structure(model, sgpr.compare(model, [log]))]


def _send(work: Callable[[], object], end: object) -> None:
    end.send(work())  # type: ignore[attr-defined]


@pytest.mark.parametrize("work", [learned, inspected])
def test_a_forked_process_computes_what_its_parent_does(work: Callable[[], object]) -> None:
    expected = work()
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    child = context.Process(target=_send, args=(work, there))
    child.start()
    try:
        assert here.poll(PATIENCE_S), "the child waits for threads that it does not have"
        found = here.recv()
    finally:
        child.kill()
        child.join()
    if isinstance(expected, np.ndarray):
        # Sums over another number of threads differ by rounding.
        np.testing.assert_allclose(found, expected, atol=1e-6)
    else:
        assert found == expected


def test_a_pool_of_forked_processes_works() -> None:
    learned()
    with multiprocessing.get_context("fork").Pool(2) as pool:
        results = [pool.apply_async(learned) for _ in range(3)]
        for result in results:
            assert result.get(PATIENCE_S).shape == (10,)
