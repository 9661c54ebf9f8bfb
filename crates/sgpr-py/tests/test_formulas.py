"""Base parameters as formulas, read back and compared with the space that motion spans."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import sgpr
from conftest import DATA

LETTERS = ["M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ"]
URDFS = sorted((DATA / "reference" / "urdf").glob("*.urdf"))


def read_back(formula: str, width: int) -> np.ndarray:
    """Factors on the standard parameters, from the text alone."""
    left, equals, right = formula.partition(" = ")
    terms = right if equals else left
    assert not equals or left.endswith("R")
    factors = np.zeros(width)
    for sign, size, letters, link in re.findall(r"([+-]?)\s*([\d.]*)\s*\b(M[XYZ]?|[XYZ]{2})(\d+)\b", terms):
        factor = (float(size) if size else 1.0) * (-1.0 if sign == "-" else 1.0)
        factors[10 * (int(link) - 1) + LETTERS.index(letters)] += factor
    assert factors.any(), formula
    return factors


@pytest.mark.parametrize("path", URDFS, ids=[path.stem for path in URDFS])
def test_formulas_span_what_motion_tells(path: Path) -> None:
    robot = sgpr.Robot.from_urdf(path)
    random = np.random.default_rng(3)
    states = (random.uniform(-2.0, 2.0, (20 * robot.dof, robot.dof)) for _ in range(3))
    regressor = robot.regressor(*states).reshape(-1, 10 * robot.dof)
    _, values, right = np.linalg.svd(regressor)
    rank = int((values > 1e-7 * values[0]).sum())
    base = robot.base_parameters(recursion=True)
    rows = np.array([read_back(formula, 10 * robot.dof) for formula in base.formulas])
    assert len(rows) == rank == np.linalg.matrix_rank(rows)
    # No motion tells anything that the formulas do not: printed factors have six digits.
    unseen = right[rank:]
    assert np.abs(rows @ unseen.T).max() < 2e-5 * np.abs(rows).max()


def test_formulas_are_in_the_output_of_info(capsys: pytest.CaptureFixture[str]) -> None:
    from sgpr.cli import main

    with pytest.raises(SystemExit) as stop:
        main(["info", str(URDFS[0]), "--base-parameters", "--json"])
    assert not stop.value.code
    [data] = json.loads(capsys.readouterr().out)
    expected = sgpr.Robot.from_urdf(URDFS[0]).base_parameters(recursion=True).formulas
    assert [p["formula"] for p in data["base_parameters"]] == expected
