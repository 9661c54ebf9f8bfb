"""The report on what physics leaves over: what was learned of it, and how much better and surer predictions are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from .. import Comparison, LogResidual, SemiParametricModel
from .colours import AFTER, BASELINE, BEFORE
from .errors import errors_section, verdict
from .figures import axis, layout, rounded
from .logs import logs_section
from .markup import Html, Section, element, items, join, paragraph, plot, table
from .notes import good_to_know, please_note
from .numbers import counted, percent, significant
from .page import page
from .residual import residual_section
from .settings import settings_section
from .torque import torque_section

BEFORE_LABEL, AFTER_LABEL = "physics", "physics and processes"
COVERAGE = "coverage-plot"
NARROW = 85.0
"""Percent of the samples in the interval of 95 %, below which it says too much."""
WIDE = 85.0
"""Percent of the samples in the interval of 68 %, above which it says too little."""

INPUTS = {
    "own_velocity": "its own velocity",
    "own_joint": "its own position and velocity",
    "velocities": "all velocities",
    "positions": "all positions",
    "positions_and_velocities": "all positions and velocities",
    "all": "positions, velocities and accelerations",
}


@dataclass(frozen=True)
class RestPage:
    """All that the page shows.

    - `residuals_before`, `residuals_after`: stretches of each judged log
    - `intervals`: half the intervals of 95 % of these stretches
    - `data`: the figures, as in learned.json
    """

    model: SemiParametricModel
    errors_before: Comparison
    errors_after: Comparison
    residuals_before: Sequence[Sequence[LogResidual]]
    residuals_after: Sequence[Sequence[LogResidual]]
    intervals: Sequence[Sequence[NDArray[Any]]]
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        data, robot = self.data, self.model.physics_.robot
        unseen = data["comparison"]["logs"] == "test"
        judged = [log["file"] for log in data["logs"] if not unseen or log["role"] == "test"]
        joints = list(zip(robot.joint_names, robot.torque_units, strict=True))
        errors, plots = errors_section({BEFORE_LABEL: self.errors_before, AFTER_LABEL: self.errors_after})
        residuals = {BEFORE_LABEL: self.residuals_before, AFTER_LABEL: self.residuals_after}
        torque, torque_data = torque_section(residuals, judged, joints, self.intervals)
        residual, residual_data = residual_section(residuals, judged, robot)
        coverage, figure = coverage_section(data["coverage"])
        on = "unseen logs" if unseen else "the training logs"
        sections = [
            Section("learned", "What was learned", learned_section(data["joints"], dict(joints))),
            Section("errors", f"Errors on {on}", errors),
            Section("coverage", "How sure it is", coverage),
            Section("residual", f"Residual against a variable, {on}", residual),
            Section("torque", f"Measured and predicted torque, {on}", torque),
            *good_to_know(data["messages"]),
            Section("logs", "Data quality", logs_section(data["logs"], data["left_out_of_predictions"])),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        payload = {"figures": {**plots, **figure}, "switches": {}, "torque": torque_data or None}
        payload["residual"] = residual_data or None
        lead = join([self._lead(len(judged), unseen), *please_note(data["messages"])])
        return page(f"What the physics of {robot.name} leaves over", lead, sections, payload)

    def _lead(self, logs: int, unseen: bool) -> Html:
        learned = [joint["joint"] for joint in self.data["joints"] if joint["inputs"]]
        more = [f"A process predicts better than the physics alone at {', '.join(learned) or 'no joint'}."]
        if self.data["stopped"]:
            more.append("The search was stopped: joints that it had not reached have the physics alone.")
        if not unseen:
            more.append("These are the logs that the model was fitted to: name others with --test to know the errors.")
        where = f"On {counted(logs, 'unseen log' if unseen else 'training log')}"
        before, after = self.errors_before, self.errors_after
        return verdict(before, after, where, "the physics alone leaves", more=more, bad=not unseen)

    def _settings(self) -> dict[str, dict[str, Any]]:
        physics = self.model.physics_
        return {
            "Asked for": self.data["settings"],
            "Model": {"effects": physics.effects, "logs": physics.logs, "history": physics.history},
            "Versions": self.data["versions"],
        }


def learned_section(joints: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> Html:
    """What was tried and chosen for each joint."""
    note = paragraph(
        "Parts of the training logs were left out in turn; shown is the root mean square residual there, of the "
        "physics alone and with a process that looks at what it does best with. A joint keeps its process only if it "
        "saves a twentieth of the error there and on halves of the logs, and more than the standard error of what it "
        "saves: of sizes or of squares, whichever save less beyond it."
    )
    rows = []
    for joint in joints:
        best = min((candidate["rmse"] for candidate in joint["candidates"]), default=None)
        rows.append(
            [
                joint["joint"],
                units[joint["joint"]],
                significant(joint["physics_rmse_left_out"]),
                significant(best),
                INPUTS.get(joint["inputs"] or "", "nothing: no process"),
                points_of(joint),
            ]
        )
    columns = ["joint", "unit", "physics", "best process", "looks at", "points"]
    tried = [
        [joint["joint"], units[joint["joint"]], *(significant(_tried(joint, name)) for name in INPUTS)]
        for joint in joints
        if joint["candidates"]
    ]
    parts = [note, table("What was learned", columns, rows, text_columns=(0, 1, 4, 5))]
    parts += [paragraph(said) for said in map(fewer_rows_were_better, joints) if said]
    if tried:
        parts += [
            element("h3", "All that was tried"),
            table(
                "Root mean square residual on parts left out, by what the process looks at",
                ["joint", "unit", *INPUTS.values()],
                tried,
                text_columns=(0, 1),
            ),
        ]
    return join(parts)


def _tried(joint: Mapping[str, Any], name: str) -> float | None:
    errors = [candidate["rmse"] for candidate in joint["candidates"] if candidate["inputs"] == name]
    return min(errors, default=None)


def points_of(joint: Mapping[str, Any]) -> str:
    """Points of a joint's process, and how many of the rows it has seen."""
    how = {"subset": "{points} of {rows} rows", "sparse": "{points}, for all {rows} rows"}
    return how.get(joint["inference"], "{points}").format(**joint)


def fewer_rows_were_better(joint: Mapping[str, Any]) -> str | None:
    """Says where all rows are seen, as was asked for, though some of them predicted parts left out better."""
    errors = {tried["inference"]: tried["rmse"] for tried in joint["candidates"] if tried["inputs"] == joint["inputs"]}
    if joint["inference"] != "sparse" or errors.get("subset", errors["sparse"]) >= errors["sparse"]:
        return None
    return (
        f"{joint['joint']}: all rows are seen, as asked for; the most informative ones alone predict parts left out "
        f"better (error {significant(errors['subset'])}, not {significant(errors['sparse'])})"
    )


def too_narrow(coverage: Sequence[Mapping[str, Any]]) -> list[str]:
    """Joints whose intervals hold far less than they say."""
    found = [one for one in coverage if one["percent_95"] is not None and one["percent_95"] < NARROW]
    return [
        f"the interval of 95 % of {one['joint']} holds {percent(one['percent_95'])} % of the torques: it is too "
        "narrow; learn from more logs of other motions"
        for one in found
    ]


def too_wide(coverage: Sequence[Mapping[str, Any]]) -> list[str]:
    """Joints whose intervals hold far more than they say, in a sentence."""
    found = [one["joint"] for one in coverage if one["percent_68"] is not None and one["percent_68"] > WIDE]
    why = "more torques lie within than they say"
    return [f"the intervals of {', '.join(found)} are wider than they need be: {why}"] if found else []


def coverage_section(rows: Sequence[Mapping[str, Any]]) -> tuple[Html, dict[str, Any]]:
    """How many measurements fall within their predicted intervals."""
    names = [row["joint"] for row in rows]
    cells = [
        [row["joint"], str(row["samples"]), percent(row["percent_68"]), percent(row["percent_95"])] for row in rows
    ]
    said = [*too_narrow(rows), *too_wide(rows)]
    body = join(
        [
            paragraph(
                "Share of the measurements that fall within the predicted interval, in the band of the model, while "
                "the joint moves. The intervals rest on the assumption that the motion is like that of the training "
                "logs."
            ),
            *([items(said)] if said else []),
            plot(COVERAGE, 320, "Share of the measurements within the intervals of 68 and 95 %, joint by joint"),
            table("Coverage", ["joint", "samples", "within 68 %", "within 95 %"], cells),
        ]
    )
    colours = {"percent_68": BEFORE, "percent_95": AFTER}
    bars = [
        {"type": "bar", "name": f"interval of {key[-2:]} %", "x": names, "y": rounded([row[key] for row in rows])}
        | {"marker": {"color": colour}}
        for key, colour in colours.items()
    ]
    line = {"type": "line", "xref": "paper", "yref": "y", "x0": 0, "x1": 1}
    style = {"color": BASELINE, "dash": "dot", "width": 1.5}
    shapes = [{**line, "y0": level, "y1": level, "line": style} for level in (68, 95)]
    figure = {
        "data": bars,
        "layout": layout(
            xaxis=axis("", type="category"),
            yaxis=axis("within the interval [%]", range=[0, 100]),
            shapes=shapes,
            barmode="group",
        ),
    }
    return body, {COVERAGE: figure}
