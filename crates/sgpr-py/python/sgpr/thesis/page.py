"""The figures as one page, numbered as in the thesis."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import Simulation, Trajectory
from ..report.colours import line_of
from ..report.figures import axis, layout, rounded
from ..report.markup import Html, Section, element, join, paragraph, plot, table
from ..report.numbers import significant
from ..report.page import page
from ..report.settings import settings_section
from . import published
from .experiments import Thesis

SHOWN_SAMPLES = 400
HEIGHT = 300


def html(thesis: Thesis, data: dict[str, Any]) -> str:
    """The file."""
    figures = Figures()
    sections = [
        Section("noise", "Differentiated positions", _differentiation(thesis, figures)),
        Section("motions", "Excitation trajectories", _motions(thesis, figures)),
        Section("case-1", "Case 1: tracking", _case_1(thesis, figures)),
        Section("study", "Excitation study", _study(thesis, figures)),
        Section("case-2", "Case 2: tracking", _case_2(thesis, figures)),
        Section("settings", "Versions", settings_section({"Versions": data["versions"]})),
    ]
    lead = paragraph(
        "Experiments of S. Krishnamoorthi, Model-Based Compensation for Serial Manipulators through Semi-Parametric "
        "Gaussian Process Regression (TU Delft, 2018), run again; the tables are in thesis.md."
    )
    return page("The thesis, run again", lead, sections, {"figures": figures.plots, "switches": {}, "torque": None})


class Figures:
    """Plots by the name of their place."""

    def __init__(self) -> None:
        """None yet."""
        self.plots: dict[str, Any] = {}

    def lines(self, label: str, unit: str, curves: dict[str, tuple[ArrayLike, ArrayLike]]) -> Html:
        """A plot of curves over time."""
        data = []
        for index, (name, (time, values)) in enumerate(curves.items()):
            time, values = np.asarray(time), np.asarray(values)
            step = max(1, len(time) // SHOWN_SAMPLES)
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": name,
                    "x": rounded(time[::step]),
                    "y": rounded(values[::step]),
                    "line": {"width": 1.5, **line_of(index)},
                }
            )
        return self._add(label, data, xaxis=axis("time [s]"), yaxis=axis(unit))

    def bars(self, label: str, unit: str, names: Sequence[str], groups: dict[str, ArrayLike]) -> Html:
        """A plot of grouped bars."""
        data = [
            {
                "type": "bar",
                "name": name,
                "x": list(names),
                "y": rounded(values),
                "marker": {"color": line_of(index)["color"]},
            }
            for index, (name, values) in enumerate(groups.items())
        ]
        return self._add(label, data, yaxis=axis(unit), barmode="group")

    def _add(self, label: str, data: list[dict[str, Any]], **settings: Any) -> Html:
        place = f"figure-{len(self.plots) + 1}"
        self.plots[place] = {"data": data, "layout": layout(**settings)}
        return join([element("h3", label), plot(place, HEIGHT, label)])


def _differentiation(thesis: Thesis, figures: Figures) -> Html:
    run = thesis.runs["puma560 experiment"]
    shown = run.t <= 1.0 / published.FUNDAMENTAL_HZ
    rate = 1.0 / (run.t[1] - run.t[0])
    twice = np.gradient(np.gradient(run.q_measured[:, 0], 1.0 / rate), 1.0 / rate)
    curves = {"differentiated twice": (run.t[shown], twice[shown]), "true": (run.t[shown], run.ddq[shown, 0])}
    return figures.lines("Figure 5-2: acceleration of joint 1, PUMA 560", "acceleration [rad/s²]", curves)


def _motions(thesis: Thesis, figures: Figures) -> Html:
    labels = {
        "Figure 5-4: trajectory 1, cond(W_fe), PUMA 560": thesis.motions["puma560 condition fe"].trajectory,
        "Figure 5-5: cond(W_fe), two-link arm": thesis.motions["two_link condition fe"].trajectory,
        "Figure 5-12: trajectory 2, cond(W_nfe), PUMA 560": thesis.motions["puma560 condition nfe"].trajectory,
    }
    if thesis.high_frequency is not None:
        labels["Figure 5-14: high-frequency series, PUMA 560"] = thesis.high_frequency
    parts = []
    for label, motion in labels.items():
        for quantity, unit, values in _quantities(motion):
            time = np.linspace(0.0, motion.duration, SHOWN_SAMPLES)
            curves = {name: (time, values[:, k]) for k, name in enumerate(motion.joint_names)}
            parts.append(figures.lines(f"{label}: {quantity}", unit, curves))
    return join(parts)


def _quantities(motion: Trajectory) -> list[tuple[str, str, Any]]:
    values = motion.at(np.linspace(0.0, motion.duration, SHOWN_SAMPLES))
    names = (("position", "position [rad]"), ("speed", "speed [rad/s]"), ("acceleration", "acceleration [rad/s²]"))
    return [(name, unit, each) for (name, unit), each in zip(names, values, strict=True)]


def _tracking(figures: Figures, label: str, runs: dict[str, Simulation], joint: int) -> Html:
    first = next(iter(runs.values()))
    curves = {"wanted": (first.t, first.q_wanted[:, joint])}
    curves |= {name: (run.t, run.q[:, joint]) for name, run in runs.items()}
    return figures.lines(f"{label}, joint {joint + 1}", "position [rad]", curves)


def _case_1(thesis: Thesis, figures: Figures) -> Html:
    free = {"identified model, no feedback": thesis.runs["puma560 no feedback"]}
    parts = [_tracking(figures, "Figure 5-3: PUMA 560 without feedback", free, 1)]
    for name, bars, each in (("puma560", "5-6, 5-7", "C-1 to C-12"), ("two_link", "5-8, 5-9", "C-13 to C-16")):
        tracking = thesis.data["case_1"][name]["tracking"]
        joints = [f"joint {k + 1}" for k in range(thesis.arms[name].robot.dof)]
        for motion in ("train", "test 1"):
            errors = {run["model"]: run["rmse"] for run in tracking if run["motion"] == motion}
            label = f"Figures {bars}: {name}, {motion}"
            parts.append(figures.bars(label, "position error [rad]", joints, errors))
            runs = {model: thesis.runs[f"{name} case 1 {motion} {model}"] for model in errors}
            parts += [_tracking(figures, f"Figures {each}: {name}, {motion}", runs, k) for k in range(len(joints))]
    return join(parts)


def _study(thesis: Thesis, figures: Figures) -> Html:
    rows = thesis.data["table_5_8"]
    joints = [f"joint {k + 1}" for k in range(thesis.arms["puma560"].robot.dof)]
    by_name = {row["motion"]: row for row in rows}
    three = {
        "trajectory 1": by_name["cond(W_fe)"]["parametric"],
        "trajectory 2": by_name["cond(W_nfe)"]["parametric"],
        "trajectory 3": by_name["HFS + cond(W_nfe)"]["parametric"],
    }
    runs = {row["motion"]: thesis.runs[f"table 5-8 {row['motion']} parametric test 1"] for row in rows}
    body = [[row["motion"], *map(significant, row["parametric"]), significant(row["parametric"].sum())] for row in rows]
    return join(
        [
            figures.bars("Figure 5-13: models of trajectories 1 to 3", "position error [rad]", joints, three),
            _tracking(figures, "Figure 5-15: models of eight training sets", runs, 1),
            table("Table 5-8: identified models, position error [rad]", ["trained on", *joints, "sum"], body),
        ]
    )


def _case_2(thesis: Thesis, figures: Figures) -> Html:
    free = {"wrong internal model, no feedback": thesis.runs["case 2 no feedback"]}
    parts = [_tracking(figures, f"Figure 5-{16 + k}: two-link arm", free, k) for k in range(2)]
    tracking = thesis.data["case_2"]["tracking"]
    numbers = {"train": ("Figure 5-18", "Figures C-17, C-18"), "test": ("Figure 5-19", "Figures C-19, C-20")}
    for motion, (bars, each) in numbers.items():
        errors = {run["model"]: run["rmse"] for run in tracking if run["motion"] == motion}
        parts.append(figures.bars(f"{bars}: {motion}", "position error [rad]", ["joint 1", "joint 2"], errors))
        runs = {model: thesis.runs[f"case 2 {motion} {model}"] for model in errors}
        parts += [_tracking(figures, f"{each}: {motion}", runs, k) for k in range(2)]
    return join(parts)
