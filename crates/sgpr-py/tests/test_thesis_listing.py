"""The base parameters that the thesis lists (appendix A-1-1), entry by entry, against ours.

S. Krishnamoorthi, Model-Based Compensation for Serial Manipulators through Semi-Parametric Gaussian Process Regression,
TU Delft (2018). Its link frames are those of the standard Denavit-Hartenberg convention, at the far end of each link;
ours are at the joint. The pseudo-inertia of a body moves from one to the other by a congruence.
"""

import re

import numpy as np
import pytest
import sgpr

LETTERS = ["M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ"]

# alpha, a, d of the listing of section A-2, which prints d3 with the sign that agrees with the entries.
PUMA = [
    (np.pi / 2, 0.0, 0.0),
    (0.0, 0.4318, 0.0),
    (-np.pi / 2, 0.0203, 0.15005),
    (np.pi / 2, 0.0, 0.4318),
    (-np.pi / 2, 0.0, 0.0),
    (0.0, 0.0, 0.0),
]

LISTED = [
    "YY1 + YY2 + ZZ3 - 0.3MY3 - 0.18M2 - 0.16M3 - 0.16M4 - 0.16M5 - 0.16M6",
    "XX2 - YY2 + 0.18M2 + 0.18M3 + 0.18M4 + 0.18M5 + 0.18M6",
    "XY2",
    "XZ2 - 0.43MZ2 + 0.43MY3 - 0.06M3 - 0.06M4 - 0.06M5 - 0.06M6",
    "YZ2",
    "ZZ2 - 0.18M2 - 0.18M3 - 0.18M4 - 0.18M5 - 0.18M6",
    "MX2 + 0.43M2 + 0.43M3 + 0.43M4 + 0.43M5 + 0.43M6",
    "MY2",
    "XY3 - 0.02MY3",
    "XZ3",
    "YY3 + ZZ4 + 0.86MY4 - 0.0004M3 + 0.18M4 + 0.18M5 + 0.18M6",
    "YZ3",
    "MX3 + 0.02M3 + 0.02M4 + 0.02M5 + 0.2M6",
    "MZ3 + MY4 + 0.43M4 + 0.43M5 + 0.43M6",
    "XX4 - ZZ4 + ZZ5",
    "XY4",
    "XZ4",
    "YY4 + ZZ5",
    "YZ4",
    "MX4",
    "MZ4 - MY5",
    "XX5 - ZZ5 + YY6",
    "XY5",
    "XZ5",
    "YY5 + YY6",
    "YZ5",
    "MX5",
    "MZ5 + MZ6",
    "XX6 - YY6",
    "XY6",
    "XZ6",
    "YZ6",
    "ZZ6",
    "MX6",
    "MY6",
]

# The 36th, which the thesis leaves out although it counts 36.
MISSING = "XX3 - ZZ3 + ZZ4 + 0.8636MY4 + 0.0004121M3 + 0.1869M4 + 0.1869M5 + 0.1869M6"

# Printed 0.2; it is 0.02.
MISPRINTED = {"MX3": "M6"}

# Printed with the digits cut off, not rounded: 0.18 for 0.1865 and 0.186.
CUT = 0.0099


def entry(text: str) -> np.ndarray:
    """A formula as factors on the 60 parameters."""
    factors = np.zeros(60)
    for sign, factor, letter, link in re.findall(r"([+-]?)\s*([\d.]*)\s*(M[XYZ]?|[XYZ]{2})(\d)", text):
        factors[place(letter + link)] = (-1.0 if sign == "-" else 1.0) * (float(factor) if factor else 1.0)
    return factors


def place(name: str) -> int:
    return 10 * (int(name[-1]) - 1) + LETTERS.index(name[:-1])


def moved(pose: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Parameters of a body in the frame in which its own frame has a pose."""
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = parameters
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pseudo = np.zeros((4, 4))
    pseudo[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    pseudo[:3, 3] = pseudo[3, :3] = mx, my, mz
    pseudo[3, 3] = m
    pseudo = pose @ pseudo @ pose.T
    inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    inertias = [inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *inertias])


def far_end(alpha: float, a: float, d: float) -> np.ndarray:
    """Pose of the frame at the far end of a link in that of its joint: along z by d, along x by a, about x by alpha."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, d], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def ours() -> np.ndarray:
    """Our base parameters of the PUMA in the thesis's frames, solved for the parameters that its entries begin with."""
    base = sgpr.robots.puma560().base_parameters(recursion=True)
    assert base.rank == 36
    to_joint = np.zeros((60, 60))
    for link, row in enumerate(PUMA):
        for k in range(10):
            to_joint[10 * link : 10 * link + 10, 10 * link + k] = moved(far_end(*row), np.eye(10)[k])
    combinations = base.matrix @ to_joint
    kept = [place(text.split()[0]) for text in [*LISTED, MISSING]]
    return np.linalg.solve(combinations[:, kept], combinations)


def test_the_thesis_counts_36_and_lists_35(ours: np.ndarray) -> None:
    assert len(LISTED) == 35
    assert np.abs(entry(MISSING) - ours[35]).max() < 6e-5
    # Without it the entries do not span what motion tells: no combination of the others gives it.
    nearest = np.linalg.lstsq(ours[:35].T, ours[35], rcond=None)[0]
    assert np.abs(ours[:35].T @ nearest - ours[35]).max() > 0.1


@pytest.mark.parametrize("index", range(35), ids=[text.split()[0] for text in LISTED])
def test_each_entry_is_ours_to_the_digits_printed(index: int, ours: np.ndarray) -> None:
    text = LISTED[index]
    difference = entry(text) - ours[index]
    wrong = MISPRINTED.get(text.split()[0])
    if wrong is not None:
        assert abs(difference[place(wrong)] - (0.2 - 0.0203)) < 1e-9
        difference[place(wrong)] = 0.0
    assert np.abs(difference).max() < CUT
    # No factor has another sign, and none is left out or made up.
    printed = entry(text)
    assert (np.sign(printed) == np.sign(np.where(np.abs(ours[index]) < 1e-9, 0.0, ours[index]))).all()


def test_factors_without_a_mass_are_exact(ours: np.ndarray) -> None:
    for text, row in zip(LISTED, ours, strict=False):
        if "." not in text:
            assert np.abs(entry(text) - row).max() < 1e-9, text


def test_the_two_link_arm_has_four_or_six() -> None:
    links = [{"a": 1.0, "alpha": 0.0, "d": 0.0, "theta": 0.0}] * 2
    for gravity, count in (((0.0, 0.0, -9.81), 4), ((0.0, -9.81, 0.0), 6)):
        robot = sgpr.Robot.from_dh(links, convention="standard", gravity=gravity)
        assert robot.base_parameters().rank == robot.base_parameters(recursion=True).rank == count
