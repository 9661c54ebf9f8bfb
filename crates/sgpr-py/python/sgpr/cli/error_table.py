"""Errors joint by joint, for people."""

from collections.abc import Mapping
from pathlib import PurePath

from .. import Comparison, JointComparison
from ..report.numbers import percent, significant
from .console import Output


def show_errors(comparisons: Mapping[str, Comparison], output: Output) -> None:
    """A table of one or two models, the last one being the one that matters, beside the two baselines."""
    columns = ["joint", "unit"]
    columns += [f"RMSE {name}" for name in comparisons] if len(comparisons) > 1 else ["RMSE"]
    columns += ["% of torque", "fit %", "R²", "largest", "at", "zero", "gravity only"]
    scored = [joint for joint in list(comparisons.values())[-1].joints if joint.samples]
    with_log = len({joint.largest_error_log for joint in scored}) > 1
    all_joints = zip(*(found.joints for found in comparisons.values()), strict=True)
    rows = []
    for of_joint in all_joints:
        last = of_joint[-1]
        rows.append(
            [
                last.joint,
                last.unit,
                *(significant(joint.rmse) for joint in of_joint),
                percent(last.relative_error_percent),
                percent(last.fit_percent),
                significant(last.r2, 4),
                significant(last.largest_error),
                _when(last, with_log),
                significant(last.rmse_zero),
                significant(last.rmse_gravity),
            ]
        )
    spare = ("R²", "zero", "gravity only", "at", "largest", "fit %", "unit")
    output.table(columns, rows, text_columns=(0, 1), spare=spare)
    unmoved = [
        joints[0].joint
        for joints in zip(*(c.joints for c in comparisons.values()), strict=True)
        if not joints[0].samples
    ]
    if unmoved:
        output.line(f"not scored, as they never move: {', '.join(unmoved)}", "yellow")


def _when(joint: JointComparison, with_log: bool) -> str:
    if not joint.samples:
        return ""
    moment = f"{significant(joint.largest_error_time, 4)} s"
    return f"{moment}, {PurePath(joint.largest_error_log).name}" if with_log else moment
