"""What the messages about a log propose, as settings of reading that a click applies."""

import re
from collections.abc import Iterable
from typing import Any

PROPOSALS = {
    r"\(resample: ([\d.]+) Hz\)": "resample",
    r"\(repair: ([a-z_, ]+)\)": "repair",
    r"\(accept: (\w+)\)": "accept",
    r'`accept=\["(\w+)"\]`': "accept",
}
TITLES = {
    "sort": "Sort the samples by their time",
    "drop_duplicates": "Drop samples with the stamp of the one before",
    "drop_not_finite": "Drop samples that are not numbers",
    "replace_strays": "Replace samples that stray from those around them",
    "drop_repeated": "Drop samples that repeat the one before",
    "unwrap": "Take back jumps by a full turn",
    "joints_by_order": "The columns are numbered in the order of the joints",
    "stray_sample": "The samples that stray are right as they are",
    "position_in_degrees": "The position is right as it is",
    "torque_scale": "The torque is right as it is",
    "unlikely_rate": "The rate is right as it is",
}


def proposals(texts: Iterable[str]) -> list[dict[str, Any]]:
    """Titles and settings, each once, in the order in which they are said."""
    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        for pattern, kind in PROPOSALS.items():
            for value in re.findall(pattern, text):
                if kind == "resample":
                    # One rate for all logs, which none of them has to be stretched to.
                    rate = min(float(value), found.get("resample", {"resample": float("inf")})["resample"])
                    found["resample"] = {"resample": rate}
                elif kind == "repair":
                    found.update({name: {name: True} for name in value.split(", ") if name in TITLES})
                elif value in TITLES:
                    found[value] = {"accept": [value]}
    return [{"title": _title(key, each), "settings": each} for key, each in found.items()]


def _title(key: str, settings: dict[str, Any]) -> str:
    return f"Resample at {settings['resample']:g} Hz" if key == "resample" else TITLES[key]
