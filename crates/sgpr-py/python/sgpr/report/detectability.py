"""What the logs could have shown, and from which size on."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

from .markup import Html, element, items, join, paragraph, prose, table
from .numbers import MISSING, significant

ARM = "whole arm"
BEYOND = 1e5
"""No arm has so much of any effect, in any of their units."""


def detectability_section(entries: Sequence[Mapping[str, Any]], joints: Sequence[str]) -> Html:
    """A table of effects by joints; nothing if nothing was tested.

    - `entries`: `detectable` of diagnosis.json
    """
    if not entries:
        return join([])
    by_effect: dict[str, dict[str, Mapping[str, Any]]] = {}
    for entry in entries:
        by_effect.setdefault(entry["effect"], {})[", ".join(entry["joints"]) or ARM] = entry
    columns = [*joints, *([ARM] if any(ARM in own for own in by_effect.values()) else [])]
    rows = []
    doubts = []
    for effect, own in by_effect.items():
        first = next(iter(own.values()))
        symbol = first["parameter"].split(".")[-1]
        cells = [_size(own[place]["seen_from"]) if place in own else "" for place in columns]
        rows.append([_named(effect, f"{symbol}, {first['unit']}"), *cells])
        doubts += [_doubt(effect, place, entry) for place, entry in own.items() if entry["mistaken_for"]]
    note = paragraph(
        "Silence has a size: an effect as large as this, with this motion and this noise, would have been found. "
        "Constants are in the middle of their range; other parameters of the effect are zero. An empty cell: the model "
        "has it there, or its parameters take it up; a dash: no size shows."
    )
    parts = [
        element("h3", "What these logs could have shown"),
        note,
        table("Smallest size that is seen", ["effect, its parameter", *columns], rows),
    ]
    if doubts:
        parts += [paragraph("Not told apart so soon:"), items(doubts)]
    return join(parts)


def _named(effect: str, parameter: str) -> Html:
    """An effect that may go on to the next line between its words, and below it the parameter."""
    return join([Html(html.escape(effect).replace("_", "_<wbr>")), element("small", parameter)])


def _size(value: float | None) -> str:
    return MISSING if value is None or value > BEYOND else significant(value, 2)


def _doubt(effect: str, place: str, entry: Mapping[str, Any]) -> Html:
    size = entry["told_apart_from"]
    until = "at any size" if size is None else f"below {significant(size, 2)} {entry['unit']}"
    return prose(
        f"`{effect}` at {'the whole arm' if place == ARM else place} looks like {entry['mistaken_for']} {until}"
    )
