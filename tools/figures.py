"""The figures of the documentation, from the logs in data/: `make figures`.

    python tools/figures.py [FOLDER]

Writes identification.png, diagnosis.png and intervals.png, by default to docs/images, and prints their figures.
"""

import csv
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray
from sgpr.cli import main

matplotlib.use("agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]

DEMO = ROOT / "data" / "demo"
HIDDEN = ROOT / "data" / "hidden"
EFFECTS = ("--effects", "viscous_friction", "coulomb_friction", "rotor_inertia")
GREY, BLUE, ORANGE, RED = "#888888", "#0072b2", "#e69f00", "#d55e00"
"""Colours that are told apart by colour-blind eyes, too."""

plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def run(*arguments: object) -> None:
    """A command of sgpr, without a word."""
    try:
        main([*map(str, arguments), "--quiet", "--no-report"])
    except SystemExit as end:
        if end.code:
            raise


def columns(path: Path) -> dict[str, Array]:
    """The numbers of a CSV file by name."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    numeric = [k for k, name in enumerate(rows[0]) if name != "file"]
    # What a predictor leaves out at the ends is empty.
    values = np.array([[float(row[k] or "nan") for k in numeric] for row in rows[1:]])
    return {rows[0][k]: values[:, place] for place, k in enumerate(numeric)}


def demo_logs() -> list[object]:
    """Three logs to train, one to test."""
    train = [DEMO / f"train_{number}.csv.gz" for number in (1, 2, 3)]
    return ["--robot", DEMO / "robot.urdf", "--train", *train, "--test", DEMO / "test.csv.gz", *EFFECTS]


def rms(values: Array) -> float:
    """Root mean square of what is there."""
    return float(np.sqrt(np.nanmean(values**2)))


def identification(work: Path, out: Path) -> str:
    """Measured torque, that of the robot file and that of the identified model, on a log that the fit never saw."""
    run("identify", *demo_logs(), "--out", work / "identify")
    log = columns(work / "identify" / "predictions.csv")
    joint = "joint_3"
    t, measured = log["t"] - log["t"][0], log[f"{joint}_measured"]
    shown = t < 8.0
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 3.6), sharex=True, height_ratios=[3, 2])
    for name, style, label in (("before", ORANGE, "robot file"), ("after", BLUE, "identified model")):
        predicted = log[f"{joint}_{name}"]
        above.plot(t[shown], predicted[shown], color=style, lw=1.2, label=label)
        below.plot(t[shown], (measured - predicted)[shown], color=style, lw=0.9)
    above.plot(t[shown], measured[shown], color="black", lw=0.7, ls=(0, (4, 2)), label="measured")
    above.set_ylabel(f"torque of {joint}, N·m")
    above.legend(ncol=3, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    below.set(ylabel="residual, N·m", xlabel="time, s")
    figure.tight_layout()
    save(figure, out / "identification.png")
    before, after = (rms(measured - log[f"{joint}_{name}"]) for name in ("before", "after"))
    return f"identification: {joint}, RMS residual of the unfiltered torque {before:.3g} -> {after:.3g} N·m"


def diagnosis(work: Path, out: Path) -> str:
    """What a model leaves over against the speed, the effect that was found, and what it brings."""
    train = [HIDDEN / f"train_{number}.csv.gz" for number in (1, 3)]
    logs = ["--robot", HIDDEN / "robot.urdf", "--train", *train, "--test", HIDDEN / "test.csv.gz", *EFFECTS]
    run("identify", *logs, "--out", work / "without")
    run("diagnose", *logs, "--out", work / "with")
    without, found = (columns(work / name / "predictions.csv") for name in ("without", "with"))
    joint = "joint_2"
    measured = without[f"{joint}_measured"]
    left, gone = measured - without[f"{joint}_after"], measured - found[f"{joint}_after"]
    # The log is seen by its position alone; the speed is only the axis of the picture.
    speed = logged_speed(HIDDEN / "test.csv.gz", "dq_2")
    figure, axes = plt.subplots(1, 2, figsize=(7.5, 3.1), sharey=True)
    texts = ("the model lacks something", "with the effect that was found: stribeck_friction")
    for axis, residual, text, colour in zip(axes, (left, gone), texts, (ORANGE, BLUE), strict=True):
        axis.scatter(speed, residual, s=3, color=colour, alpha=0.35, edgecolors="none")
        axis.axhline(0, color=GREY, lw=0.6)
        axis.set(xlabel=f"speed of {joint}, rad/s", xlim=(-1.0, 1.0), xticks=(-1.0, -0.5, 0.0, 0.5, 1.0))
        axis.set_title(f"{text}\nRMS {rms(residual):.3f} N·m", fontsize=9)
    axes[0].set_ylabel("measured minus predicted, N·m")
    figure.tight_layout()
    save(figure, out / "diagnosis.png")
    return f"diagnosis: {joint}, RMS residual of the unfiltered torque {rms(left):.3f} -> {rms(gone):.3f} N·m"


def logged_speed(path: Path, name: str) -> Array:
    """A column of a compressed log."""
    import gzip

    with gzip.open(path, "rt") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return np.array([float(row[rows[0].index(name)]) for row in rows[1:]])


def intervals(work: Path, out: Path) -> str:
    """What a semi-parametric model expects of an unseen log, and how much of it is within."""
    run("learn", *demo_logs(), "--out", work / "learn")
    log = columns(work / "learn" / "predictions.csv")
    joint = "joint_4"
    t = log["t"] - log["t"][0]
    residual, half = log[f"{joint}_measured"] - log[f"{joint}_after"], log[f"{joint}_interval_95"]
    physics = log[f"{joint}_measured"] - log[f"{joint}_before"]
    shown = t < 8.0
    figure, axis = plt.subplots(figsize=(7, 2.8))
    axis.fill_between(t[shown], -half[shown], half[shown], color=BLUE, alpha=0.2, lw=0, label="expected: 95 %")
    axis.plot(t[shown], physics[shown], color=ORANGE, lw=0.7, label="left by the physics")
    axis.plot(t[shown], residual[shown], color=BLUE, lw=0.7, label="left with the process")
    axis.set(xlabel="time, s", ylabel=f"residual of {joint}, N·m")
    axis.legend(ncol=3, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.tight_layout()
    save(figure, out / "intervals.png")
    known = np.isfinite(residual) & np.isfinite(half)
    within = 100.0 * np.mean(np.abs(residual[known]) <= half[known])
    return f"intervals: {within:.1f} % of the samples of {joint} are within their intervals of 95 %"


def save(figure: Any, path: Path) -> None:
    """The same bytes for the same numbers."""
    figure.savefig(path, dpi=150, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        for draw in (identification, diagnosis, intervals):
            print(draw(Path(place), folder))
