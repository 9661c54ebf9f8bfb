"""What was done to the logs: spectra, the cut-off, and what another one would have made of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import CutoffChoice
from .colours import AFTER, BEFORE, line_of
from .figures import axis, layout, log_axis, rounded
from .markup import Html, choice, element, join, paragraph, plot, table
from .numbers import MISSING, percent, significant

Array = NDArray[np.float64]

SPECTRUM = "spectrum"
INFLUENCE = "influence-plot"
BANDS_PER_DECADE = 80


def signals_section(
    choices: Sequence[CutoffChoice],
    labels: Sequence[str],
    joints: Sequence[str],
    position_units: Sequence[str],
    data: dict[str, Any],
) -> tuple[Html, dict[str, Any], dict[str, Any]]:
    """Body, plots and plots with a selection."""
    processing = data["processing"]
    used = processing["cutoff_hz"]
    band = processing["torque_cutoff_hz"]
    # The log that decided first: short ones are judged together, and one of them may have its lowest point far above.
    order = sorted(range(len(choices)), key=lambda k: abs(choices[k].cutoff_hz - used))
    body = [
        paragraph(
            f"Positions pass a Butterworth low-pass of order {processing['order']} at {significant(used)} Hz, "
            f"forwards and backwards (no delay), and are differentiated ({processing['differentiation']}). Measured "
            "torque and model "
            + (f"are compared below {significant(band)} Hz" if band else "are compared without a filter")
            + f"; one row in {processing['decimation']} is used."
        )
    ]
    switches: dict[str, Any] = {}
    if choices:
        unit = _unit(position_units)
        body += [
            element("h3", "Spectrum of the acceleration"),
            paragraph(
                "Density of each joint's acceleration, from its logged position. Left of its lowest point there is "
                "more motion than noise, right of it more noise than motion. The dashed line is the cut-off: unless it "
                "was given, the highest of such points; logs shorter than eight seconds have theirs from all spectra."
            ),
            choice(f"{SPECTRUM}-choice", "Log", [labels[k] if k < len(labels) else f"log {k + 1}" for k in order]),
            plot(SPECTRUM, 440, "Spectrum of the acceleration of each joint, with the cut-off"),
        ]
        switches[SPECTRUM] = [_spectrum(choices[k], joints, unit, used) for k in order]
    influence, figures = _influence(data, joints)
    return join([*body, influence]), figures, switches


def _unit(position_units: Sequence[str]) -> str:
    units = sorted(set(position_units))
    return " or ".join(f"({unit}/s²)²/Hz" for unit in units)


def _spectrum(found: CutoffChoice, joints: Sequence[str], unit: str, used: float) -> dict[str, Any]:
    data: list[dict[str, Any]] = []
    lowest: list[float] = []
    highest: list[float] = []
    for k, joint in enumerate(joints):
        frequency, density = _thinned(np.asarray(found.frequency_hz), np.asarray(found.density[k]))
        acceleration = density * (2.0 * np.pi * frequency) ** 4
        acceleration = np.where(acceleration > 0.0, acceleration, np.nan)
        if np.isfinite(acceleration).any():
            # Joints at rest have no motion to show, only rounding many decades below.
            highest.append(float(np.nanmax(acceleration)))
            lowest.append(
                float(np.nanmin(acceleration[frequency > used / 4.0])) if (frequency > used / 4.0).any() else 0.0
            )
        hz = float(found.joint_hz[k])
        own = f", lowest at {significant(hz)} Hz" if hz > 0.0 else ", no motion seen"
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": joint + own,
                "x": rounded(frequency, 5),
                "y": rounded(acceleration, 4),
                "line": {**line_of(k), "width": 1.4},
                "hovertemplate": "%{x:.3g} Hz: %{y:.2e}",
            }
        )
    line = {"type": "line", "xref": "x", "yref": "paper", "x0": used, "x1": used, "y0": 0, "y1": 1}
    label = {
        "x": float(np.log10(used)),
        "y": 1,
        "xref": "x",
        "yref": "paper",
        "text": f"cut-off {significant(used)} Hz",
        "showarrow": False,
        "xanchor": "left",
        "yanchor": "top",
        "xshift": 4,
        "bgcolor": "rgba(255,255,255,0.85)",
    }
    top = np.log10(max(highest)) + 0.5 if highest else 0.0
    bottom = np.log10(min(v for v in lowest if v > 0.0)) - 1.0 if any(v > 0.0 for v in lowest) else top - 8.0
    return {
        "data": data,
        "layout": layout(
            xaxis=log_axis("frequency [Hz]"),
            yaxis=log_axis(f"density [{unit}]", range=[round(max(bottom, top - 14.0), 3), round(top, 3)]),
            shapes=[{**line, "line": {"color": "#222222", "dash": "dash", "width": 1.5}}],
            annotations=[label],
            margin={"l": 70, "r": 16, "t": 40, "b": 48},
            showlegend=True,
        ),
    }


def _thinned(frequency: Array, density: Array) -> tuple[Array, Array]:
    """Averages over narrow bands, evenly spaced on a logarithmic axis."""
    frequency, density = frequency[1:], density[1:]
    if not len(frequency):
        return frequency, density
    band = np.floor(np.log10(frequency / frequency[0]) * BANDS_PER_DECADE).astype(int)
    _, start = np.unique(band, return_index=True)
    count = np.diff(np.append(start, len(band)))
    return np.add.reduceat(frequency, start) / count, np.add.reduceat(density, start) / count


def _influence(data: dict[str, Any], joints: Sequence[str]) -> tuple[Html, dict[str, Any]]:
    others = data["cutoff_influence"]
    if not others:
        return paragraph("No other cut-off could be tried on these logs."), {}
    after = data["comparison"]["after"]
    used = {
        "cutoff_hz": data["processing"]["cutoff_hz"],
        "largest_change": 0.0,
        "typical_change": 0.0,
        "rmse": [joint["rmse"] for joint in after["joints"]],
        "relative_error_percent": after["relative_error_percent"],
    }
    points = sorted([*others, used], key=lambda point: point["cutoff_hz"])
    unseen = data["comparison"]["logs"] == "test"
    rows = [
        [
            f"{significant(p['cutoff_hz'])} Hz" + (" (used)" if p is used else ""),
            percent(p["relative_error_percent"]),
            MISSING if p is used else significant(p["typical_change"], 2),
            MISSING if p is used else significant(p["largest_change"], 2),
        ]
        for p in points
    ]
    where = "error on unseen logs, % of torque" if unseen else "error on the training logs, % of torque"
    columns = ["cut-off", where, "typical change of parameters, std. dev.", "largest change, std. dev."]
    body = join(
        [
            element("h3", "Influence of the cut-off"),
            paragraph(
                "The same identification with other cut-offs, judged in the band of the model above. Results that "
                "hinge on the cut-off deserve no trust: changes of the parameters should stay within a few standard "
                "deviations."
            ),
            table("Other cut-offs", columns, rows),
            plot(INFLUENCE, 520, "Error and change of the parameters against the cut-off"),
        ]
    )
    return body, {INFLUENCE: _influence_figure(points, used, joints, after["joints"])}


def _influence_figure(
    points: Sequence[dict[str, Any]], used: dict[str, Any], joints: Sequence[str], after: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    x = rounded([p["cutoff_hz"] for p in points], 4)
    data: list[dict[str, Any]] = []
    for k, joint in enumerate(joints):
        zero = after[k]["rmse_zero"]
        errors = [100.0 * p["rmse"][k] / zero if zero else float("nan") for p in points]
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": joint,
                "x": x,
                "y": rounded(errors),
                "line": {**line_of(k), "width": 1.5},
                "hovertemplate": "%{y:.3g} %",
            }
        )
    changes = (
        ("largest_change", "largest change", BEFORE, "diamond"),
        ("typical_change", "typical change", AFTER, "circle"),
    )
    for key, label, colour, symbol in changes:
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": label,
                "x": x,
                "y": rounded([p[key] for p in points]),
                "yaxis": "y2",
                "line": {"color": colour, "width": 1.5, "dash": "dot"},
                "marker": {"symbol": symbol, "size": 8},
                "hovertemplate": "%{y:.3g} std. dev.",
            }
        )
    line = {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": used["cutoff_hz"],
        "x1": used["cutoff_hz"],
        "y0": 0,
        "y1": 1,
    }
    ticks = [p["cutoff_hz"] for p in points]
    return {
        "data": data,
        "layout": layout(
            xaxis=axis(
                "cut-off [Hz]",
                type="log",
                tickvals=rounded(ticks),
                ticktext=[significant(t) for t in ticks],
                anchor="y2",
            ),
            yaxis=axis("error [% of torque]", domain=[0.47, 1.0], rangemode="tozero"),
            yaxis2=axis("change [std. dev.]", domain=[0.0, 0.38], rangemode="tozero"),
            shapes=[{**line, "line": {"color": "#222222", "dash": "dash", "width": 1.5}, "layer": "below"}],
            hovermode="x",
            margin={"l": 60, "r": 16, "t": 60, "b": 48},
            showlegend=True,
        ),
    }
