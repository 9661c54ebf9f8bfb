"""The report on a diagnosis: compare, where it fails, what is missing, what it brings, what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import Comparison, LogResidual, Model, Recording
from .detectability import detectability_section
from .errors import errors_section, verdict
from .experiment import experiment_section
from .logs import logs_section
from .markup import Cell, Html, Section, element, items, join, paragraph, prose, table
from .notes import good_to_know, please_note
from .numbers import counted, percent, with_deviation
from .page import page
from .residual import residual_section
from .settings import settings_section
from .signature import signature_figures
from .steps import steps_section
from .structure import structure_section
from .torque import torque_section

BEFORE, AFTER = "before", "with the findings"
SHOWN_CANDIDATES = 25
SHOWN_CELLS = 3
# A probability from which on a finding needs no other beside it in the first lines.
CERTAIN = 0.9
SHARES = ("share", "samples")

VERDICTS = {
    "effects_found": "The model lacks",
    "nothing_missing": "Nothing is missing at this noise.",
    "unexplained_structure": "Something is missing, and no known effect is likely to be it.",
}


@dataclass(frozen=True)
class DiagnosisPage:
    """All that the page shows.

    - `residuals_before`, `residuals_after`: stretches of each judged log
    - `summaries`: sentence on each effect
    - `next_motion`: what to record next
    - `data`: the figures, as in diagnosis.json
    """

    before: Model
    after: Model
    errors_before: Comparison
    errors_after: Comparison
    residuals_before: Sequence[Sequence[LogResidual]]
    residuals_after: Sequence[Sequence[LogResidual]]
    summaries: Mapping[str, str]
    next_motion: Recording | None
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
        residual, residual_data = residual_section(residuals, judged, robot)
        units = dict(joints)
        steps, step_plots = steps_section(data["steps"] if found else [], units)
        findings, finding_plots = self._findings(units)
        where, where_plots = self._where(units)
        left, left_plots = self._left(units)
        on = "unseen logs" if unseen else "the training logs"
        sections = [
            Section("errors", f"Errors on {on}", errors),
            Section("where", "Where the model fails", where),
            Section("findings", "What is missing", findings),
            Section("steps", "How the error falls", steps),
            Section("left", "What is left", left),
            Section("residual", f"Residual against a variable, {on}", residual),
            Section("torque", f"Measured and predicted torque, {on}", torque),
            Section("candidates", "All that was tested", self._candidates()),
            *good_to_know(data["messages"]),
            Section("logs", "Data quality", logs_section(data["logs"], data["left_out_of_predictions"])),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        payload = {
            "figures": {**error_plots, **where_plots, **finding_plots, **step_plots, **left_plots},
            "switches": {},
            "torque": torque_data or None,
            "residual": residual_data or None,
        }
        lead = join([self._lead(len(judged), unseen), *please_note(data["messages"])])
        return page(f"Diagnosis of the model of {robot.name}", lead, sections, payload)

    def _lead(self, logs: int, unseen: bool) -> Html:
        data = self.data
        where = f"On {counted(logs, 'unseen log' if unseen else 'training log')}"
        names = _in_a_sentence(data["findings"])
        first = VERDICTS[data["verdict"]] + (f" {'; '.join(names)}." if names else "")
        more = []
        if not unseen:
            more.append("These are the logs that the model was fitted to: name others with --test to know the errors.")
        before = self.errors_before if names else None
        lead = verdict(before, self.errors_after, where, "before it was", answer=first, more=more, bad=not unseen)
        odds = (
            f"Probability that nothing is missing: {data['probability_nothing_missing']:.2f}; that something is "
            f"missing that no known effect explains: {data['probability_unexplained']:.2f}."
        )
        return join([lead, paragraph(odds, "soft")])

    def _where(self, units: Mapping[str, str]) -> tuple[Html, dict[str, Any]]:
        structure, plots = structure_section("where", self.data["structure"], units)
        rows = []
        for joint in self.data["whereabouts"]["joints"]:
            rows += [
                [joint["joint"] if number == 0 else "", cell["cell"], *(percent(100 * cell[key]) for key in SHARES)]
                for number, cell in enumerate(joint["cells"][:SHOWN_CELLS])
            ]
        note = paragraph(
            "Error of the model before the diagnosis, on the training logs, whose parameters were fitted to it "
            "already: what they could take up is not seen here."
        )
        columns = ["joint", "place", "of the error %", "of the samples %"]
        places = (
            table("Places that hold far more of the error than of the samples", columns, rows, text_columns=(0, 1))
            if rows
            else paragraph(
                "No place holds far more of the error than of the samples: what depends on a variable does so over all "
                "of its range."
            )
        )
        return join([note, structure, places]), plots

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
                value, deviation = with_deviation(parameter["value"], parameter["standard_deviation"])
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
                f"finding-{number}",
                finding,
                (self.residuals_before, self.residuals_after),
                units,
                self.after.robot.position_units,
            )
            parts.append(places)
            figures.update(drawn)
        return join(parts), figures

    def _left(self, units: Mapping[str, str]) -> tuple[Html, dict[str, Any]]:
        data = self.data
        parts: list[Html] = []
        if data["unexplained"]:
            parts += [paragraph("Structure that no known effect explains:"), items(data["unexplained"])]
        parts += self._formulas()
        if not data["unexplained"]:
            parts.append(paragraph("Nothing is left that is large enough to be called an unknown effect."))
        plots: dict[str, Any] = {}
        if data["findings"]:
            parts.append(element("h3", "With the findings"))
            structure, plots = structure_section("left", data["left"], units)
            parts.append(structure)
        experiment, motion = experiment_section(
            data["next_experiment"],
            self.next_motion,
            self.after.robot.position_units,
            data.get("next_experiment_file"),
        )
        parts.append(experiment)
        if self.after.history:
            parts += [element("h3", "History of the model"), items(self.after.history)]
        if data["not_testable"]:
            parts.append(element("h3", "Not testable with these logs"))
            rows = [[entry["effect"], prose(entry["why"])] for entry in data["not_testable"]]
            parts.append(table("Not testable", ["effect", "why"], rows, text_columns=(0, 1)))
        parts.append(detectability_section(data["detectable"], self.after.robot.joint_names))
        return join(parts), plots | motion

    def _formulas(self) -> list[Html]:
        formulas = self.data["formulas"]
        if not formulas:
            return []
        rows = []
        for formula in formulas:
            for number, term in enumerate(formula["terms"]):
                value, deviation = with_deviation(term["coefficient"], term["standard_deviation"])
                rows.append(
                    [
                        formula["joint"] if number == 0 else "",
                        term["function"],
                        value,
                        deviation,
                        term["unit"],
                        percent(100 * term["stability"]),
                    ]
                )
        explained = [
            prose(f"`{one['text']}` explains {percent(100 * one['explained'])} % of what is left on unseen blocks.")
            for one in formulas
        ]
        columns = ["joint", "term", "factor", "standard deviation", "unit", "first choice in % of the blocks"]
        return [
            element("h3", "A formula for it"),
            paragraph(
                "A suggestion, not a finding: the terms of a dictionary (products of functions of two joints) that "
                "describe what is left best. Look for the mechanism behind it; make it an effect of your own to "
                "test it. "
                "What the formula leaves, a Gaussian process can take: SemiParametricModel(robot, physics=model)."
            ),
            items(explained),
            table("Terms", columns, rows, text_columns=(0, 1, 4)),
        ]

    def _candidates(self) -> Html:
        shown = self.data["candidates"][:SHOWN_CANDIDATES]
        rows = [
            [
                one["effect"],
                ", ".join(one["joints"]) or "whole arm",
                "–" if one["score"] <= -1e6 else f"{one['score']:z.0f}",
                f"{one['probability']:.2f}",
                f"{one['error_gained_percent']:z.1f} %" if one["error_gained_percent"] else "–",
                Cell(one["evidence"], "listed"),
            ]
            for one in shown
        ]
        note = paragraph(
            f"The best {len(shown)} of {len(self.data['candidates'])}; the score is the log of the Bayes factor of "
            "the effect against the model, less what looking at so many effects costs. Error gained: the largest fall "
            "of a joint's error on blocks of time that the fit had not seen; of what was only ranked with that effect "
            "alone beside the model, – without evidence."
        )
        columns = ["effect", "where", "score", "probability", "error gained", "evidence"]
        return join([note, table("Candidates", columns, rows, text_columns=(0, 1, 5))])

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


def in_one_line(finding: Mapping[str, Any]) -> str:
    """Its title; if it is not certain, also how likely it is and what it could be instead."""
    if finding["probability"] >= CERTAIN:
        return _title(finding)
    doubt = ", or ".join([f"probability {finding['probability']:.2f}", *map(_in_words, finding["confusable_with"])])
    return f"{_title(finding)} ({doubt})"


def _in_a_sentence(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """All of them, an effect that is certain at several joints once."""
    texts: dict[str, str] = {}
    for finding in findings:
        certain = finding["joints"] and finding["probability"] >= CERTAIN
        key = finding["effect"] if certain else in_one_line(finding)
        known = texts.get(key)
        texts[key] = f"{known}, {', '.join(finding['joints'])}" if known and certain else in_one_line(finding)
    return list(texts.values())


def _title(finding: Mapping[str, Any]) -> str:
    at = ", ".join(finding["joints"]) or "the whole arm"
    return _in_words(f"{finding['effect']}@{at}")


def _in_words(name: str) -> str:
    """`effect` or `effect@joint`."""
    effect, _, at = name.partition("@")
    return effect.replace("_", " ") + (f" at {at}" if at else "")
