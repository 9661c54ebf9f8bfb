"""`sgpr data`: public logs of real robots, by name."""

import re
from pathlib import Path
from typing import Annotated

import typer

from .. import datasets
from ..datasets._fetch import about
from .console import Output
from .errors import one_of


def list_(output: Output) -> None:
    """Lists the public data sets that `sgpr data get` downloads."""
    known = [datasets.describe(name) for name in datasets.names()]
    output.table(
        ["name", "robot", "MB", "licence"],
        [[each.name, each.robot, f"{each.size / 1e6:.1f}", re.split("[,;]", each.licence)[0]] for each in known],
        text_columns=(0, 1, 3),
        spare=("licence", "MB"),
    )
    output.next("sgpr", "data", "get", "emps", why="downloads one")
    output.result([about(each) for each in known])


def get(
    output: Output,
    name: Annotated[str, typer.Argument(metavar="NAME", help="The data set; `sgpr data list` lists all.")],
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Folder for the logs.", show_default="one called NAME"),
    ] = None,
) -> None:
    """Downloads public logs of a robot, checks them, and converts them to logs that sgpr reads.

    Writes to DIR: the logs as CSV, the robot file, sgpr.toml (how the logs are read) and dataset.json (whose they are).
    Needs what pip installs with the extra "datasets".
    """
    one_of(name, datasets.names(), "NAME", "data set")
    with output.progress() as progress:
        found = datasets.fetch(name, name if out is None else out, progress=progress)
    dataset = found.dataset
    output.heading(dataset.robot)
    output.line(f"torque: {dataset.torque}")
    output.line(f"licence: {dataset.licence}")
    output.line(f"cite: {dataset.citation}")
    output.line(dataset.physics)
    if dataset.published:
        output.line(f"published: {dataset.published}")
    if dataset.unseen_percent is not None:
        output.line(f"expected: {dataset.unseen_percent} % of the torque unexplained on the test logs")
    if dataset.expected:
        output.line(f"expected: {dataset.expected}")
    for log in dataset.logs:
        output.line(f"  {found.folder / log.file}  {log.role}{f': {log.what}' if log.what else ''}")
    if found.robot_file:
        output.next(*identify_command(found))
    if dataset.program:
        output.line(f"next, in Python:\n{dataset.program.strip()}")
    output.result(about(dataset) | {"folder": str(found.folder)})


def identify_command(found: datasets.Fetched) -> list[str]:
    """The command whose error on the test logs is the one that the data set states."""
    train, test = ([str(path) for path in found.paths(role)] for role in ("train", "test"))
    return [
        "sgpr", "identify", "--robot", str(found.robot_file), "--train", *train, "--test", *test,
        "--effects", *found.dataset.effects, "--out", str(Path("out") / found.dataset.name),
    ]  # fmt: skip
