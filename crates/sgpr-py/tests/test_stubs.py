"""Types and documentation are those of the compiled module."""

import doctest
import inspect
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from conftest import DATA
from sgpr import _sgpr


def test_stubs_fit_the_module() -> None:
    command = [sys.executable, "-m", "mypy.stubtest", "sgpr._sgpr"]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1])
    assert result.returncode == 0, result.stdout


def test_everything_is_exported() -> None:
    robots = {"puma560", "puma560_drives", "two_link", "two_link_drives"}
    # What the estimators and the readers of arrays are built on.
    within = {"FittedProcess", "FittedSemiParametric", "fit_process", "fit_semi_parametric", "restore_process"}
    within |= {"Pieces", "format_of", "formats", "quantity_of_array", "read_columns", "read_log", "read_parquet_pieces"}
    assert set(_sgpr.__all__) - robots - within <= set(sgpr.__all__)
    assert set(sgpr.robots.__all__) == robots
    assert all(hasattr(sgpr, name) for name in sgpr.__all__)
    assert list(sgpr.__all__) == sorted(sgpr.__all__)
    assert (Path(sgpr.__file__).parent / "py.typed").exists()


def documented() -> Iterator[tuple[str, Any]]:
    """Everything public, with its name."""
    yield "sgpr", sgpr
    for name in (*sgpr.__all__, *(f"robots.{robot}" for robot in sgpr.robots.__all__)):
        thing = sgpr.robots if name == "robots" else eval(f"sgpr.{name}")
        if name == "__version__":
            continue
        yield name, thing
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member in sorted(vars(thing)):
                if not member.startswith("_"):
                    yield f"{name}.{member}", getattr(thing, member)


THINGS = dict(documented())
EXAMPLES = [name for name, thing in THINGS.items() if ">>>" in (thing.__doc__ or "")]


@pytest.mark.parametrize("name", THINGS)
def test_everything_has_documentation(name: str) -> None:
    assert (THINGS[name].__doc__ or "").strip()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that the examples speak of."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copy(DATA / "demo" / "robot.urdf", folder)
    shutil.copy(DATA / "demo" / "train_1.csv.gz", folder / "train.csv.gz")
    sgpr.read(folder / "train.csv.gz").save(folder / "train.mcap")
    return folder


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    text = inspect.cleandoc(THINGS[name].__doc__)
    example = doctest.DocTestParser().get_doctest(text, {"np": np, "sgpr": sgpr}, name, None, 0)
    output: list[str] = []
    failed = doctest.DocTestRunner(verbose=False).run(example, out=output.append)
    assert failed.failed == 0, "".join(output)


def test_every_verb_has_an_example() -> None:
    verbs = [name for name in sgpr.__all__ if inspect.isroutine(THINGS.get(name))]
    assert len(verbs) >= 8
    assert set(verbs) <= set(EXAMPLES)
