"""Colours that people with colour-blindness can tell apart (Okabe and Ito, 2008), on white."""

from typing import Any

MEASURED = "#9a9a9a"
BEFORE = "#d55e00"
AFTER = "#0072b2"
BASELINE = "#555555"
GRID = "#e4e4e4"
NOT_COUNTED = "#eeeeee"
INTERVAL = "#b9dcf0"

LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#000000", "#7f7f7f")
DASHES = ("solid", "dash", "dot", "dashdot")


def line_of(index: int) -> dict[str, Any]:
    """Colour and dash of the line with this number; no two of the first 32 are alike."""
    return {"color": LINES[index % len(LINES)], "dash": DASHES[index // len(LINES) % len(DASHES)]}
