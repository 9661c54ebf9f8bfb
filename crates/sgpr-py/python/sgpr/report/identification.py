"""The report on an identification."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .. import Comparison, LogResidual, Model
from .certificate import certificate_section
from .errors import errors_section, verdict
from .essential import essential_section
from .excitation import excitation_section
from .logs import logs_section
from .markup import Html, Section, join, paragraph
from .notes import is_known, please_note
from .numbers import counted
from .page import page
from .parameters import parameters_section
from .residual import residual_section
from .screening import screening_section
from .settings import settings_section
from .signals import signals_section
from .torque import torque_section

AFTER = "identified"


@dataclass(frozen=True)
class IdentificationPage:
    """All that the page shows.

    - `residuals_before`, `residuals_after`: stretches of each judged log
    - `data`: the figures, as in identification.json
    """

    model: Model
    before: Comparison
    after: Comparison
    residuals_before: Sequence[Sequence[LogResidual]]
    residuals_after: Sequence[Sequence[LogResidual]]
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        data = self.data
        robot = self.model.robot
        report = self.model.report
        fit = self.model.fit
        assert report is not None and fit is not None, "the model was identified"
        unseen = data["comparison"]["logs"] == "test"
        judged = [log["file"] for log in data["logs"] if not unseen or log["role"] == "test"]
        train = [log["file"] for log in data["logs"] if log["role"] == "train"]
        before = "the robot file" if data["settings"]["start"] == "robot_file" else "the internal model alone"
        joints = list(zip(robot.joint_names, robot.torque_units, strict=True))
        errors, error_plots = errors_section({before: self.before, AFTER: self.after})
        residuals = {before: self.residuals_before, AFTER: self.residuals_after}
        torque, torque_data = torque_section(residuals, judged, joints)
        residual, residual_data = residual_section({AFTER: self.residuals_after}, judged, robot)
        excitation, excitation_plots = excitation_section(fit, report.singular_values, data["parameters"])
        labels = [choice["log"] for choice in data["cutoff_choices"]]
        signals, signal_plots, switches = signals_section(
            report.cutoff_choices, labels, robot.joint_names, robot.position_units, data
        )
        on = "unseen logs" if unseen else "the training logs"
        sections = [
            Section("errors", f"Errors on {on}", errors),
            Section("torque", f"Measured and predicted torque, {on}", torque),
            Section("residual", "Residual against a variable", residual),
            Section("parameters", "Parameters", parameters_section(data["parameters"], data["terms"])),
            *(
                [Section("essential", "Parameters left out", essential_section(data["essential"], names_of(data)))]
                if data["essential"]
                else []
            ),
            *(
                [Section("certificate", "Links as bodies", certificate_section(data["certificate"]))]
                if data["certificate"]
                else []
            ),
            Section("excitation", "Excitation", excitation),
            Section("signals", "Signal processing", signals),
            Section(
                "screening", "Screening", screening_section(data["screening"], list(filter(is_known, data["messages"])))
            ),
            Section("logs", "Data quality", logs_section(data["logs"], data["left_out_of_predictions"])),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        names = [*self.model.effects, *dict.fromkeys(term["effect"] for term in data["terms"])]
        effects = ", ".join(names) or "no effects"
        parameters = counted(len(data["parameters"]), "base parameter")
        facts = (
            f"{counted(robot.dof, 'joint')}; rigid body with {effects}; {parameters} from "
            f"{counted(len(train), 'training log')} with {report.samples} samples."
        )
        lead = [
            self._verdict(len(judged), before, unseen=unseen),
            paragraph(facts, "soft"),
            *please_note(data["messages"]),
        ]
        payload = {
            "figures": {**error_plots, **excitation_plots, **signal_plots},
            "switches": switches,
            "torque": torque_data or None,
            "residual": residual_data or None,
        }
        return page(f"Torque model of {robot.name}", join(lead), sections, payload)

    def _verdict(self, logs: int, before: str, *, unseen: bool) -> Html:
        if unseen:
            return verdict(self.before, self.after, f"On {counted(logs, 'unseen log')}", f"with {before} it was")
        caution = (
            "These are the logs that the model was fitted to, so errors elsewhere are larger. Name logs with --test to "
            "know them."
        )
        where = f"On {counted(logs, 'training log')}"
        return verdict(self.before, self.after, where, f"with {before} it was", more=[caution], bad=True)

    def _settings(self) -> dict[str, dict[str, Any]]:
        data = self.data
        model = self.model
        return {
            "Asked for": data["settings"],
            "Chosen": data["processing"],
            "Fit": {
                "method": data["fit"]["method"],
                "equations per joint": data["fit"]["rows"],
                "noise per joint, N·m (N)": data["fit"]["noise"],
                "rows per independent row": data["fit"]["correlation"],
                "random numbers": "none; the same input gives the same result",
            },
            "Provenance": {"logs": model.logs, "history": model.history},
            "Versions": data["versions"],
        }


def names_of(data: dict[str, Any]) -> list[str]:
    """Names of the base parameters."""
    return [parameter["name"] for parameter in data["parameters"]]
