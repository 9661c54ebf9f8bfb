"""What the files of results have in common: one word for one thing, and one version for all (results.schema.json)."""

from collections.abc import Sequence
from typing import Any

from .. import Comparison, Robot, __version__
from ..report.versions import versions
from . import describe
from .predictions import AFTER, BEFORE
from .reading import Log

SCHEMA = 2
"""Grows when a key goes away or means something else."""


def headed(command: str, robot: Robot | None = None, **own: Any) -> dict[str, Any]:
    """The figures of a command, with what made them."""
    named = {} if robot is None else {"robot": {"name": robot.name, "joints": robot.joint_names}}
    return {
        "command": command,
        **named,
        **own,
        "schema": SCHEMA,
        "versions": versions(),
        "library_version": __version__,
    }


def judged(
    command: str,
    robot: Robot,
    before: Comparison,
    after: Comparison,
    train: Sequence[Log],
    test: Sequence[Log],
    **own: Any,
) -> dict[str, Any]:
    """The figures of a command that makes a model, with errors before and after: on the test logs, if there are any."""
    return headed(
        command,
        robot,
        **own,
        comparison={
            "logs": "test" if test else "train",
            BEFORE: describe.comparison(before),
            AFTER: describe.comparison(after),
        },
        logs=[
            *(describe.repaired_log(log, "train") for log in train),
            *(describe.repaired_log(log, "test") for log in test),
        ],
        left_out_of_predictions={},
    )
