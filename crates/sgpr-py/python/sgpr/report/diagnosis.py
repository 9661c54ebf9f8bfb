"""The report on a diagnosis: compare, where it fails, what is missing, what it brings, what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import Comparison, LogResidual, Model
from .errors import errors_section, verdict
from .logs import logs_section
from .markup import Html, Section, element, items, join, paragraph, prose, table
from .numbers import counted, percent, significant, with_deviation
from .page import page
from .settings import settings_section
from .signature import signature_figures
from .steps import steps_section
from .torque import torque_section

BEFORE, AFTER = "before", "with the findings"
SHOWN_CANDIDATES = 25

VERDICTS = {
    "effects_found": "The model lacks",
    "nothing_missing": "Nothing is missing at this noise.",
    "unexplained_structure": "Something is missing that no known effect explains.",
}


@dataclass(frozen=True)
class DiagnosisPage:
    """All that the page shows.

    - `residuals_before`, `residuals_after`: stretches of each judged log
    - `summaries`: sentence on each effect
    - `data`: the figures, as in diagnosis.json
    """

    before: Model
    after: Model
    errors_before: Comparison
    errors_after: Comparison
    residuals_before: Sequence[Sequence[LogResidual]]
    residuals_after: Sequence[Sequence[LogResidual]]
    summaries: Mapping[str, str]
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        data, robot = self.data, self.after.robot
        unseen = data["comparison"]["logs"] == "test"
        judged = [log["file"] for log in data["logs"] if not unseen or log["role"] == "test"]
        joints = list(zip(robot.joint_names, robot.torque_units, strict=True))
        found = bool(data["findings"])
        models = {BEFORE: self.errors_before, AFTER: self.errors_after} if found else {"model": self.errors_before}
        residuals = (
            {BEFORE: self.residuals_before, AFTER: self.residuals_after} if found else {"model": self.residuals_before}
        )
        errors, error_plots = errors_section(models)
        torque, torque_data = torque_section(residuals, judged, joints)
        steps, step_plots = steps_section(data["steps"], dict(joints))
        findings, finding_plots = self._findings(dict(joints))
        on = "unseen logs" if unseen else "the training logs"
        sections = [
            Section("where", "Where the model fails", self._where()),
            Section("findings", "What is missing", findings),
            Section("steps", "How the error falls", steps),
            Section("left", "What is left", self._left()),
            Section("errors", f"Errors on {on}", errors),
            Section("torque", f"Measured and predicted torque, {on}", torque),
            Section("candidates", "All that was tested", self._candidates()),
            Section("logs", "Data quality", logs_section(data["logs"], data["left_out_of_predictions"])),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        payload = {
            "figures": {**error_plots, **step_plots, **finding_plots},
            "switches": {},
            "torque": torque_data or None,
        }
        return page(f"Diagnosis of the model of {robot.name}", self._lead(len(judged), unseen), sections, payload)

    def _lead(self, logs: int, unseen: bool) -> Html:
        data = self.data
        where = f"On {counted(logs, 'unseen log' if unseen else 'training log')}"
        names = [_title(finding) for finding in data["findings"]]
        first = VERDICTS[data["verdict"]] + (f" {'; '.join(names)}." if names else "")
        more = [first]
        if not unseen:
            more.append("These are the logs that the model was fitted to: name others with --test to know the errors.")
        before = self.errors_before if names else None
        lead = verdict(before, self.errors_after, where, "before it was", more=more)
        odds = (
            f"Probability that nothing is missing: {data['probability_nothing_missing']:.2f}; that something is "
            f"missing that no known effect explains: {data['probability_unexplained']:.2f}."
        )
        return join([lead, paragraph(odds, "soft")])

    def _where(self) -> Html:
        rows, sentences = [], []
        for joint in self.data["whereabouts"]["joints"]:
            cells = joint["cells"]
            rows.append(
                [
                    joint["joint"],
                    significant(joint["rmse"]),
                    f"{joint['correlation']:.2f}",
                    f"±{joint['correlation_band']:.2f}",
                    "; ".join(_cell(cell) for cell in cells[:3]) or "spread evenly",
                ]
            )
            if cells and cells[0]["share"] > 2 * cells[0]["samples"]:
                sentences.append(f"{joint['joint']}: {_cell(cells[0])}.")
        note = paragraph(
            "Error of the model before the diagnosis, on the training logs. White noise has a correlation between "
            "neighbouring rows within the band; structure that a model misses has more. A place is listed if it holds "
            "far more of the error than of the samples."
        )
        columns = ["joint", "RMSE in band", "correlation", "band of white noise", "most of the error"]
        return join([note, items(sentences), table("Where the error sits", columns, rows, text_columns=(0, 4))])

    def _findings(self, units: Mapping[str, str]) -> tuple[Html, dict[str, Any]]:
        data = self.data
        if not data["findings"]:
            return paragraph(VERDICTS[data["verdict"]]), {}
        parts: list[Html] = []
        figures: dict[str, Any] = {}
        for number, finding in enumerate(data["findings"]):
            parts.append(element("h3", f"{number + 1}. {_title(finding)}"))
            parts.append(paragraph(f"Probability {finding['probability']:.2f}. {finding['evidence']}."))
            rows = []
            for parameter in finding["parameters"]:
                value, deviation = with_deviation(parameter["value"], parameter["std"])
                rows.append([parameter["name"], value, deviation, parameter["unit"]])
            parts.append(
                table(
                    f"Parameters of {finding['effect']}",
                    ["parameter", "value", "standard deviation", "unit"],
                    rows,
                    text_columns=(0, 3),
                )
            )
            if finding["confusable_with"]:
                others = ", ".join(f"`{name}`" for name in finding["confusable_with"])
                parts.append(
                    paragraph(prose(f"Could also be {others}. To tell them apart: {finding['separating_experiment']}."))
                )
            places, drawn = signature_figures(
                f"finding-{number}", finding, self.residuals_before, self.residuals_after, units
            )
            parts.append(places)
            figures.update(drawn)
        return join(parts), figures

    def _left(self) -> Html:
        data = self.data
        parts = []
        if data["unexplained"]:
            parts.append(paragraph("Structure that no known effect explains:"))
            parts.append(items(data["unexplained"]))
        else:
            parts.append(paragraph("No structure that a smooth function of position, speed or time could explain."))
        if data["next_experiment"]:
            parts.append(element("h3", "What to record next"))
            parts.append(items(f"{' or '.join(one['about'])}: {one['experiment']}." for one in data["next_experiment"]))
        if data["not_testable"]:
            parts.append(element("h3", "Not testable with these logs"))
            rows = [[entry["effect"], prose(entry["why"])] for entry in data["not_testable"]]
            parts.append(table("Not testable", ["effect", "why"], rows, text_columns=(0, 1)))
        return join(parts)

    def _candidates(self) -> Html:
        shown = self.data["candidates"][:SHOWN_CANDIDATES]
        rows = [
            [
                one["effect"],
                ", ".join(one["joints"]) or "whole arm",
                "–" if one["score"] <= -1e6 else f"{one['score']:.0f}",
                f"{one['probability']:.2f}",
                one["evidence"],
            ]
            for one in shown
        ]
        note = paragraph(
            f"The best {len(shown)} of {len(self.data['candidates'])}; the score is the log of the Bayes factor of "
            "the effect against the model, less what looking at so many effects costs."
        )
        columns = ["effect", "where", "score", "probability", "evidence"]
        return join([note, table("Candidates", columns, rows, text_columns=(0, 1, 4))])

    def _settings(self) -> dict[str, dict[str, Any]]:
        return {
            "Asked for": self.data["settings"],
            "Model": {
                "effects": self.after.effects,
                "logs": self.after.logs,
                "history": self.after.history,
                "random numbers": "seeds are fixed; the same input gives the same result",
            },
            "Versions": self.data["versions"],
        }


def _title(finding: Mapping[str, Any]) -> str:
    at = ", ".join(finding["joints"]) or "the whole arm"
    return f"{finding['effect'].replace('_', ' ')} at {at}"


def _cell(cell: Mapping[str, Any]) -> str:
    share, samples = percent(100 * cell["share"]), percent(100 * cell["samples"])
    return f"{share} % of the error in {samples} % of the samples, {cell['cell']}"
