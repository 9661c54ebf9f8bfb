"""The report on a simulation: what was wanted, what happened, what it took."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Robot, Simulation
from .colours import line_of
from .errors import box
from .figures import MANY_NAMES, axis, layout, rounded
from .markup import Html, Section, join, paragraph, plot, table
from .numbers import significant
from .page import page
from .settings import settings_section

SHOWN_SAMPLES = 1000
# What holds where an option was not given.
WITHOUT = {"model": "rigid body of the arm", "position_resolution": "exact", "torque_noise": "none"}


@dataclass(frozen=True)
class TrackingPage:
    """All that the page shows.

    - `data`: the figures, as `--json` prints them; empty if what was asked for is not known
    """

    robot: Robot
    run: Simulation
    data: dict[str, Any]
    versions: dict[str, str]

    def html(self) -> str:
        """The file."""
        run, unit = self.run, " or ".join(dict.fromkeys(self.robot.position_units))
        torque = " or ".join(dict.fromkeys(self.robot.torque_units))
        error = run.q - run.q_wanted
        shown = {
            "wanted": ("Wanted position", f"position [{unit}]", run.q_wanted),
            "error": ("Position minus wanted position", f"error [{unit}]", error),
            "torque": ("Torque of the drives", f"torque [{torque}]", run.tau),
            "friction": ("Friction torque in it", f"torque [{torque}]", run.friction),
        }
        figures = {f"{name}-plot": self._figure(label, values) for name, (_, label, values) in shown.items()}
        sections = [
            Section("tracking", "Tracking", self._errors(error)),
            *(Section(name, title, plot(f"{name}-plot", 320, title)) for name, (title, _, _) in shown.items()),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        worst = int(np.argmax(np.abs(error).max(axis=0)))
        answer = (
            f"The largest position error is {significant(float(np.abs(error[:, worst]).max()))} "
            f"{self.robot.position_units[worst]}, at {self.robot.joint_names[worst]}."
        )
        facts = f"{len(run)} samples, {significant(float(run.t[-1]))} s; positions are those of the arm."
        lead = join([box([answer], bad=False), paragraph(facts, "soft")])
        payload = {"figures": figures, "switches": {}, "torque": None}
        return page(f"Simulation of {self.robot.name}", lead, sections, payload)

    def _errors(self, error: NDArray[np.float64]) -> Html:
        rows = [
            [name, significant(float(rms)), significant(float(most)), unit]
            for name, rms, most, unit in zip(
                self.robot.joint_names,
                self.run.tracking_rmse,
                np.abs(error).max(axis=0),
                self.robot.position_units,
                strict=True,
            )
        ]
        return join(
            [table("Position error", ["joint", "root mean square", "largest", "unit"], rows, text_columns=(0, 3))]
        )

    def _figure(self, label: str, values: NDArray[np.float64]) -> dict[str, Any]:
        step = max(1, len(self.run) // SHOWN_SAMPLES)
        lines = [
            {
                "type": "scatter",
                "mode": "lines",
                "name": joint,
                "x": rounded(self.run.t[::step]),
                "y": rounded(values[::step, k]),
                "line": line_of(k) | {"width": 1.5},
            }
            for k, joint in enumerate(self.robot.joint_names)
        ]
        return {"data": lines, "layout": layout(xaxis=axis("time [s]"), yaxis=axis(label), margin=MANY_NAMES)}

    def _settings(self) -> dict[str, dict[str, Any]]:
        left_out = ("command", "joints", "samples", "tracking_rmse", "library_version")
        asked = {name: value for name, value in self.data.items() if name not in left_out}
        asked = {name: WITHOUT[name] if value is None else value for name, value in asked.items()}
        return {**({"Asked for": asked} if asked else {}), "Versions": self.versions}
