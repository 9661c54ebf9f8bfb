"""How the held-out error falls, effect by effect."""

from collections.abc import Mapping, Sequence
from typing import Any

from .colours import line_of
from .figures import axis, layout, rounded
from .markup import Html, join, paragraph, plot, table
from .numbers import significant

PLOT = "steps-plot"


def steps_section(steps: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> tuple[Html, dict[str, Any]]:
    """Table and plot of the errors on blocks of time that were left out, after each effect.

    - `units`: unit of the torque by joint
    """
    if len(steps) < 2:
        return paragraph("No effect was added."), {}
    names = list(steps[0]["rmse"])
    labels = ["the model", *(f"+ {step['effect']} {', '.join(step['joints'])}".strip() for step in steps[1:])]
    note = paragraph(
        "Root mean square error on blocks of time that were left out of the fit, in the training logs. Effects are "
        "added one after the other and all parameters are refitted each time; an effect that later ones make "
        "superfluous is taken out again and does not appear."
    )
    rows = [[name, units[name], *(significant(step["rmse"][name]) for step in steps)] for name in names]
    body = [
        note,
        plot(PLOT, 380, "Held-out error of each joint after each effect, relative to the model's"),
        table("Held-out error", ["joint", "unit", *labels], rows, text_columns=(0, 1)),
    ]
    lines = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": name,
            "x": labels,
            "y": rounded([100.0 * step["rmse"][name] / max(steps[0]["rmse"][name], 1e-12) for step in steps]),
            "line": line_of(index),
        }
        for index, name in enumerate(names)
    ]
    figure = {
        "data": lines,
        "layout": layout(
            xaxis=axis("", range=[-0.3, len(labels) - 0.7]),
            yaxis=axis("held-out error [% of before]", rangemode="tozero"),
        ),
    }
    return join(body), {PLOT: figure}
