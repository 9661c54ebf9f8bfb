"""Robots, logs and models as plain data, for JSON, tables and reports."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import Comparison, Issue, Model, Recording, Robot, SemiParametricModel
from .reading import Log

KEPT_INERTIA = 10


def robot(robot: Robot, path: str, effects: Sequence[str]) -> dict[str, Any]:
    """Joints, mass, base parameters and what the motion can tell of the standard parameters."""
    base = robot.base_parameters(effects)
    exact = robot.base_parameters(effects, recursion=True)
    # A robot file that is not exact, 1.57 for a right angle, has more parameters when taken at its word.
    formulas = exact.formulas if exact.names == base.names else base.formulas
    limits = robot.limits
    joints = [
        {
            "name": name,
            "kind": robot.joint_kinds[k],
            "position_unit": robot.position_units[k],
            "torque_unit": robot.torque_units[k],
            **{key: float(values[k]) for key, values in limits.items()},
        }
        for k, name in enumerate(robot.joint_names)
    ]
    return {
        "file": path,
        "type": "robot",
        "name": robot.name,
        "dof": robot.dof,
        "joints": joints,
        "moving_mass_kg": float(robot.standard_parameters[::KEPT_INERTIA].sum()),
        "gravity": robot.gravity,
        "effects": list(effects),
        "base_parameters": [
            {"name": name, "unit": unit, "expression": expression, "formula": formula}
            for name, unit, expression, formula in zip(base.names, base.units, base.expressions, formulas, strict=True)
        ],
        "standard_parameter_classes": base.classes,
        "warnings": robot.warnings,
    }


def log(recording: Recording, path: str) -> dict[str, Any]:
    """Size, rate, ranges and findings of a recording."""
    return {
        "file": path,
        "type": "log",
        "joints": [_ranges(recording, k) for k in range(recording.dof)],
        "samples": len(recording),
        "duration_s": recording.duration,
        "start_s": int(recording.time_ns[0]) * 1e-9 if len(recording) else None,
        "rate_hz": recording.sample_rate_hz,
        "has_velocity": recording.dq is not None,
        "has_torque": recording.tau is not None,
        "channels": {name: _range(values) for name, values in recording.channels.items()},
        "columns": recording.layout,
        "content_hash": recording.content_hash,
        "notes": list(recording.notes),
        "issues": [issue(found) for found in recording.issues],
    }


def repaired_log(log_: Log, role: str) -> dict[str, Any]:
    """A log with what was done to it."""
    used = [
        {"samples": len(part), "duration_s": part.duration, "rate_hz": part.sample_rate_hz} for part in log_.stretches
    ]
    remaining = [] if log_.stretches == [log_.raw] else [issue(i) for part in log_.stretches for i in part.issues]
    data = log(log_.raw, log_.path)
    return {**data, "role": role, "actions": log_.actions, "used": used, "remaining_issues": remaining}


def issue(found: Issue) -> dict[str, Any]:
    """Something found in a recording."""
    keys = ("kind", "severity", "rank", "time", "channel", "count", "message")
    return {key: getattr(found, key) for key in keys}


def model(model: Model, path: str) -> dict[str, Any]:
    """The head of a model file, and its parameters."""
    return {
        "file": path,
        "type": "model",
        "robot": model.robot.name,
        "joints": model.robot.joint_names,
        "effects": model.effects,
        "parameters": parameters(model),
        "terms": terms(model),
        "processing": processing(model),
        "fit": model.fit,
        "certificate": model.certificate,
        "logs": model.logs,
        "reading": model.reading,
        "history": model.history,
        "library_version": model.library_version,
    }


def any_model(found: Model | SemiParametricModel, path: str) -> dict[str, Any]:
    """The same, with what was learned of the rest if there is a process for it."""
    if isinstance(found, SemiParametricModel):
        return {**model(found.physics_, path), "processes": found.reports_}
    return model(found, path)


def terms(model: Model) -> list[dict[str, Any]]:
    """Constants and parameters of the effects at single sites, one by one."""
    return [
        {"effect": term["effect"], "name": name, "value": value, "standard_deviation": deviation, "unit": unit}
        for term in model.terms
        for name, (value, deviation, unit) in term["parameters"].items()
    ]


def parameters(model: Model) -> list[dict[str, Any]]:
    """Base parameters; a standard deviation that is infinite (null in JSON) goes with `determined: false`."""
    result = []
    for index in range(len(model.parameters)):
        p = model.parameters[index]
        deviation = p.standard_deviation
        if deviation is not None and np.isnan(deviation):
            deviation = None
        result.append(
            {
                "name": p.name,
                "expression": p.expression,
                "unit": p.unit,
                "value": p.value,
                "standard_deviation": deviation,
                "relative_standard_deviation_percent": None if deviation is None else p.relative_standard_deviation,
                "nominal": p.nominal,
                "determined": None if deviation is None else bool(np.isfinite(deviation)),
            }
        )
    return result


def processing(model: Model) -> dict[str, Any] | None:
    """What is done to the logs."""
    chosen = model.processing
    if chosen is None:
        return None
    keys = (
        "cutoff_hz",
        "order",
        "differentiation",
        "torque_cutoff_hz",
        "decimation",
        "standstill_speed",
        "turn_margin",
    )
    return {key: getattr(chosen, key) for key in keys}


JOINT_FIGURES = (
    "joint",
    "unit",
    "samples",
    "rmse",
    "fit_percent",
    "r2",
    "relative_error_percent",
    "largest_error",
    "largest_error_log",
    "largest_error_time",
    "rmse_zero",
    "rmse_gravity",
    "rmse_full_band",
    "rmse_with_rests",
    "relative_error_with_rests_percent",
)


def comparison(found: Comparison) -> dict[str, Any]:
    """The figures of a comparison."""
    return {
        "relative_error_percent": found.relative_error_percent,
        "relative_error_with_rests_percent": found.relative_error_with_rests_percent,
        "joints": [{key: getattr(joint, key) for key in JOINT_FIGURES} for joint in found.joints],
    }


def _ranges(recording: Recording, k: int) -> dict[str, Any]:
    dq, tau = recording.dq, recording.tau
    return {
        "name": recording.joint_names[k],
        "position": _range(recording.q[:, k]),
        "velocity": None if dq is None else _range(dq[:, k]),
        "torque": None if tau is None else _range(tau[:, k]),
    }


def _range(values: Any) -> list[float] | None:
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    return [float(finite.min()), float(finite.max())] if len(finite) else None
