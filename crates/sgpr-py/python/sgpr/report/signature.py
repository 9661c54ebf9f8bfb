"""The plot that convinces: the residual against the variable that matters, with the fitted effect drawn through it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import LogResidual
from .colours import AFTER, BEFORE
from .figures import axis, layout, rounded
from .markup import Html, join, plot

Array = NDArray[np.float64]
Residuals = Sequence[Sequence[LogResidual]]

BINS = 60
NARROW = 0.01  # of the largest value: bins about zero are narrower than that
FEWEST = 5
POINTS = 3000

# The variable that an effect's signature is a function of; the speed for friction not named here.
VARIABLES = {
    "rotor_inertia": "ddq",
    "joint_elasticity": "ddq",
    "link_flexibility": "ddq",
    "actuator_lag": "ddq",
    "cable_stiffness": "q",
    "cable_hysteresis": "q",
    "transmission_hysteresis": "q",
    "spring_balancer": "q",
    "torque_ripple": "q",
    "kinematic_error": "q",
    "cogging_torque": "q",
    "position_dependent_friction": "q",
    "encoder_offset": "q",
    "encoder_eccentricity": "q",
    "base_tilt": "q",
    "link_length_error": "q",
    "torque_offset": "t",
    "torque_offset_drift": "t",
    "torque_gain_drift": "t",
    "friction_warmup": "t",
    "friction_step": "t",
    "payload_change": "t",
    "external_contact": "t",
    "base_compliance": "tau",
    "torque_gain_error": "tau",
    "torque_saturation": "tau",
    "backlash": "tau",
    "friction_dead_band": "tau",
    "load_dependent_friction": "dq",
}

TITLES = {
    "q": "position [{position}]",
    "dq": "speed [{position}/s]",
    "ddq": "acceleration [{position}/s²]",
    "t": "time [s]",
    "tau": "predicted torque [{torque}]",
}


def signature_figures(
    name: str,
    finding: Mapping[str, Any],
    residuals: tuple[Residuals, Residuals],
    units: Mapping[str, str],
    position_units: Sequence[str],
) -> tuple[Html, dict[str, Any]]:
    """One plot per joint of a finding; for an effect of the whole arm, of the joint where it brings most.

    - `residuals`: before and with the findings
    - `units`, `position_units`: of the torque by joint, of the positions
    """
    before, after = residuals
    joints = list(finding["joints"]) or [_most_changed(finding)]
    names = list(units)
    places, figures = [], {}
    for joint in joints:
        place = f"{name}-{names.index(joint)}"
        variable = VARIABLES.get(finding["effect"], "dq")
        title = TITLES[variable].format(position=position_units[names.index(joint)], torque=units[joint])
        figure = _figure(names.index(joint), variable, title, (before, after), units[joint])
        if figure:
            label = f"Residual of {joint} against {title}, before and with {finding['effect']}"
            note = (
                f"{joint}: dots, measured minus predicted torque before; line through them, what the findings explain, "
                "averaged; line near zero, what they leave."
            )
            places.append(plot(place, 360, label, note))
            figures[place] = figure
    return join(places), figures


def _most_changed(finding: Mapping[str, Any]) -> str:
    before, after = finding["rmse_before"], finding["rmse_after"]
    return str(max(before, key=lambda joint: before[joint] / max(after[joint], 1e-12)))


def _figure(
    joint: int, variable: str, title: str, residuals: tuple[Residuals, Residuals], unit: str
) -> dict[str, Any] | None:
    before, after = residuals
    parts = [(b, a) for log_b, log_a in zip(before, after, strict=True) for b, a in zip(log_b, log_a, strict=True)]
    masks = [b.counted[:, joint] & a.counted[:, joint] for b, a in parts]
    if not parts or not any(mask.any() for mask in masks):
        return None

    def column(piece: LogResidual) -> Array:
        if variable == "t":
            return np.asarray(piece.time_ns * 1e-9, dtype=np.float64)
        if variable == "tau":
            return np.asarray(piece.predicted_in_band[:, joint])
        return np.asarray(getattr(piece, variable)[:, joint])

    x = np.concatenate([column(b)[mask] for (b, _), mask in zip(parts, masks, strict=True)])
    if variable == "t":
        x = x - x.min()
    old = np.concatenate(
        [(b.measured_in_band - b.predicted_in_band)[m, joint] for (b, _), m in zip(parts, masks, strict=True)]
    )
    new = np.concatenate(
        [(a.measured_in_band - a.predicted_in_band)[m, joint] for (_, a), m in zip(parts, masks, strict=True)]
    )
    centre, explained = _averages(x, old - new)
    _, left = _averages(x, new)
    keep = np.linspace(0, len(x) - 1, min(POINTS, len(x))).astype(int)
    dots = {
        "type": "scattergl" if len(keep) > 20000 else "scatter",
        "mode": "markers",
        "name": "residual before",
        "x": rounded(x[keep]),
        "y": rounded(old[keep]),
        "marker": {"color": BEFORE, "size": 3, "opacity": 0.35},
        "hoverinfo": "skip",
    }
    lines = [
        _line("explained by the findings", centre, explained, "#000000", "solid"),
        _line("left", centre, left, AFTER, "dash"),
    ]
    return {
        "data": [dots, *lines],
        "layout": layout(
            xaxis=axis(title),
            yaxis=axis(f"residual [{unit}]"),
            legend={**layout()["legend"], "itemsizing": "constant"},
        ),
    }


def _line(label: str, x: Array, y: Array, colour: str, dash: str) -> dict[str, Any]:
    style = {"color": colour, "width": 2.5, "dash": dash}
    return {"type": "scatter", "mode": "lines", "name": label, "x": rounded(x), "y": rounded(y), "line": style}


def _averages(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of y over bins of x: some with equally many samples, some narrow ones about zero, where signs change."""
    size = float(np.abs(x).max()) or 1.0
    near_zero = np.sinh(np.linspace(-1.0, 1.0, BINS) * np.arcsinh(1.0 / NARROW)) * NARROW * size
    edges = np.unique(np.concatenate([np.quantile(x, np.linspace(0.0, 1.0, BINS)), near_zero]))
    bins = np.searchsorted(edges, x)
    count = np.bincount(bins, minlength=len(edges) + 1)
    kept = count >= FEWEST
    sums = [np.bincount(bins, weights=values, minlength=len(edges) + 1)[kept] / count[kept] for values in (x, y)]
    return sums[0], sums[1]
