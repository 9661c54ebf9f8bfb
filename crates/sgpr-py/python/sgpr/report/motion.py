"""The report on an excitation trajectory."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Excitation, Robot
from .colours import BASELINE, line_of
from .errors import box
from .figures import MANY_NAMES, axis, layout, log_axis, rounded
from .markup import Html, Section, join, paragraph, plot, prose, table
from .numbers import counted, significant
from .page import page
from .settings import settings_section

SHOWN_SAMPLES = 500
# Criteria that are logarithms already.
LOGARITHMS = ("d_optimality", "hadamard")
DECADE = 10.0
# Limits that are met but for rounding.
WITHIN = 1.0 + 1e-6
# What holds where a setting was not given; one that is not here does not act then.
ROBOT = "as in the robot"
WITHOUT = {"position_range": ROBOT, "max_velocity": ROBOT, "max_torque": ROBOT, "start": "zero or mid-range"}
QUANTITIES = (("position", "position [{0}]"), ("velocity", "speed [{0}/s]"), ("acceleration", "acceleration [{0}/s²]"))


@dataclass(frozen=True)
class MotionPage:
    """All that the page shows.

    - `data`: "versions", and "settings" if they are known, as in excitation.json
    """

    robot: Robot
    found: Excitation
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        motion, plots = self._motion()
        search, more = self._search()
        amount, curves = self._amount()
        asked = {"Asked for": self._asked_for()} if "settings" in self.data else {}
        settings = {**asked, "Versions": self.data["versions"]}
        sections = [
            Section("motion", "Motion", motion),
            Section("limits", "Largest values", self._limits()),
            Section("excitation", "What it reveals", self._excitation()),
            Section("amount", "How long to record", amount),
            Section("search", "Search", search),
            Section("settings", "Settings and provenance", settings_section(settings)),
        ]
        payload = {"figures": plots | curves | more, "switches": {}, "torque": None}
        return page(f"Excitation trajectory for {self.robot.name}", self._lead(), sections, payload)

    def _asked_for(self) -> dict[str, Any]:
        """Settings that this motion has, with what stands for those that were not given."""
        settings = self.data["settings"]
        others = ["duration", "points"] if settings["basis"] == "fourier" else ["fundamental_hz", "terms", "harmonics"]
        others += ["terms"] if settings["harmonics"] is not None else []
        texts = {name: WITHOUT.get(name) if value is None else value for name, value in settings.items()}
        return {name: value for name, value in texts.items() if value is not None and name not in others}

    def _lead(self) -> Html:
        report = self.found.report
        criterion = self.found.criterion
        all_of_them = counted(report["base_parameters"], kind_of_parameters(report))
        sentences: list[object] = [
            f"The motion excites {report['rank']} of {all_of_them}; its condition number is "
            f"{significant(report['condition'])}."
        ]
        if criterion != "condition":
            sentences.append(f"Criterion {criterion}: {significant(self.found.value)}.")
        tightest = f"It uses {100 * self.found.utilisation:.4g} % of its tightest limit, between samples too: "
        sentences.append(prose(f"{tightest}{self.found.tightest}."))
        if self.found.status == "interrupted":
            sentences.append("The search was stopped: this is the best motion that it had found.")
        return box(sentences, bad=report["rank"] < report["base_parameters"] or self.found.utilisation > WITHIN)

    def _motion(self) -> tuple[Html, dict[str, Any]]:
        trajectory = self.found.trajectory
        time = np.linspace(0.0, trajectory.duration, SHOWN_SAMPLES)
        places, figures = [], {}
        for (name, label), values in zip(QUANTITIES, trajectory.at(time), strict=True):
            place = f"{name}-plot"
            unit = " or ".join(dict.fromkeys(self.robot.position_units))
            places.append(plot(place, 320, f"{name} of every joint over time"))
            lines = [
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": joint,
                    "x": rounded(time),
                    "y": rounded(values[:, k]),
                    "line": line_of(k) | {"width": 1.5},
                }
                for k, joint in enumerate(self.robot.joint_names)
            ]
            figures[place] = {
                "data": lines,
                "layout": layout(xaxis=axis("time [s]"), yaxis=axis(label.format(unit)), margin=MANY_NAMES),
            }
        return join(places), figures

    def _limits(self) -> Html:
        peaks = self.found.peaks
        rows = [
            [
                name,
                *map(
                    significant,
                    (*peaks["position"][k], peaks["velocity"][k], peaks["acceleration"][k], peaks["torque"][k]),
                ),
            ]
            for k, name in enumerate(self.robot.joint_names)
        ]
        position, torque = (", ".join(dict.fromkeys(u)) for u in (self.robot.position_units, self.robot.torque_units))
        columns = [
            "joint",
            f"lowest position [{position}]",
            f"highest position [{position}]",
            f"speed [{position}/s]",
            f"acceleration [{position}/s²]",
            f"torque [{torque}]",
        ]
        return table("Largest values in continuous time", columns, rows)

    def _excitation(self) -> Html:
        report = self.found.report
        rows = [
            ["condition number", significant(report["condition"])],
            ["condition number, columns of equal length", significant(report["scaled_condition"])],
            ["Frobenius condition number", significant(report["frobenius_condition"])],
            ["sum of condition numbers of the links", significant(report["sum_of_conditions"])],
            ["log determinant per sample", significant(report["log_determinant"])],
        ]
        parts = [table("Excitation of the base parameters", ["figure", "value"], rows)]
        if nominal := report.get("nominal"):
            text = "The torque of effects is differentiated at nominal values: the motion is good for values near them."
            values = [[name, significant(value)] for name, value in nominal.items()]
            parts += [paragraph(text), table("Nominal values", ["parameter", "value"], values)]
        if hidden := report.get("hidden"):
            parts.append(paragraph(f"No motion tells these from other parameters: {', '.join(hidden)}."))
        return join(parts)

    def _amount(self) -> tuple[Html, dict[str, Any]]:
        """What uncertain parameters add to the torque, over seconds."""
        forecast = self.found.forecast
        seconds = forecast["seconds"]
        lines = [
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": joint,
                "x": rounded(seconds),
                "y": rounded(deviation / noise),
                "line": line_of(k) | {"width": 1.5},
                "hovertemplate": "%{x:.3g} s: %{y:.2g}<extra>%{fullData.name}</extra>",
            }
            for k, (joint, deviation, noise) in enumerate(
                zip(self.robot.joint_names, forecast["standard_deviation"].T, forecast["noise"], strict=True)
            )
        ]
        enough = {
            "type": "scatter",
            "mode": "lines",
            "name": "enough",
            "x": rounded([seconds[0], seconds[-1]]),
            "y": rounded([1.0 / 3.0, 1.0 / 3.0]),
            "line": {"color": BASELINE, "width": 1, "dash": "dot"},
            "hoverinfo": "skip",
        }
        label = "uncertain torque / noise"
        shown = np.concatenate([rounded_line["y"] for rounded_line in [*lines, enough]]).astype(float)
        shown = shown[np.isfinite(shown) & (shown > 0.0)]
        figure = {
            "data": [*lines, enough],
            "layout": layout(
                xaxis=axis("seconds recorded", type="log", tickvals=rounded(seconds, 3)),
                yaxis=axis(label, type="log", **even_ticks(shown.min(), shown.max())),
                margin=MANY_NAMES,
            ),
        }
        note = (
            "What parameters that are identified from this motion, repeated, add to the torque of other motion of its "
            "kind (standard deviation), as a share of what the model leaves of it, the noise. A third makes the "
            "error larger by a twentieth. Half a second counts as one independent equation of each joint, as on five "
            "real robots."
        )
        said = []
        if known := self.data.get("how_much_data"):
            answer = known["answer"]
            said.append(paragraph(f"{answer[0].upper()}{answer[1:]}."))
        return join([*said, plot("amount-plot", 320, label, note)]), {"amount-plot": figure}

    def _search(self) -> tuple[Html, dict[str, Any]]:
        history = self.found.history
        lines = []
        drawn = []
        for number in np.unique(history[:, 0]):
            own = history[history[:, 0] == number]
            best = np.minimum.accumulate(own[:, 2])
            drawn.append(best)
            lines.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"search {int(number) + 1}",
                    "x": rounded(own[:, 1]),
                    "y": rounded(best),
                    "line": line_of(int(number)) | {"width": 1.5},
                }
            )
        label = f"best {self.found.criterion}, smoothed"
        figure = {
            "data": lines,
            "layout": layout(xaxis=axis("evaluation"), yaxis=self._search_axis(label, np.concatenate(drawn))),
        }
        ends = [[f"search {k + 1}", significant(value)] for k, value in enumerate(self.found.values)]
        body = join([plot("search-plot", 320, label), table("Where the searches ended", ["search", "value"], ends)])
        return body, {"search-plot": figure}

    def _search_axis(self, label: str, values: NDArray[np.float64]) -> dict[str, Any]:
        """Logarithmic for condition numbers that fall by a decade or more, with ticks between decades if these are few.

        - `values`: what is drawn
        """
        values = values[np.isfinite(values)]
        low, high = (values.min(), values.max()) if len(values) else (1.0, 1.0)
        if self.found.criterion in LOGARITHMS or low <= 0.0 or high < DECADE * low:
            return axis(label)
        if high > DECADE**2 * low:
            return log_axis(label)
        return axis(label, type="log", **even_ticks(low, high))


def even_ticks(low: float, high: float) -> dict[str, Any]:
    """Ticks at 1, 2 and 5 times powers of ten, written out."""
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [digit * 10.0**power for power in decades for digit in (1, 2, 5)]
    return {"tickmode": "array", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}


def kind_of_parameters(report: dict[str, Any]) -> str:
    """What the columns of W stand for."""
    return "parameter" if report.get("nominal") else "base parameter"
