"""What to record next: the motion that would tell effects apart."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import Recording
from .colours import line_of
from .figures import axis, layout, rounded
from .markup import Html, element, items, join, paragraph, plot, prose

PLOT = "next-motion"
SHOWN_SAMPLES = 1500


def separation(experiment: Mapping[str, Any]) -> str:
    """What an experiment is expected to tell: the log of the Bayes factor between its effects."""
    return f"{experiment['separation_now']:z.0f} now, {experiment['separation_expected']:z.0f} expected"


def experiment_section(
    experiments: Sequence[Mapping[str, Any]], motion: Recording | None, units: Sequence[str], file: str | None
) -> tuple[Html, dict[str, Any]]:
    """Sentences and the motion.

    - `experiments`: as in diagnosis.json
    - `motion`: all of them in a row
    - `units`: of the joints' positions
    - `file`: where the motion was written
    """
    if not experiments or motion is None:
        return Html(""), {}
    sentences = [
        prose(
            f"`{one['about'][0]}` or {', '.join(f'`{name}`' for name in one['about'][1:])}: {one['experiment']} "
            f"({one['seconds']:.0f} s). Log of the Bayes factor between them: {separation(one)}."
        )
        for one in experiments
    ]
    where = f"The motion is in `{file}`, 100 samples per second. " if file else ""
    warning = (
        f"{where}It stays within positions, speeds and accelerations that the logs show, and starts and ends at rest "
        "at a pose of the logs. A joint that moves alone takes the arm to new poses all the same: look for collisions "
        "first."
    )
    time = motion.t
    keep = np.unique(np.linspace(0, len(time) - 1, min(SHOWN_SAMPLES, len(time))).astype(int))
    lines = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": joint,
            "x": rounded(time[keep]),
            "y": rounded(motion.q[keep, k]),
            "line": line_of(k) | {"width": 1.5},
        }
        for k, joint in enumerate(motion.joint_names)
    ]
    unit = " or ".join(dict.fromkeys(units))
    figure = {
        "data": lines,
        "layout": layout(xaxis=axis("time [s]"), yaxis=axis(f"position [{unit}]"), showlegend=True),
    }
    body = [
        element("h3", "What to record next"),
        items(sentences),
        paragraph(prose(warning)),
        plot(PLOT, 300, "Positions of the motion to record next over time"),
    ]
    return join(body), {PLOT: figure}
