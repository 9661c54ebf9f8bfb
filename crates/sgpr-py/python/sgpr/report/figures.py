"""Plots as plain data for Plotly: what all of them share."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .colours import GRID

FONT = {"family": "system-ui, 'Segoe UI', 'Liberation Sans', Arial, sans-serif", "size": 13, "color": "#222222"}
SHOWN_DIGITS = 6


def axis(title: str, **settings: Any) -> dict[str, Any]:
    """An axis with its title (and unit)."""
    return {
        "title": {"text": title, "standoff": 8},
        "automargin": True,
        "gridcolor": GRID,
        "zerolinecolor": "#bbbbbb",
        "linecolor": "#888888",
        "ticks": "outside",
        "tickcolor": "#888888",
        **settings,
    }


def log_axis(title: str, **settings: Any) -> dict[str, Any]:
    """A logarithmic axis with a tick per decade, so that labels do not crowd."""
    return axis(title, type="log", dtick=1, exponentformat="power", **settings)


TOOLS = 34
"""Room above a plot without a legend for the tool bar that appears under the pointer, pixels."""

# A row of six names reaches as far as the tool bar: room for the legend below it.
MANY_NAMES = {"l": 60, "r": 16, "t": 62, "b": 48}


def layout(**settings: Any) -> dict[str, Any]:
    """A layout: legend above the plot, never on it."""
    return {
        "font": FONT,
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "margin": {"l": 60, "r": 16, "t": 36, "b": 48},
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.01, "yanchor": "bottom"},
        "hoverlabel": {"font": {"size": 13}, "namelength": -1},
        **settings,
    }


def rounded(values: ArrayLike, digits: int = SHOWN_DIGITS) -> list[float | None]:
    """Numbers for a plot: so many digits, and None where there is no finite number."""
    return [
        float(f"{value:.{digits}g}") if np.isfinite(value) else None
        for value in np.asarray(values, dtype=float).ravel()
    ]


def plain(text: str) -> str:
    """Text that Plotly shows as it is."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
