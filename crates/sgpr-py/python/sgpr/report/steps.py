"""How the held-out error falls, effect by effect."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from .colours import line_of
from .figures import axis, layout, plain, rounded
from .markup import Html, join, paragraph, plot, table
from .numbers import significant

PLOT = "steps-plot"
FRAME = 110
BAR_HEIGHT = 12
GAP = 24
LABEL_WIDTH = 20
"""Characters of a line beside the bars; the plot is to have room beside it on a telephone."""


def steps_section(steps: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> tuple[Html, dict[str, Any]]:
    """Table and plot of the errors on blocks of time that were left out, after each effect.

    - `units`: unit of the torque by joint
    """
    shown = steps_at_once(steps)
    if len(shown) < 2:
        return paragraph("No effect was added."), {}
    labels = [label for label, _ in shown]
    errors = [found for _, found in shown]
    names = list(errors[0])
    note = paragraph(
        "Root mean square error on blocks of time that were left out of the fit, in the training logs. All "
        "parameters are refitted after each step; an effect that later ones make superfluous is taken out again and "
        "does not appear."
    )
    rows = [[name, units[name], *(significant(found[name]) for found in errors)] for name in names]
    height = FRAME + len(shown) * (GAP + BAR_HEIGHT * max(len(names), 3))
    body = [
        note,
        plot(PLOT, height, "Held-out error of each joint after each effect, relative to the model's"),
        table("Held-out error", ["joint", "unit", *labels], rows, text_columns=(0, 1)),
    ]
    bars = [
        {
            "type": "bar",
            "name": name,
            "orientation": "h",
            "x": rounded([100.0 * found[name] / max(errors[0][name], 1e-12) for found in errors]),
            "y": [folded(label) for label in labels],
            "marker": {"color": line_of(index)["color"]},
            "hovertemplate": "%{x:.3g} %",
        }
        for index, name in enumerate(names)
    ]
    figure = {
        "data": bars,
        "layout": layout(
            barmode="group",
            xaxis=axis("error [% of before]", rangemode="tozero"),
            yaxis=axis("", type="category", autorange="reversed"),
            legend={**layout()["legend"], "traceorder": "normal"},
            showlegend=True,
        ),
    }
    return join(body), {PLOT: figure}


def folded(label: str) -> str:
    """A label in lines of some twenty characters, broken at blanks and behind underscores, as Plotly wants it."""
    lines = [""]
    for word in re.findall(r"[^ _]*(?: |_|$)", label):
        if lines[-1] and len(lines[-1] + word.rstrip()) > LABEL_WIDTH:
            lines.append("")
        lines[-1] += word
    return "<br>".join(plain(line.rstrip()) for line in lines)


def steps_at_once(steps: Sequence[Mapping[str, Any]]) -> list[tuple[str, Mapping[str, float]]]:
    """What was added and the error of each joint then; an effect at several joints that came at once is one step."""
    found: list[tuple[str, Mapping[str, float]]] = []
    effect = None
    for number, step in enumerate(steps):
        joints = ", ".join(step["joints"])
        if found and step["effect"] == effect and step["rmse"] == found[-1][1]:
            found[-1] = (f"{found[-1][0]}, {joints}", step["rmse"])
        else:
            found.append(("the model" if number == 0 else f"+ {step['effect']} {joints}".strip(), step["rmse"]))
        effect = step["effect"]
    return found
