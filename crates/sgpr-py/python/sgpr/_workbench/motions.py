"""The next experiment of a diagnosis: the motion that tells its findings apart, as a plot and as a file."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import Diagnosis, Robot
from ..report.experiment import PLOT, experiment_section
from ..report.figures import plain


@dataclass(frozen=True)
class NextMotion:
    """A motion to be recorded.

    - `figure`: positions over time, for Plotly; `table`: time, position, speed and acceleration, 100 per second
    """

    figure: dict[str, Any]
    table: str


def next_motion(diagnosis: Diagnosis, robot: Robot) -> NextMotion | None:
    """The motion, if findings could be mistaken for each other."""
    motion = diagnosis.next_motion
    experiments = diagnosis.to_dict()["next_experiment"]
    if motion is None or not experiments:
        return None
    _, figures = experiment_section(experiments, motion, robot.position_units, None)
    for line in figures[PLOT]["data"]:
        line["name"] = plain(line["name"])
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "next_experiment.csv"
        diagnosis.save_next_motion(path)
        return NextMotion(figures[PLOT], path.read_text(encoding="utf-8"))
