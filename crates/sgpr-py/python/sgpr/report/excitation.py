"""What the motion of the training logs can tell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .colours import AFTER
from .figures import TOOLS, axis, layout, log_axis, rounded
from .markup import Html, element, join, paragraph, plot
from .numbers import counted, significant
from .parameters import certainty_plot

PLOT = "singular-values-plot"
FEW = 12


def excitation_section(
    fit: dict[str, Any], singular_values: NDArray[np.float64], parameters: Sequence[dict[str, Any]]
) -> tuple[Html, dict[str, Any]]:
    """Condition, singular values, and which parameters stay unknown."""
    certainty, figures = certainty_plot(parameters)
    missing = fit["undetermined"]
    if missing:
        sentence = (
            f"Not excited: {', '.join(missing)}. {'These keep their' if len(missing) > 1 else 'It keeps its'} nominal "
            "values. Record a motion that moves these joints, fast and slow, in both directions."
        )
    else:
        sentence = f"All {counted(len(parameters), 'base parameter')} are excited."
    body = join(
        [
            paragraph(sentence),
            paragraph(
                f"Condition number of the observation matrix: {significant(fit['condition'])}; with its columns "
                f"brought to equal length, which is independent of units: {significant(fit['scaled_condition'])}. "
                "Below about 100 the parameters are told apart well."
            ),
            element("h3", "Certainty of each parameter"),
            certainty,
            element("h3", "Singular values of the observation matrix"),
            plot(PLOT, 300, "Singular values of the observation matrix, largest first"),
        ]
    )
    data = {
        "type": "scatter",
        "mode": "lines+markers",
        "x": list(range(1, len(singular_values) + 1)),
        "y": rounded(np.where(singular_values > 0.0, singular_values, np.nan)),
        "line": {"color": AFTER, "width": 1},
        "marker": {"size": 6},
        "hovertemplate": "number %{x}: %{y:.3g}<extra></extra>",
    }
    figures[PLOT] = {
        "data": [data],
        "layout": layout(
            xaxis=axis("number, largest first", **({"dtick": 1} if len(singular_values) <= FEW else {})),
            yaxis=log_axis("singular value [mixed units]"),
            showlegend=False,
            margin={"l": 60, "r": 16, "t": TOOLS, "b": 48},
        ),
    }
    return body, figures
