"""Numbers as people read them: as many digits as they deserve."""

import math
import re

MISSING = "–"
SPECK = 1e-6
FACTOR = re.compile(r"(?:[+-] )?(\d+(?:\.\d+)?(?:e[+-]?\d+)?) .")
MEANINGLESS = 1000.0
"""A deviation of so many percent of the value says that the value is unknown; more says no more."""


def significant(value: float | None, digits: int = 3) -> str:
    """`value` with so many significant digits: 12.3, 0.0456, 1.2e-07."""
    if value is None or math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return f"{value:.{max(0, digits - 1 - exponent)}f}"
    return f"{value:.{digits - 1}e}"


def percent(value: float | None) -> str:
    """Percent: 98.7, 4.21, 0.3, 240."""
    if value is None or math.isnan(value):
        return MISSING
    if not math.isfinite(value):
        return significant(value)
    size = abs(value)
    return f"{value:.0f}" if size >= 99.95 else f"{value:.1f}" if size >= 9.995 else f"{value:.2f}"


def relative_deviation(value: float | None) -> str:
    """A standard deviation in percent of its value: 4.21, 240, > 1000."""
    return f"> {MEANINGLESS:.0f}" if value is not None and value > MEANINGLESS else percent(value)


def readable(expression: str) -> str:
    """A combination of parameters without the terms whose factors are nothing but rounding of the robot file."""
    kept: list[str] = []
    for term in re.split(r" (?=[+-] )", expression):
        # The name of a joint may hold anything, blanks and numbers too: only what stands before it is a factor.
        factor = FACTOR.match(term)
        if factor is None or abs(float(factor[1])) >= SPECK or not kept:
            kept.append(term)
    return " ".join(kept)


def with_deviation(value: float, deviation: float | None) -> tuple[str, str]:
    """Value and standard deviation: two digits of the deviation, and the value to the same place."""
    if deviation is None or not math.isfinite(deviation) or deviation <= 0.0:
        return significant(value, 4), MISSING
    place = 1 - math.floor(math.log10(float(f"{deviation:.1e}")))
    if place > 6 or abs(value) >= 1e7:
        return f"{value:.{max(0, place + _exponent(value))}e}", f"{deviation:.1e}"
    return f"{value:z.{max(0, place)}f}", f"{deviation:.{max(0, place)}f}"


def chance(value: float) -> str:
    """The probability that chance does as much: 0.12, 0.004, < 0.001."""
    return "< 0.001" if value < 0.001 else f"{value:.3f}" if value < 0.01 else f"{value:.2f}"


def seconds(value: float) -> str:
    """A duration or a moment: 0.512 s, 12.34 s, 1234 s."""
    return f"{significant(value, 4)} s"


def counted(count: int, noun: str) -> str:
    """`1 log`, `3 logs`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0
