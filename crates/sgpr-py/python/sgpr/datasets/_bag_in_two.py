"""ROS 2 bags with one motion, cut in time into a log for training and one for the test."""

from collections.abc import Callable, Mapping
from pathlib import Path

from ..reading import read
from ._dataset import DatasetError
from ._tables import Table, joints, part


def converted(file: str) -> Callable[[Mapping[str, Path]], dict[str, Table]]:
    """The first two thirds train, the last third tests."""

    def convert(sources: Mapping[str, Path]) -> dict[str, Table]:
        log = read(sources[file])
        if log.tau is None:
            raise DatasetError(f"{file}: no torque in this bag")
        table = {"t_s": log.t} | joints("q", "rad", log.q) | joints("tau", "Nm", log.tau)
        cut = 2 * len(log.t) // 3
        return {"train.csv": part(table, 0, cut), "test.csv": part(table, cut)}

    return convert
