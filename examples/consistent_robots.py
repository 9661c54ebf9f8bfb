"""What physical consistency costs on five real robots: held-out errors of unconstrained and consistent models.

    python examples/consistent_robots.py

The logs are not part of this repository; `docs/real-data.md` says where they come from. The environment variable
SGPR_DATA names the folder that holds them. The table is the one in `research/consistency.md`.
"""

import sys
from typing import Any

import numpy as np
import sgpr
from real_robots import DATASETS, EFFECTS, Dataset, data_folder, robot_and_logs

FRICTION = ["viscous_friction", "coulomb_friction", "torque_offset"]
# Behind the gear no sensor sees the rotor.
AT_THE_LINK = ("panda", "kuka_lwr")
# Effects that explain most of what consistency costs elsewhere.
MORE = {
    "panda": [
        ["cable_hysteresis@panda_joint4"],
        ["cable_hysteresis@panda_joint4", "stribeck_friction"],
        ["cable_hysteresis"],
    ],
    "baxter": [["spring_balancer@baxter_j2"]],
}
FIFTHS = 5
HEADER = """\
| robot | new motion | effects | unconstrained | consistent | loss \
| parts kept out: unconstrained | consistent | loss \
| as the reference: unconstrained | consistent | loss | reference | `auto` | pull | dearest limit | solver, ms |
|---|---:|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|---:|"""


def row(dataset: Dataset, label: str, effects: list[str], logs: dict[str, Any]) -> str:
    """One line of the table."""
    as_reference = sgpr.identify(logs["robot"], logs["train"], effects=effects, **dataset.reference)

    def errors(**options: Any) -> tuple[float, float, dict[str, Any] | None]:
        model = sgpr.identify(logs["robot"], logs["train"], effects=effects, **options)
        own = sgpr.compare(model, logs["test"]).relative_error_percent
        other = sgpr.compare(model, logs["test"], processing=as_reference).relative_error_with_rests_percent
        return own, other, model.certificate

    def losses(free: float, bound: float) -> str:
        return f"{free:.3f} | {bound:.3f} | {100.0 * (bound / free - 1.0):+.1f} %"

    free, free_there, _ = errors()
    bound, bound_there, certificate = errors(consistent=True)
    chosen, _, other = errors(consistent=True, prior_deviation="auto")
    assert certificate is not None and other is not None
    # Fits of constants take ten times as long.
    with_constants = any("@" in name or name.endswith("hysteresis") for name in effects)
    parts = "- | - | -" if with_constants else losses(*(kept_out(logs, effects, each) for each in (False, True)))
    prices = certificate["prices"]
    dearest = f"{prices[0]['limit']} ({100.0 * prices[0]['share']:.0f} %)" if prices else "-"
    return (
        f"| `{dataset.folder}` | {novelty(logs['train'], logs['test']):.3f} | {label} "
        f"| {losses(free, bound)} | {parts} | {losses(free_there, bound_there)} "
        f"| {reference_of(dataset, effects)} | {chosen:.3f} "
        f"| {other['prior_deviation']:.0f} | {dearest} | {1e3 * certificate['seconds']:.0f} |"
    )


def kept_out(logs: dict[str, Any], effects: list[str], consistent: bool) -> float:
    """Root mean square of the errors on fifths of the training logs, each predicted from the other four, %."""
    processing = sgpr.identify(logs["robot"], logs["train"], effects=effects).processing
    assert processing is not None
    squares = []
    for known, new in fifths(logs["train"], shortest=8.0 / processing.cutoff_hz):
        options = {"effects": effects, "consistent": consistent, "cutoff_hz": processing.cutoff_hz}
        model = sgpr.identify(logs["robot"], known, **options)
        squares.append(sgpr.compare(model, new).relative_error_percent ** 2)
    return float(np.sqrt(np.mean(squares)))


def fifths(logs: list[sgpr.Recording], shortest: float) -> list[tuple[list[sgpr.Recording], list[sgpr.Recording]]]:
    """Four fifths of each log, stretches of less than `shortest` seconds left out, and the fifth that is kept out."""
    parts = []
    for part in range(FIFTHS):
        ends = [(log, part * len(log) // FIFTHS, (part + 1) * len(log) // FIFTHS) for log in logs]
        known = [
            log.slice(*rows)
            for log, low, high in ends
            for rows in ((0, low), (high, len(log)))
            if rows[1] - rows[0] > shortest * log.sample_rate_hz
        ]
        parts.append((known, [log.slice(low, high) for log, low, high in ends]))
    return parts


def novelty(train: list[sgpr.Recording], test: list[sgpr.Recording]) -> float:
    """How far test states (position, speed) lie from the nearest training state: median, in standard deviations."""

    def states(logs: list[sgpr.Recording]) -> np.ndarray:
        rows = []
        for log in logs:
            lag, step = (max(1, round(seconds * log.sample_rate_hz)) for seconds in (0.1, 0.05))
            rows.append(np.hstack([log.q[:-lag], log.q[lag:] - log.q[:-lag]])[::step])
        return np.concatenate(rows)

    known = states(train)
    size = known.std(axis=0)
    distances = [np.sqrt(np.mean(((known - state) / size) ** 2, axis=1)).min() for state in states(test)]
    return float(np.median(distances))


def reference_of(dataset: Dataset, effects: list[str]) -> str:
    """The error of the reference: that with springs for a model with springs, if there is one."""
    springs = any(name.startswith(("cable_stiffness", "spring_balancer")) for name in effects)
    of_kind = [v.reference for v in dataset.variants if ("spring" in v.name or "balancer" in v.name) == springs]
    return next((reference for reference in of_kind if reference), dataset.variants[0].reference)


def main() -> int:
    """Run every robot whose logs are there."""
    data = data_folder()
    print(HEADER)
    found = False
    for dataset in DATASETS:
        folder = data / dataset.folder
        if not (folder / dataset.urdf).exists():
            print(f"{dataset.folder}: no logs in {folder}; skipped", file=sys.stderr)
            continue
        found = True
        logs = dict(zip(("robot", "train", "test"), robot_and_logs(folder, dataset), strict=True))
        effects, label = EFFECTS, "all"
        print(row(dataset, label, effects, logs), flush=True)
        if dataset.folder in AT_THE_LINK:
            effects, label = FRICTION, "without rotor inertia"
            print(row(dataset, label, effects, logs), flush=True)
        print(row(dataset, f"{label}, springs", [*effects, "cable_stiffness"], logs), flush=True)
        for more in MORE.get(dataset.folder, []):
            names = ", ".join(f"`{name}`" for name in more)
            print(row(dataset, f"{label}, {names}", [*effects, *more], logs), flush=True)
    return 0 if found else 1


if __name__ == "__main__":
    sys.exit(main())
