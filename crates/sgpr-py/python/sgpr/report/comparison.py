"""The report on a comparison of a model with logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import Comparison, LogResidual, Model
from .errors import errors_section, verdict
from .logs import logs_section
from .markup import Html, Section, element, table
from .numbers import counted, significant
from .page import page
from .residual import residual_section
from .settings import settings_section
from .structure import structure_section
from .torque import torque_section


@dataclass(frozen=True)
class ComparisonPage:
    """All that the page shows.

    - `comparisons`, `residuals`: by the name of the model; the last one is the one that matters
    - `data`: the figures, as in comparison.json
    """

    model: Model
    comparisons: Mapping[str, Comparison]
    residuals: Mapping[str, Sequence[Sequence[LogResidual]]]
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        data = self.data
        robot = self.model.robot
        logs = [log["file"] for log in data["logs"]]
        labels = list(self.comparisons)
        errors, plots = errors_section(self.comparisons)
        joints = list(zip(robot.joint_names, robot.torque_units, strict=True))
        torque, torque_data = torque_section(self.residuals, logs, joints)
        residual, residual_data = residual_section(self.residuals, logs, robot)
        structure, more = structure_section("structure", data["structure"], dict(joints))
        sections = [
            Section("errors", "Errors", errors),
            Section("structure", "What the error depends on", structure),
            Section("residual", "Residual against a variable", residual),
            Section("torque", "Measured and predicted torque", torque),
            Section("logs", "Data quality", logs_section(data["logs"], {})),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        if data["limits"]:
            sections.insert(0, Section("limits", "Limits", _limits(data["limits"])))
        payload = {"figures": plots | more, "switches": {}, "torque": torque_data or None}
        payload["residual"] = residual_data or None
        return page(f"{labels[-1]} against {counted(len(logs), 'log')}", self._lead(len(logs)), sections, payload)

    def _lead(self, logs: int) -> Html:
        names = list(self.comparisons)
        limits = self.data["limits"]
        failed = sum(limit["verdict"] == "fail" for limit in limits)
        more = []
        if limits:
            count = counted(len(limits), "limit")
            more.append(f"{failed} of {count} not met." if failed else f"All {count} met.")
        more += [f"{log} trained the model: no proof of what it can do elsewhere." for log in self.data["trained_on"]]
        more += [f"{text}." for text in self.data["repeated_motions"]]
        return verdict(
            self.comparisons[names[0]] if len(names) > 1 else None,
            self.comparisons[names[-1]],
            f"On {counted(logs, 'log')}",
            f"with {names[0]} it is",
            more=more,
            bad=failed > 0,
        )

    def _settings(self) -> dict[str, dict[str, Any]]:
        model = self.model
        return {
            "Asked for": {**self.data["settings"], "trained_on": self.data["trained_on"]},
            "Model": {"effects": model.effects, "logs": model.logs, "history": model.history},
            "Versions": self.data["versions"],
        }


def _limits(limits: Sequence[dict[str, Any]]) -> Html:
    rows = [
        [
            limit["joint"],
            limit["figure"],
            significant(limit["value"]),
            significant(limit["limit"]),
            limit["unit"],
            element("span", limit["verdict"], class_=f"badge {limit['verdict']}"),
        ]
        for limit in limits
    ]
    return table("Limits", ["joint", "figure", "found", "limit", "unit", "verdict"], rows, text_columns=(0, 1, 4, 5))
