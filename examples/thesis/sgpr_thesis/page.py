"""The figures as one page, numbered as in the thesis."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sgpr import Simulation, Trajectory
from sgpr.report.colours import line_of
from sgpr.report.figures import MANY_NAMES, axis, layout, rounded
from sgpr.report.markup import Html, Section, element, join, paragraph, plot, table
from sgpr.report.numbers import significant
from sgpr.report.page import page
from sgpr.report.settings import settings_section

from . import published
from .beyond import PAYLOAD_GAINS
from .experiments import IDENTIFIED, INTERNAL, SEMI_PARAMETRIC, Thesis

# Tracking is drawn for the models of the thesis, errors for all.
DRAWN = (INTERNAL, IDENTIFIED, SEMI_PARAMETRIC)

WANTED = "wanted"
WANTED_LINE: dict[str, Any] = {"color": "#222222", "dash": "dot"}

SHOWN_SAMPLES = 400
HEIGHT = 300
LEGEND_BELOW = {"orientation": "h", "x": 0, "xanchor": "left", "y": -0.15, "yanchor": "top"}


def html(thesis: Thesis, data: dict[str, Any]) -> str:
    """The file."""
    figures = Figures()
    sections = [
        Section("noise", "Differentiated positions", _differentiation(thesis, figures)),
        Section("motions", "Excitation trajectories", _motions(thesis, figures)),
        Section("case-1", "Case 1: tracking", _case_1(thesis, figures)),
        Section("study", "Excitation study", _study(thesis, figures)),
        Section("case-2", "Case 2: tracking", _case_2(thesis, figures)),
        Section("beyond", "Where the thesis stops", _beyond(thesis, figures)),
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

    def lines(self, label: str, unit: str, curves: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Html:
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
                    "line": (WANTED_LINE if name == WANTED else line_of(index)) | {"width": 1.5},
                }
            )
        settings: dict[str, Any] = {"xaxis": axis("time [s]"), "yaxis": axis(unit)}
        if len(curves) > 6:
            settings |= {"legend": {**LEGEND_BELOW, "y": -0.25}, "margin": {"l": 60, "r": 16, "t": 36, "b": 140}}
            return self._add(label, data, HEIGHT + 90, **settings)
        if len(curves) > 4:
            settings["margin"] = MANY_NAMES
        return self._add(label, data, **settings)

    def bars(self, label: str, unit: str, names: Sequence[str], groups: dict[str, ArrayLike]) -> Html:
        """A plot of grouped bars; errors differ by a factor of a thousand."""
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
        # More than four names need two rows, which the tool bar would cover above the plot.
        below: dict[str, Any] = {}
        if len(groups) > 4:
            below = {"legend": LEGEND_BELOW, "margin": {"l": 60, "r": 16, "t": 36, "b": 80}}
        return self._add(
            label, data, yaxis=axis(unit, type="log", dtick=1, range=_decades(data)), barmode="group", **below
        )

    def _add(self, label: str, data: list[dict[str, Any]], height: int = HEIGHT, **settings: Any) -> Html:
        place = f"figure-{len(self.plots) + 1}"
        self.plots[place] = {"data": data, "layout": layout(**settings)}
        return join([element("h3", label), plot(place, height, label)])


def _decades(bars: Sequence[dict[str, Any]]) -> list[int]:
    """Whole decades around all bars, so that the lowest has a length and there are two numbers at the axis."""
    sizes = np.log10([size for bar in bars for size in bar["y"] if size])
    return [int(np.floor(sizes.min())), int(np.floor(sizes.max())) + 1]


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
    curves = {name: (run.t, run.q[:, joint]) for name, run in runs.items()}
    # Over the others, which it would vanish under where they follow well.
    curves[WANTED] = (first.t, first.q_wanted[:, joint])
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
            runs = {model: thesis.runs[f"{name} case 1 {motion} {model}"] for model in DRAWN}
            parts += [_tracking(figures, f"Figures {each}: {name}, {motion}", runs, k) for k in range(len(joints))]
    for motion, number in (("train", "5-10"), ("test", "5-11")):
        errors = {run["model"]: run["rmse"] for run in thesis.data["kernels"] if run["motion"] == motion}
        label = f"Figure {number}: one length scale or one per input, two-link arm, {motion}"
        parts.append(figures.bars(label, "position error [rad]", ["joint 1", "joint 2"], errors))
    return join(parts)


def _study(thesis: Thesis, figures: Figures) -> Html:
    rows = thesis.data["table_5_8"]
    joints = [f"joint {k + 1}" for k in range(thesis.arms["puma560"].robot.dof)]
    by_name = {row["motion"]: row for row in rows}
    three = {
        "trajectory 1": by_name["cond(W_fe)"]["errors"][SEMI_PARAMETRIC],
        "trajectory 2": by_name["cond(W_nfe)"]["errors"][SEMI_PARAMETRIC],
        "trajectory 3": by_name["HFS + cond(W_nfe)"]["errors"][SEMI_PARAMETRIC],
    }
    runs = {row["motion"]: thesis.runs[f"table 5-8 {row['motion']} {SEMI_PARAMETRIC} test 1"] for row in rows}
    body = []
    for row in rows:
        for label, errors in (("thesis", np.array(row["published"])), *row["errors"].items()):
            body.append([row["motion"], label, *map(significant, errors), significant(errors.sum())])
    return join(
        [
            figures.bars("Figure 5-13: models of trajectories 1 to 3", "position error [rad]", joints, three),
            _tracking(figures, "Figure 5-15: semi-parametric models of eight training sets", runs, 1),
            table(
                "Table 5-8: position error [rad]", ["trained on", "model", *joints, "sum"], body, text_columns=(0, 1)
            ),
        ]
    )


def _case_2(thesis: Thesis, figures: Figures) -> Html:
    free = {"wrong internal model, no feedback": thesis.runs["case 2 no feedback"]}
    parts = [_tracking(figures, f"Figure 5-{16 + k}: two-link arm", free, k) for k in range(2)]
    cases = (
        ("two_link", "case 2", "case_2", {"train": "Figure 5-18, C-17, C-18", "test": "Figure 5-19, C-19, C-20"}),
        ("puma560", "puma case 2", "case_2_puma", {"train": "Not in the thesis", "test": "Not in the thesis"}),
    )
    for arm, label, key, numbers in cases:
        joints = [f"joint {k + 1}" for k in range(thesis.arms[arm].robot.dof)]
        tracking = thesis.data[key]["tracking"]
        for motion, number in numbers.items():
            errors = {run["model"]: run["rmse"] for run in tracking if run["motion"] == motion}
            parts.append(figures.bars(f"{number}: {arm}, {motion}", "position error [rad]", joints, errors))
            runs = {model: thesis.runs[f"{label} {motion} {model}"] for model in DRAWN}
            parts += [_tracking(figures, f"{number}: {arm}, {motion}", runs, k) for k in range(len(joints))]
    return join(parts)


def _beyond(thesis: Thesis, figures: Figures) -> Html:
    parts = []
    laws = thesis.data["control_laws"]
    for arm in thesis.arms.values():
        joints = [f"joint {k + 1}" for k in range(arm.robot.dof)]
        for law in dict.fromkeys(row["law"] for row in laws):
            errors = {row["model"]: row["rmse"] for row in laws if (row["robot"], row["law"]) == (arm.name, law)}
            parts.append(figures.bars(f"{law}: {arm.name}", "position error [rad]", joints, errors))
    for stiffness, (kp, kd) in PAYLOAD_GAINS.items():
        for kind, label, unit in (
            ("error", "A payload picked up after 4 s: norm of the position error", "position error [rad]"),
            ("mass", "Mass of the payload as tracked", "mass [kg]"),
        ):
            start = f"{kind}, {stiffness}, "
            curves = {
                name.removeprefix(start): curve for name, curve in thesis.curves.items() if name.startswith(start)
            }
            parts.append(figures.lines(f"{label}, {kp:g} N·m/rad and {kd:g} N·m·s/rad", unit, curves))
    return join(parts)
