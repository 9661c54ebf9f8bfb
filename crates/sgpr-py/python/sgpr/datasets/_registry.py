"""The data sets by name: a module of this folder for each."""

import difflib
from importlib import import_module

from ._dataset import Dataset, DatasetError

NAMES = (
    "baxter",
    "emps",
    "kuka_lwr",
    "panda",
    "panda_30hz",
    "sarcos",
    "tiago",
    "tx40",
    "ur10",
    "ur10e",
    "xmate7p",
)


def names() -> list[str]:
    """The names that `fetch` takes."""
    return list(NAMES)


def describe(name: str) -> Dataset:
    """What is known of a data set: robot, origin, licence, citation, physics, figures. Downloads nothing.

    Raises `DatasetError` if there is none of this name.
    """
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=1)
        hint = f", did you mean {near[0]}?" if near else "."
        raise DatasetError(f"there is no data set `{name}`{hint} Known are {', '.join(NAMES)}.")
    dataset: Dataset = import_module(f".{name}", __package__).DATASET
    return dataset
