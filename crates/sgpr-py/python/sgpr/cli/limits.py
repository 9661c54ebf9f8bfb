"""Limits that a model has to meet, and whether it does."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import Comparison
from .errors import BadData, one_of, wrong_use

# Which side of a limit is the good one.
AT_MOST = (
    "rmse",
    "relative_error_percent",
    "largest_error",
    "rmse_full_band",
    "rmse_with_rests",
    "relative_error_with_rests_percent",
)
AT_LEAST = ("fit_percent", "r2")


@dataclass(frozen=True)
class Limit:
    """The worst value of a figure that is accepted, for one joint or for all."""

    figure: str
    value: float
    joint: str | None = None

    def met_by(self, found: float) -> bool:
        """Whether a figure is good enough; one that is not a number never is."""
        return found <= self.value if self.figure in AT_MOST else found >= self.value


def limits_of(pairs: Sequence[str], file: str | None, joints: Sequence[str]) -> list[Limit]:
    """Limits from the command line and from a JSON file.

    The file holds figures, and below the names of joints figures of theirs:
    {"fit_percent": 90, "joint_2": {"rmse": 1.2}}.
    """
    limits = [] if file is None else list(_from_file(file, joints))
    for pair in pairs:
        key, equals, text = pair.rpartition("=")
        joint, colon, figure = key.rpartition(":")
        if not equals:
            raise wrong_use(f"`{pair}` is not of the form FIGURE=VALUE or JOINT:FIGURE=VALUE", "--limit")
        try:
            value = float(text)
        except ValueError:
            raise wrong_use(f"`{text}` in `{pair}` is not a number", "--limit") from None
        if math.isnan(value):
            raise wrong_use(f"`{text}` in `{pair}` is not a number", "--limit")
        one_of(figure, (*AT_MOST, *AT_LEAST), "--limit", "figure")
        limits.append(Limit(figure, value, one_of(joint, joints, "--limit", "joint") if colon else None))
    return limits


def verdicts(limits: Iterable[Limit], found: Comparison) -> list[dict[str, Any]]:
    """For every limit and joint it is for: the figure and whether it is good enough."""
    return [
        {
            "joint": joint.joint,
            "figure": limit.figure,
            "limit": limit.value,
            "value": getattr(joint, limit.figure),
            "unit": unit_of(limit.figure, joint.unit),
            "verdict": "pass" if limit.met_by(getattr(joint, limit.figure)) else "fail",
        }
        for limit in limits
        for joint in found.joints
        if limit.joint in (None, joint.joint)
    ]


def unit_of(figure: str, torque_unit: str) -> str:
    """Unit of a figure of a joint."""
    if figure.endswith("percent"):
        return "%"
    return "" if figure == "r2" else torque_unit


def _from_file(path: str, joints: Sequence[str]) -> Iterable[Limit]:
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{path}: not a JSON file: {error}") from error
    if not isinstance(data, dict):
        raise BadData(f'{path}: expected figures with their limits, like {{"fit_percent": 90}}')
    for key, value in data.items():
        if isinstance(value, dict):
            if key not in joints:
                raise BadData(f"{path}: there is no joint `{key}`; the joints are {', '.join(joints)}")
            for figure, limit in value.items():
                yield _checked(path, figure, limit, key)
        else:
            yield _checked(path, key, value, None)


def _checked(path: str, figure: str, value: object, joint: str | None) -> Limit:
    known = (*AT_MOST, *AT_LEAST)
    if figure not in known:
        raise BadData(f"{path}: there is no figure `{figure}`; known are {', '.join(known)}")
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise BadData(f"{path}: the limit of `{figure}` is not a number")
    return Limit(figure, float(value), joint)
