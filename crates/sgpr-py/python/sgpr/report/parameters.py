"""Parameters with their uncertainty."""

import math
from collections.abc import Sequence
from typing import Any

from .colours import AFTER, BEFORE
from .figures import axis, layout, rounded
from .markup import Cell, Html, element, join, legend, paragraph, plot, table
from .numbers import MEANINGLESS, MISSING, readable, relative_deviation, significant, with_deviation

PLOT = "certainty-plot"
LONG_EXPRESSION = 70
ROW_HEIGHT = 19
GOOD, POOR = 10.0, 100.0

WIDTH, HEIGHT, HALF = 180.0, 18.0, 82.0


def parameters_section(parameters: Sequence[dict[str, Any]], terms: Sequence[dict[str, Any]] = ()) -> Html:
    """The table, in which every row has its small plot; below it the effects at single sites."""
    columns = ["parameter", "value", "± std. dev.", "%", "nominal", "unit", "plot", "stands for"]
    rows = [_row(p) for p in parameters]
    return join(
        [
            paragraph(
                "Base parameters are the combinations of inertial parameters that the torque tells apart; friction and "
                "other effects count with them. The standard deviation follows from the noise of the fit. It does not "
                "know of errors that the model cannot express, so real errors can be larger. Terms with factors below "
                "10⁻⁶ are not shown."
            ),
            legend(
                [
                    ("○", BEFORE, "nominal, from the robot file"),
                    ("●", AFTER, "identified, with ± 2 standard deviations"),
                    ("│", "#888888", "zero; each row has a scale of its own"),
                ]
            ),
            table("Base parameters", columns, rows, text_columns=(0, 5, 6, 7)),
            *([_terms(terms)] if terms else []),
        ]
    )


def _terms(terms: Sequence[dict[str, Any]]) -> Html:
    rows = [[p["effect"], p["name"], *with_deviation(p["value"], p["standard_deviation"]), p["unit"]] for p in terms]
    columns = ["effect", "parameter", "value", "± std. dev.", "unit"]
    return table("Effects that follow the whole trajectory, or have constants", columns, rows, text_columns=(0, 1, 4))


def certainty_plot(parameters: Sequence[dict[str, Any]]) -> tuple[Html, dict[str, Any]]:
    """How well each parameter is determined: its relative standard deviation."""
    known = [p for p in parameters if p["determined"] is not None and not left_out(p)]
    if not known:
        return Html(""), {}
    names = [p["name"] for p in known]
    deviations = [
        abs(p["standard_deviation"] / p["value"]) * 100.0 if p["determined"] and p["value"] else math.inf for p in known
    ]
    finite = [d for d in deviations if 0.0 < d <= MEANINGLESS]
    right = max([2.0 * POOR, *(2.0 * d for d in finite)])
    colours = [AFTER if d <= GOOD else "#b58900" if d <= POOR else BEFORE for d in deviations]
    symbols = ["circle" if d <= GOOD else "diamond" if d <= POOR else "x" for d in deviations]
    text = ["not excited" if math.isinf(d) else f"{relative_deviation(d)} %" for d in deviations]
    data = {
        "type": "scatter",
        "mode": "markers",
        "x": rounded([d if d <= MEANINGLESS else right for d in deviations]),
        "y": names,
        "text": text,
        "marker": {"color": colours, "symbol": symbols, "size": 9},
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    line = {"type": "line", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    style = {"color": "#888888", "dash": "dot", "width": 1.5}
    figure = {
        "data": [data],
        "layout": layout(
            xaxis=axis("std. deviation [% of value]", type="log", dtick=1, side="top"),
            yaxis=axis("", range=[len(known) - 0.4, -0.6], type="category", dtick=1, tickfont={"size": 12}),
            shapes=[{**line, "x0": x, "x1": x, "line": style} for x in (GOOD, POOR)],
            margin={"l": 20, "r": 16, "t": 56, "b": 12},
            showlegend=False,
        ),
    }
    body = join(
        [
            legend(
                [
                    ("●", AFTER, f"well determined (below {GOOD:.0f} %)"),
                    ("◆", "#b58900", "uncertain"),
                    ("✕", BEFORE, "unknown: more than its own size; at the right edge far more, or not excited"),
                ]
            ),
            plot(PLOT, 90 + ROW_HEIGHT * len(known), "Relative standard deviation of each base parameter"),
        ]
    )
    return body, {PLOT: figure}


def left_out(p: dict[str, Any]) -> bool:
    """Whether the parameter is zero because the data do not support it."""
    return bool(p["standard_deviation"] == 0.0)


def _row(p: dict[str, Any]) -> list[object]:
    value, deviation = with_deviation(p["value"], p["standard_deviation"])
    relative: object = relative_deviation(p["relative_standard_deviation_percent"])
    style = "number"
    if left_out(p):
        value, deviation, relative = "0", "left out", MISSING
    elif p["determined"] is False:
        deviation, relative, style = "not excited", MISSING, "number bad"
    elif p["determined"] and (p["relative_standard_deviation_percent"] or 0.0) > POOR:
        relative = Cell(str(relative), "bad number")
    return [
        p["name"],
        Cell(value, "number"),
        Cell(deviation, style),
        relative,
        Cell(significant(p["nominal"], 4), "number"),
        Cell(p["unit"], "number"),
        _drawing(p),
        Cell(_expression(p["name"], readable(p["expression"])), "formula"),
    ]


def _expression(name: str, text: str) -> Html | str:
    if text == name:
        return "itself"
    if len(text) <= LONG_EXPRESSION:
        return text
    terms = text.count(" + ") + text.count(" - ") + 1
    return element("details", join([element("summary", f"{terms} terms"), text]))


def _drawing(p: dict[str, Any]) -> Html:
    """Zero in the middle; the larger of value, nominal and error bar at the edge."""
    value, nominal = p["value"], p["nominal"]
    spread = 2.0 * p["standard_deviation"] if p["determined"] else 0.0
    scale = max(abs(value) + spread, abs(nominal)) or 1.0

    def x(number: float) -> str:
        return f"{WIDTH / 2 + HALF * number / scale:.1f}"

    middle = HEIGHT / 2
    shapes = [f'<line x1="{WIDTH / 2}" x2="{WIDTH / 2}" y1="1" y2="{HEIGHT - 1}" stroke="#888888"/>']
    if spread:
        low, high = x(value - spread), x(value + spread)
        shapes.append(f'<path d="M{low} {middle}H{high}M{low} 5V13M{high} 5V13" stroke="{AFTER}" stroke-width="1.5"/>')
    shapes.append(f'<circle cx="{x(nominal)}" cy="{middle}" r="4.5" fill="none" stroke="{BEFORE}" stroke-width="1.5"/>')
    fill = "none" if p["determined"] is False else AFTER
    shapes.append(f'<circle cx="{x(value)}" cy="{middle}" r="3" fill="{fill}" stroke="{AFTER}"/>')
    label = f"{significant(value, 4)}, nominal {significant(nominal, 4)}"
    inner = "".join(shapes)
    return Html(f'<svg class="value" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{inner}</svg>')
