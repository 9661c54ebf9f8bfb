"""Settings, versions and provenance."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .markup import Html, element, join

# Names that are clearer than those in the JSON file.
NAMES = {
    "cutoff_hz": "cut-off of the position filter [Hz]",
    "torque_cutoff_hz": "cut-off of both sides of the equation [Hz]",
    "torque_band": "band of both sides of the equation",
    "standstill_speed": "standing below a speed of [rad/s, m/s]",
    "turn_margin": "left out about turns [periods of the cut-off]",
    "decimation": "every how many rows are used",
    "order": "order of the filter",
    "gravity": "gravity [m/s²]",
    "reading": "reading and repairing",
    "start": "start from",
    "rate_hz": "samples in the files [Hz]",
    "fundamental_hz": "fundamental [Hz]",
    "duration": "duration [s]",
    "step": "step [s]",
    "control_period": "control period [s]",
    "delay": "delay [s]",
    "speed_limit": "runs away above [rad/s, m/s]",
    "position_resolution": "encoder step [rad, m]",
    "torque_noise": "noise of the torque [N·m, N]",
    "noise": "noise of the torque, weight of the joints [N·m, N]",
    "position_range": "positions, lowest and highest [rad, m]",
    "max_velocity": "highest speed [rad/s, m/s]",
    "max_acceleration": "highest acceleration [rad/s², m/s²]",
    "max_torque": "highest torque [N·m, N]",
    "floor": "height of the floor [m]",
    "boxes": "boxes, lowest and highest corner [m]",
    "clearance": "clearance [m]",
    "link_radius": "radius of the links [m]",
    "max_tip_speed": "highest speed of the tool [m/s]",
}


def settings_section(groups: Mapping[str, Mapping[str, Any]]) -> Html:
    """One list per group."""
    parts = []
    for title, entries in groups.items():
        pairs = join(
            join([element("dt", NAMES.get(name, name.replace("_", " "))), element("dd", _text(value))])
            for name, value in entries.items()
        )
        parts.append(join([element("h3", title), element("dl", pairs)]))
    return join(parts)


def _text(value: Any) -> str:
    if value is None:
        return "automatic"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_text(entry)}" for key, entry in value.items()) or "as found"
    if isinstance(value, np.ndarray | Iterable):
        texts = [_text(float(entry) if isinstance(entry, np.floating) else entry) for entry in value]
        # Sentences have commas of their own.
        return ("; " if any(", " in text for text in texts) else ", ").join(texts) or "none"
    return str(value)
