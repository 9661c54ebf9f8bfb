"""The page on what changed between sessions of one arm."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import SessionComparison
from .colours import line_of
from .figures import axis, layout, plain, rounded
from .markup import Html, Section, element, items, join, paragraph, plot, table
from .notes import good_to_know, please_note
from .numbers import chance, percent, with_deviation
from .page import page
from .settings import settings_section

CAUSES = {"friction": "friction", "offset": "torque offset", "gain": "torque gain", "tool": "mass"}
ROW_HEIGHT = 26
FRAME = 110


@dataclass(frozen=True)
class SessionsPage:
    """All that the page shows.

    - `data`: the figures, as in sessions.json
    """

    found: SessionComparison
    data: dict[str, Any]

    def html(self) -> str:
        """The file."""
        changed = [test for test in self.data["tests"] if test["changed"]]
        names = self.found.names
        text = " ".join(f"{sentence[0].upper()}{sentence[1:]}." for sentence in self.found.sentences)
        figures = {f"of_{cause}": figure for cause in CAUSES if (figure := self._figure(cause))}
        plots = [self._plot(name) for name in figures]
        sections = [
            Section("changed", "What changed", self._changed(changed)),
            Section("values", "Values of each session", join(plots)),
            Section("tests", "All that was tested", self._tests()),
            Section("how", "How sure", _how()),
            *good_to_know(self.data["messages"]),
            Section("settings", "Settings and provenance", settings_section(self._settings())),
        ]
        verdict = element("p", text, class_="verdict bad" if changed else "verdict")
        lead = join([verdict, *please_note(self.data["messages"])])
        title = f"{self.data['robot']['name']}: {len(names)} sessions"
        return page(title, lead, sections, {"figures": figures, "switches": {}, "torque": None})

    def _changed(self, changed: list[dict[str, Any]]) -> Html:
        return items(self.found.sentences) if changed else paragraph("Nothing that these logs can show.")

    def _figure(self, cause: str) -> dict[str, Any] | None:
        """Values of the sessions as a share of the first one, or beside it, joint by joint."""
        tests = [test for test in self.data["tests"] if test["cause"] == cause]
        if not tests:
            return None
        relative = cause in ("friction", "gain")
        labels = [plain(test["joint"] or "last link") for test in tests]
        traces = []
        for k, name in enumerate(self.found.names):
            change, deviation = zip(*(_change(test, k, relative) for test in tests), strict=True)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "name": plain(name),
                    "x": rounded(change),
                    "y": labels,
                    "error_x": {"array": rounded(2.0 * np.asarray(deviation)), "thickness": 1.2, "width": 4},
                    "marker": {"size": 8, "symbol": k, "color": line_of(k)["color"]},
                    "hovertemplate": "%{y}, %{x}<extra>%{fullData.name}</extra>",
                }
            )
        unit = "%" if relative else tests[0]["unit"]
        x = axis(f"change of {CAUSES[cause]} [{unit}]", zeroline=True)
        return {
            "data": traces,
            "layout": layout(xaxis=x, yaxis=axis("", type="category", autorange="reversed"), showlegend=True),
        }

    def _plot(self, name: str) -> Html:
        cause = name.removeprefix("of_")
        rows = sum(test["cause"] == cause for test in self.data["tests"])
        note = f"Change from {self.found.names[0]}. "
        note += "Bars: two standard deviations, from what parts of two seconds of one session differ by."
        return plot(name, FRAME + ROW_HEIGHT * max(rows, 2), f"{CAUSES[cause]} of each session, joint by joint", note)

    def _tests(self) -> Html:
        rows = []
        for test in self.data["tests"]:
            values = [
                with_deviation(float(v), float(s))
                for v, s in zip(test["values"], test["standard_deviations"], strict=True)
            ]
            rows.append(
                [
                    test["joint"] or "last link",
                    CAUSES[test["cause"]],
                    *(f"{value} ± {spread}" for value, spread in values),
                    test["unit"],
                    chance(test["chance"]),
                    f"{percent(test['saved_percent'])} ± {percent(test['saved_percent_standard_error'])}",
                    "changed" if test["changed"] else "",
                ]
            )
        columns = ["joint", "what", *self.found.names, "unit", "by chance", "left-out squares saved, %", ""]
        last = len(columns) - 1
        return table("Tests", columns, rows, text_columns=(0, 1, last - 3, last))

    def _files(self, session: str) -> list[str]:
        return [log["file"] for log in self.data["logs"] if log["role"] == session]

    def _settings(self) -> dict[str, dict[str, Any]]:
        return {
            "Logs": {name: self._files(name) for name in self.data["sessions"]},
            "Equations": self.data["settings"],
            "Versions": self.data["versions"],
        }


def _change(test: dict[str, Any], session: int, relative: bool) -> tuple[float, float]:
    """Change from the first session and its standard deviation."""
    first, of_first = float(test["values"][0]), float(test["standard_deviations"][0])
    value, deviation = float(test["values"][session]), float(test["standard_deviations"][session])
    spread = 0.0 if session == 0 else float(np.hypot(deviation, of_first))
    scale = 100.0 / abs(first) if relative and first != 0.0 else 1.0
    return (value - first) * scale, spread * scale


def _how() -> Html:
    return join(
        paragraph(text)
        for text in (
            "All parameters are common to the sessions but those that are listed above. Friction is the mean torque "
            "against the motion, over all sessions. Beside the effects there is a torque of any smooth shape in the "
            "position, the speed and the load of each joint, common to the sessions: what the model lacks does not "
            "look like a change where sessions move differently.",
            "Something changed if sessions differ by more than parts of one session do (an F test; one false alarm in "
            "a hundred comparisons, all joints together), and if values of its own for each session lower the squared "
            "error on parts that were left out by more than 5 % and two and a half of its standard deviations.",
            "A session in which a joint moves in one way only, or a motion that the other sessions do not have, can "
            "still be taken for a change. The same motion in each session is the surest comparison.",
        )
    )
