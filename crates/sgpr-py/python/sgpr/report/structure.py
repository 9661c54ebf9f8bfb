"""What a residual depends on: noise or structure, on which variables, since when."""

from collections.abc import Mapping, Sequence
from typing import Any

from .colours import AFTER, BEFORE, MEASURED
from .figures import axis, layout, rounded
from .markup import Cell, Html, items, join, paragraph, plot, table
from .numbers import MISSING, percent, significant

ROW_HEIGHT = 28
FRAME = 90
LEAST_HEIGHT = 200
"""In which a legend of three lines, as on a telephone, leaves the bars their place."""
SHARES = (
    ("state", "position, speed, acceleration, load", BEFORE),
    ("time", "time", AFTER),
    ("noise", "noise, or what was not looked at", MEASURED),
)


def structure_section(
    name: str, structure: Sequence[Mapping[str, Any]], units: Mapping[str, str]
) -> tuple[Html, dict[str, Any]]:
    """Sentences, a plot of the shares and a table.

    - `name`: of the plot
    - `structure`: one entry per joint, as in diagnosis.json
    - `units`: unit of the torque by joint
    """
    place = f"{name}-shares"
    note = paragraph(
        "Where what is left comes from. Smooth functions of position, speed, acceleration and load, and of time, are "
        "fitted to some blocks of time and judged on the others: what they explain there is their share of the "
        "variance. The rest is noise, or depends on something that was not looked at. The p of whiteness tests that "
        "rest (Ljung and Box): below 0.001 it is not noise alone. Times are the stamps of the logs; stamps that begin "
        "more than an hour from zero count from the first sample of the earliest log."
    )
    rows: list[list[object]] = []
    for joint in structure:
        change = joint["change"]
        since = f"{change['interval'][0]:.1f} to {change['interval'][1]:.1f} s" if change else MISSING
        correlated = [f"{one['on']} {one['correlation']:+.2f} (±{one['band']:.2f})" for one in joint["dependence"][:2]]
        rows.append(
            [
                joint["joint"],
                Cell(f"{significant(joint['rmse'])} {units[joint['joint']]}", "number"),
                *(percent(100 * joint["shares"][key]) for key, _, _ in SHARES),
                _probability(joint["whiteness"]),
                significant(joint["independent_rows"]),
                Cell("; ".join(correlated), "listed") if correlated else MISSING,
                since,
            ]
        )
    columns = [
        "joint",
        "RMSE in band",
        "state %",
        "time %",
        "noise %",
        "p of whiteness",
        "independent rows",
        "correlated with (band)",
        "changes at",
    ]
    body = [
        note,
        items(joint["summary"] for joint in structure),
        plot(
            place,
            max(FRAME + ROW_HEIGHT * len(structure), LEAST_HEIGHT),
            "Shares of the variance of what is left, joint by joint",
        ),
        table("What is left, joint by joint", columns, rows, text_columns=(0, 7)),
    ]
    return join(body), {place: _figure(structure)}


def _probability(value: float) -> str:
    return "below 0.001" if value < 0.001 else f"{value:.3f}"


def _figure(structure: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    joints = [joint["joint"] for joint in structure]
    bars = [
        {
            "type": "bar",
            "orientation": "h",
            "name": label,
            "y": joints,
            "x": rounded([100.0 * joint["shares"][key] for joint in structure], 4),
            "marker": {"color": colour},
            "hovertemplate": "%{x:.1f} %",
        }
        for key, label, colour in SHARES
    ]
    return {
        "data": bars,
        "layout": layout(
            barmode="stack",
            xaxis=axis("share of the variance [%]", range=[0, 100]),
            yaxis=axis("", autorange="reversed", type="category"),
            legend={**layout()["legend"], "traceorder": "normal"},
            showlegend=True,
        ),
    }
