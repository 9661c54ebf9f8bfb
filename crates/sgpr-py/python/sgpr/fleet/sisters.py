"""What arms of one type know of each other: temperature, scatter of sessions, and who is unlike the others."""

import math
from collections.abc import Sequence

import numpy as np

from .series import FEWEST_OF_BASELINE, NAMES, ArmHistory, Series

OUTLIER = 4.0
LEAST_SCATTER = 0.0025
"""Share of a parameter's scale (kg) below which differences of sessions do not matter: a quarter of the least alarm."""
_MEDIAN_OF_SQUARE = 0.4549
"""Of the square of a standard normal variable."""


def keys(sisters: Sequence[ArmHistory]) -> list[tuple[str, str]]:
    """Joint and parameter of every series that one of the arms has."""
    return list(dict.fromkeys((one.joint, one.parameter) for history in sisters for one in history.series))


def of_all(sisters: Sequence[ArmHistory], key: tuple[str, str]) -> list[tuple[ArmHistory, Series]]:
    """The arms that have a series, with it."""
    found = ((history, history.find(*key)) for history in sisters)
    return [(history, one) for history, one in found if one is not None]


def share_temperature(sisters: Sequence[ArmHistory]) -> None:
    """Slopes by temperature from all arms of a type: one arm's days are too alike. Differences of neighbouring sessions
    hold no step but at one place, and those that are far off are left out."""
    for one in (of_all(sisters, key) for key in keys(sisters)):
        differences = [np.array([np.diff(x.change), np.diff(history.temperature)]) for history, x in one]
        dx, dt = np.concatenate(differences, axis=1)
        good = np.isfinite(dx) & np.isfinite(dt)
        dx, dt = dx[good], dt[good]
        slope = 0.0
        for _ in range(5):
            left = np.abs(dx - slope * dt)
            kept = left <= 3.0 * 1.4826 * np.median(left) if len(left) else left < 0.0
            squares = float(dt[kept] @ dt[kept])
            if kept.sum() < FEWEST_OF_BASELINE or squares <= 0.0:
                slope = 0.0
                break
            slope = float(dx[kept] @ dt[kept]) / squares
            rest = dx[kept] - slope * dt[kept]
            # Neighbouring differences share a session: their noise is not independent.
            variance = 2.0 * float(rest @ rest) / kept.sum() / squares
        if slope != 0.0:
            slope *= slope**2 / (slope**2 + variance)
        for _, x in one:
            x.slope = slope


def share_scatter(sisters: Sequence[ArmHistory]) -> None:
    """What sessions differ by when nothing changes, beyond what their residuals say: of the median arm of the type,
    from differences of neighbours, which steps hardly touch. How much more or less an arm has is for all its sessions
    to say."""
    for one in (of_all(sisters, key) for key in keys(sisters)):
        excess = []
        for history, x in one:
            value = history.without_temperature(x)
            there = np.isfinite(value)
            step, noise = np.diff(value[there]), x.std[there] ** 2
            if len(step) >= 3:
                excess.append(np.median(step**2 / (2.0 * _MEDIAN_OF_SQUARE) - (noise[1:] + noise[:-1]) / 2.0))
        scatter = math.sqrt(max(float(np.median(excess)), 0.0)) if excess else 0.0
        for _, x in one:
            x.scatter = max(scatter, LEAST_SCATTER)


def find_outliers(sisters: Sequence[ArmHistory]) -> None:
    """Arms whose friction is not that of their sisters, each shrunk toward them by how little it is known."""
    if len(sisters) < FEWEST_OF_BASELINE:
        return
    for key in keys(sisters):
        if key[1] not in ("Fv", "Fc"):
            continue
        values, stds, arms = [], [], []
        for history, one in of_all(sisters, key):
            if np.isfinite(one.change[: history.baseline]).any():
                first = one.change[: history.baseline] * one.scale + one.reference
                values.append(float(np.nanmean(first)))
                stds.append(float(np.nanmean(one.std[: history.baseline])) * one.scale / math.sqrt(history.baseline))
                arms.append(history)
        if len(values) < FEWEST_OF_BASELINE:
            continue
        value, std = np.array(values), np.array(stds)
        centre = float(np.median(value))
        spread = 1.4826 * float(np.median(np.abs(value - centre)))
        between = max(spread**2 - float(np.median(std**2)), 1e-12 * centre**2 + 1e-300)
        shrunk = centre + (value - centre) * between / (between + std**2)
        for history, raw, one_shrunk, deviation in zip(arms, value, shrunk, std, strict=True):
            apart = (raw - centre) / math.sqrt(between + deviation**2)
            if abs(apart) > OUTLIER:
                history.outliers.append(
                    {
                        "joint": key[0],
                        "parameter": NAMES[key[1]],
                        "value": float(one_shrunk),
                        "sisters": centre,
                        "deviations": float(apart),
                    }
                )
