"""How large the errors are, in words, in a table and in a plot."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from .. import Comparison, JointComparison
from .colours import AFTER, BASELINE, BEFORE, GRID
from .figures import TOOLS, axis, layout, rounded
from .markup import Cell, Html, element, join, legend, paragraph, plot, table
from .numbers import MISSING, percent, significant

ROW_HEIGHT = 30
NOTICEABLE = 1.02
"""Errors that differ by less are the same to a reader."""
PLOT = "errors-plot"


def verdict(
    before: Comparison | None,
    after: Comparison,
    where: str,
    before_has: str,
    *,
    answer: str | None = None,
    more: Sequence[str] = (),
    bad: bool = False,
) -> Html:
    """What remains, after and before, in sentences.

    - `where`: "On 2 unseen logs"
    - `before_has`: "with the robot file it was"
    - `answer`: a sentence that stands before all others; `more`: further sentences
    - `bad`: whether something else is wrong
    """
    scored = [joint for joint in after.joints if joint.samples]
    begin = [answer] if answer else []
    if not scored:
        return box([*begin, f"{where}, no joint moves: nothing can be said about the model.", *more], bad=True)
    worst = max(scored, key=lambda joint: joint.relative_error_percent)
    first = f"{where}, {percent(after.relative_error_percent)} % of the torque remains unexplained"
    if before is not None:
        first += f"; {before_has} {percent(before.relative_error_percent)} %"
    sentences = [
        f"{first}.",
        f"{'The joint' if len(scored) == 1 else 'The weakest joint'} is {worst.joint}: "
        f"{percent(worst.relative_error_percent)} % of its torque, {significant(worst.rmse)} {worst.unit} "
        "(root mean square).",
    ]
    pairs = zip(before.joints, after.joints, strict=True) if before is not None else ()
    worse = [
        f"{a.joint} (by {percent(100.0 * (a.rmse / b.rmse - 1.0))} %)" if b.rmse else a.joint
        for b, a in pairs
        if a.samples and a.rmse > NOTICEABLE * b.rmse
    ]
    if worse:
        sentences.append(f"Here the error has grown instead: {', '.join(worse)}.")
    useless = [joint.joint for joint in scored if joint.rmse > joint.rmse_gravity or joint.rmse > joint.rmse_zero]
    if useless:
        sentences.append(f"No better than gravity alone, or than no model at all: {', '.join(useless)}.")
    still = [joint.joint for joint in after.joints if not joint.samples]
    if still:
        sentences.append(f"Not judged, as they do not move in these logs: {', '.join(still)}.")
    return box([*begin, *sentences, *more], bad=bad or bool(worse or useless))


def errors_section(models: Mapping[str, Comparison]) -> tuple[Html, dict[str, Any]]:
    """Table and plot of one or two models, the last one being the one that matters."""
    last = list(models.values())[-1]
    many = len(models) > 1
    columns = ["joint", "unit", *(f"RMSE, {label}" for label in models)] if many else ["joint", "unit", "RMSE"]
    columns += [
        "% of torque",
        "fit %",
        "R²",
        "largest error",
        "when",
        "no model",
        "gravity only",
        "RMSE, all frequencies",
    ]
    several = len({joint.largest_error_log for joint in last.joints if joint.samples}) > 1
    rows = [_row(joints, several) for joints in zip(*(found.joints for found in models.values()), strict=True)]
    body = join(
        [
            paragraph(
                "RMSE is the root mean square of measured minus predicted torque in the band of the model, over the "
                "samples at which the joint moves. % of torque: RMSE relative to that of the measured torque. Fit: "
                "100 % is perfect, 0 % no better than the mean. “No model” and “gravity only” are the RMSE that remain "
                "without a model and with the model's gravity torque alone."
            ),
            table(
                "Errors of each joint",
                columns,
                rows,
                text_columns=(0, 1, 6 + len(models)),
                spare_columns=(4 + len(models), len(columns) - 1) if many else (),
            ),
            legend(_keys(models)),
            plot(PLOT, 116 + ROW_HEIGHT * len(last.joints), "Error of each joint in percent of its torque"),
        ]
    )
    return body, {PLOT: _figure(models)}


def _row(joints: Sequence[JointComparison], with_log: bool) -> list[object]:
    last = joints[-1]
    if not last.samples:
        return [last.joint, last.unit, *[MISSING] * (len(joints) + 8)]
    rmse: list[object] = [significant(joint.rmse) for joint in joints]
    baseline = min(last.rmse_zero, last.rmse_gravity)
    if any(last.rmse > NOTICEABLE * other.rmse for other in joints[:-1]):
        rmse[-1] = Cell(f"{significant(last.rmse)} ▲ worse", "bad number")
    elif last.rmse > baseline:
        rmse[-1] = Cell(f"{significant(last.rmse)} ▲ no use", "bad number")
    elif len(joints) > 1:
        rmse[-1] = Cell(significant(last.rmse), "best number")
    return [
        last.joint,
        last.unit,
        *rmse,
        percent(last.relative_error_percent),
        percent(last.fit_percent),
        significant(last.r2, 4),
        significant(last.largest_error),
        _when(last, with_log),
        significant(last.rmse_zero),
        significant(last.rmse_gravity),
        significant(last.rmse_full_band),
    ]


def _when(joint: JointComparison, with_log: bool) -> Html:
    """The moment; if the joints have theirs in different logs, with the file, whose whole path shows on hovering."""
    moment = element("span", f"{significant(joint.largest_error_time, 4)} s", class_="number")
    if not with_log:
        return moment
    name = element("span", PurePath(joint.largest_error_log).name, title=joint.largest_error_log)
    return Html(f"{moment}, {name}")


def _keys(models: Mapping[str, Comparison]) -> list[tuple[str, str, str]]:
    labels = list(models)
    keys = [("●", AFTER, labels[-1])]
    if len(labels) > 1:
        keys.insert(0, ("◆", BEFORE, labels[0]))
    return [("✕", BASELINE, "gravity only"), *keys, ("┊", BASELINE, "100 %: no model at all")]


def _figure(models: Mapping[str, Comparison]) -> dict[str, Any]:
    found = list(models.values())
    names = [joint.joint for joint in found[-1].joints]

    def marks(label: str, errors: Sequence[float], symbol: str, colour: str) -> dict[str, Any]:
        return {
            "type": "scatter",
            "mode": "markers",
            "name": label,
            "x": rounded(errors),
            "y": names,
            "marker": {"symbol": symbol, "color": colour, "size": 11},
            "hovertemplate": "%{y}: %{x:.3g} %<extra>" + label.replace("<", "&lt;") + "</extra>",
        }

    def relative(comparison: Comparison) -> list[float]:
        return [100.0 * j.rmse / j.rmse_zero if j.samples and j.rmse_zero else float("nan") for j in comparison.joints]

    gravity = [
        100.0 * j.rmse_gravity / j.rmse_zero if j.samples and j.rmse_zero else float("nan") for j in found[-1].joints
    ]
    labels = list(models)
    data = [marks("gravity only", gravity, "x-thin-open", BASELINE)]
    data[0]["marker"]["line"] = {"width": 2}
    if len(found) > 1:
        data.append(marks(labels[0], relative(found[0]), "diamond", BEFORE))
    data.append(marks(labels[-1], relative(found[-1]), "circle", AFTER))
    ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000]
    line = {"type": "line", "xref": "x", "yref": "paper", "x0": 100, "x1": 100, "y0": 0, "y1": 1}
    return {
        "data": data,
        "layout": layout(
            xaxis=axis("RMSE [% of the joint's torque]", type="log", tickvals=ticks),
            yaxis=axis("", range=[len(names) - 0.5, -0.5], type="category", gridcolor=GRID),
            shapes=[{**line, "line": {"color": BASELINE, "dash": "dot", "width": 1.5}, "layer": "below"}],
            margin={"l": 20, "r": 16, "t": TOOLS, "b": 50},
            showlegend=False,
        ),
    }


def box(sentences: Sequence[object], *, bad: bool) -> Html:
    """The answer of a page, in a colour of its own; the first sentence is the one to be read."""
    first, *others = sentences
    body = join([paragraph(first, "lead"), *map(paragraph, others)])
    return element("div", body, class_="verdict bad" if bad else "verdict")
