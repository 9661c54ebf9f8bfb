"""What the tests share: bundled data, reference robots, and recordings that follow formulas."""

import importlib
import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import sgpr

# A shell that starts the tests in its background lets them, and all that they start, ignore interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

DATA = Path(__file__).parents[3] / "data"
REFERENCE_ROBOTS = [
    "two_link",
    "puma560",
    "puma560_thesis_com4",
    "stanford_like",
    "panda_like",
    "ur5e_like",
    "scara",
    "gripper_tree",
]


def example(name: str) -> ModuleType:
    """One of the examples of the repository, which import each other."""
    folder = str(Path(__file__).parents[3] / "examples")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(folder)


def outside(name: str) -> Path:
    """The folder `name`, such as `real/emps`, of data that are not part of the repository: below the one that SGPR_DATA
    names, or, for the robots, in it. The test is skipped without."""
    folder = os.environ.get("SGPR_DATA")
    if not folder:
        pytest.skip(f"SGPR_DATA does not name the folder that holds {name} (docs/real-data.md)")
    places = [Path(folder) / name, Path(folder) / name.removeprefix("real/")]
    found = next((place for place in places if place.is_dir()), None)
    if found is None:
        pytest.skip(f"there is no {name} in {folder} (docs/real-data.md)")
    return found


class Reference:
    """A robot with values that independent codes agree on (`data/README.md`)."""

    def __init__(self, name: str) -> None:
        self.info: dict[str, Any] = json.loads((DATA / "reference" / f"{name}.json").read_text())
        with np.load(DATA / "reference" / f"{name}.npz") as arrays:
            self.arrays = dict(arrays)
        self.q, self.dq, self.ddq = (self.arrays[key] for key in ("q", "dq", "ddq"))
        self.robot = sgpr.Robot.from_urdf(
            DATA / "reference" / "urdf" / self.info["urdf"],
            joints=self.info["joint_names"],
            gravity=self.info["gravity"],
        )

    def __getitem__(self, key: str) -> np.ndarray:
        return self.arrays[key]


@pytest.fixture(autouse=True)
def effects_of_a_test_end_with_it(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What one test registers no other finds, whatever their order."""
    made: list[sgpr.Effect] = []
    register = sgpr.register_effect

    def registering(effect: sgpr.Effect) -> None:
        made.append(effect)
        register(effect)

    monkeypatch.setattr(sgpr, "register_effect", registering)
    yield
    for effect in made:
        sgpr.unregister_effect(effect)


@pytest.fixture(scope="session", params=REFERENCE_ROBOTS)
def reference(request: pytest.FixtureRequest) -> Reference:
    return Reference(request.param)


@pytest.fixture(scope="session")
def data() -> Path:
    return DATA


@pytest.fixture(scope="session")
def demo_robot() -> sgpr.Robot:
    return sgpr.Robot.from_urdf(DATA / "demo" / "robot.urdf")


@pytest.fixture(scope="session")
def demo_logs() -> list[sgpr.Recording]:
    return [sgpr.read(DATA / "demo" / f"train_{number}.csv.gz") for number in (1, 2, 3)]


@pytest.fixture(scope="session")
def demo_test() -> sgpr.Recording:
    return sgpr.read(DATA / "demo" / "test.csv.gz")


@pytest.fixture(scope="session")
def demo_model(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> sgpr.Model:
    return sgpr.identify(demo_robot, demo_logs)


@pytest.fixture
def log() -> sgpr.Recording:
    """Three joints, 50 samples, times of a real clock."""
    time = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(50)
    t = (time - time[0])[:, None] * 1e-9
    joint = np.arange(3)
    q, dq, tau = np.sin(t + joint), np.cos(t + joint), 10 * (joint + 1) - t
    return sgpr.Recording(time, q, dq, tau, joint_names=["shoulder", "elbow", "wrist"], source="formulas")


def assert_same(a: sgpr.Recording, b: sgpr.Recording) -> None:
    """The same numbers, to the bit."""
    assert a.joint_names == b.joint_names
    assert np.array_equal(a.time_ns, b.time_ns)
    assert np.array_equal(a.q, b.q)
    for one, other in ((a.dq, b.dq), (a.tau, b.tau)):
        assert (one is None) == (other is None)
        assert one is None or other is None or np.array_equal(one, other, equal_nan=True)
