"""The page about a fleet: which arms changed, when, and what changed in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Any

import numpy as np

from ..fleet.alarms import Alarm, date
from ..fleet.changes import FEWEST_SESSIONS
from ..fleet.screening import RANKS, LogFinding
from ..fleet.series import ArmHistory, Series
from .colours import AFTER, BEFORE, INTERVAL, MEASURED
from .figures import axis, layout, rounded
from .markup import Cell, Html, Section, choice, element, items, join, paragraph, plot, prose, table
from .numbers import MISSING, counted, percent, significant
from .page import page

PLOT_HEIGHT = 360
MOST_PLOTS = 40
ROW_HEIGHT = 22
FRAME = 200
"""Above the arms the scale of colours, below them the days."""
SORT = """
document.querySelectorAll('table.sortable').forEach(function (table) {
  const body = table.tBodies[0];
  table.querySelectorAll('thead th').forEach(function (head, column) {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.addEventListener('click', function () {
      const up = head.getAttribute('aria-sort') !== 'ascending';
      table.querySelectorAll('thead th').forEach((other) => other.removeAttribute('aria-sort'));
      head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
      const key = (row) => row.cells[column].dataset.order || row.cells[column].textContent;
      const rows = Array.from(body.rows);
      rows.sort(function (a, b) {
        const x = key(a), y = key(b), numbers = x !== '' && y !== '' && !isNaN(x) && !isNaN(y);
        const order = numbers ? Number(x) - Number(y) : x.localeCompare(y, undefined, {numeric: true});
        return up ? order : -order;
      });
      rows.forEach((row) => body.appendChild(row));
    });
  });
});
"""
STYLE = """
table.sortable td { white-space: nowrap; }
table.sortable thead th button { all: unset; cursor: pointer; font: inherit; }
table.sortable thead th button:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
table.sortable thead th button::after { content: ' \\2195'; color: #8c959f; }
table.sortable thead th[aria-sort=ascending] button::after { content: ' \\2191'; color: inherit; }
table.sortable thead th[aria-sort=descending] button::after { content: ' \\2193'; color: inherit; }
"""


@dataclass(frozen=True)
class FleetPage:
    """All that the page shows.

    - `aside`: logs that could not be recorded, with the reasons; `copies`: logs that are copies, with their originals
    - `false_alarms`: per arm and year, that were allowed
    """

    histories: Sequence[ArmHistory]
    aside: dict[str, str]
    copies: dict[str, str]
    false_alarms: float
    versions: dict[str, str]

    def html(self) -> str:
        """The file."""
        alarms = [alarm for history in self.histories for alarm in history.alarms]
        figures, switches = {"errors": self._errors()}, {}
        shown = [(history, alarm) for history in self.histories for alarm in history.alarms][:MOST_PLOTS]
        if shown:
            switches["changes"] = [_change(history, alarm) for history, alarm in shown]
        sections = [
            Section("alarms", "What changed", self._alarms(alarms, shown)),
            Section("error", "Error of each arm over time", self._error_section()),
            Section("arms", "Arms", self._arms()),
            Section("watched", "What could have been seen", self._watched()),
            Section("outliers", "Arms unlike their sisters, and single sessions", self._outliers()),
            Section("findings", "What a look at the logs found", self._findings()),
            Section("aside", "Logs set aside", self._aside()),
            Section("how", "How sure", self._how()),
        ]
        hours = sum(history.hours for history in self.histories)
        sessions = sum(len(history.time) for history in self.histories)
        changed = counted(len({alarm.robot for alarm in alarms}), "arm") if alarms else "No arm"
        strange = len(self.aside) + sum(len(history.foreign) + len(history.left_out) for history in self.histories)
        text = (
            f"{changed} of {len(self.histories)} changed, in {counted(sessions, 'session')} and "
            f"{significant(hours)} h of logs. {counted(strange, 'log')} set aside. {self._share_watched()}"
        )
        lead = element("p", text, class_="verdict bad" if alarms else "verdict")
        title = f"Fleet of {counted(len(self.histories), 'arm')}"
        whole = page(title, lead, sections, {"figures": figures, "switches": switches, "torque": None})
        return whole.replace("</style>", f"{STYLE}</style>", 1).replace(
            "</body>", f"<script>{SORT}</script>\n</body>", 1
        )

    def _alarms(self, alarms: Sequence[Alarm], shown: Sequence[tuple[ArmHistory, Alarm]]) -> Html:
        if not alarms:
            return paragraph(f"No change stands out of chance. {self._share_watched()}")
        rows = [
            [
                alarm.robot,
                alarm.type or MISSING,
                alarm.joint or "last link",
                alarm.cause,
                Cell(_amount(alarm), order=alarm.change),
                Cell(_interval(alarm), order=alarm.interval[0]),
                Cell(date(alarm.since) if alarm.since > 0 else str(alarm.session), order=float(alarm.since)),
                Cell(MISSING if alarm.until is None else date(alarm.until), order=float(alarm.until or 0)),
                Cell(_of_temperature(alarm), order=alarm.of_temperature),
                Cell(significant(abs(alarm.deviations)), order=abs(alarm.deviations)),
            ]
            for alarm in sorted(alarms, key=lambda alarm: -abs(alarm.deviations))
        ]
        columns = ["arm", "type", "joint", "cause", "change", "95 % interval", "since", "until"]
        columns += ["temperature, taken off", "standard deviations"]
        parts = [_sortable(table("Alarms", columns, rows, text_columns=(0, 1, 2, 3, 6, 7)))]
        parts.append(items(alarm.text for alarm in sorted(alarms, key=lambda alarm: (alarm.robot, alarm.session))))
        names = [f"{alarm.robot}, {alarm.joint or 'last link'}: {alarm.cause}" for _, alarm in shown]
        parts.append(choice("changes-choice", "Change", names))
        note = "Points: one session each, what temperature explains taken off, with two standard deviations. "
        note += "Line: mean before and after."
        parts.append(plot("changes", PLOT_HEIGHT, "The parameter that changed, session by session", note))
        if len(alarms) > len(shown):
            parts.append(paragraph(f"Plots of {len(alarms) - len(shown)} more alarms are left out."))
        return join(parts)

    def _errors(self) -> dict[str, Any]:
        """Error of each arm by day, as a multiple of what it was before any change."""
        first = min(history.time[0] for history in self.histories)
        last = max(history.time[-1] for history in self.histories)
        days = int((last - first) // 86_400_000_000_000) + 1
        grid = np.full((len(self.histories), days), np.nan)
        for row, history in enumerate(self.histories):
            ratio = _ratio(history)
            day = (np.array(history.time) - first) // 86_400_000_000_000
            for k in np.unique(day):
                values = ratio[day == k]
                if np.isfinite(values).any():
                    grid[row, int(k)] = np.nanmax(values)
        stamps = [str(np.datetime64(first, "ns").astype("datetime64[D]") + k) for k in range(days)]
        heat = {
            "type": "heatmap",
            "x": stamps,
            "y": [history.robot for history in self.histories],
            "z": [[None if math.isnan(v) else float(f"{math.log2(max(v, 0.25)):.4g}") for v in row] for row in grid],
            "customdata": [[None if math.isnan(v) else float(f"{v:.3g}") for v in row] for row in grid],
            "zmin": -1,
            "zmax": 3,
            "colorscale": [[0, "#0072b2"], [0.25, "#f4f4f4"], [1, "#d55e00"]],
            "colorbar": {
                "title": {"text": "times the error before any change", "side": "top"},
                "orientation": "h",
                "x": 0,
                "xanchor": "left",
                "y": 1.02,
                "yanchor": "bottom",
                "lenmode": "pixels",
                "len": 240,
                "thickness": 12,
                "tickvals": [-1, 0, 1, 2, 3],
                "ticktext": ["½", "1", "2", "4", "8"],
            },
            "hovertemplate": "%{y}, %{x}: %{customdata} times<extra></extra>",
            "xgap": 1,
            "ygap": 1,
        }
        y = axis("", type="category", autorange="reversed", dtick=max(1, len(self.histories) // 60))
        shape = layout(xaxis=axis("", type="date") if first > 0 else axis("day", type="category"), yaxis=y)
        return {"data": [heat], "layout": shape}

    def _error_section(self) -> Html:
        height = FRAME + ROW_HEIGHT * min(len(self.histories), 60)
        note = "The joint whose error grew most; white where it is what it was before any change, empty without log."
        return plot("errors", height, "Error of each arm by day", note)

    def _arms(self) -> Html:
        rows = []
        for history in self.histories:
            ratio = _ratio(history)
            recent = ratio[-max(len(ratio) // 10, 1) :]
            error = _median(history.error[: history.baseline])
            worst = int(np.nanargmax(error)) if np.isfinite(error).any() else 0
            rows.append(
                [
                    history.robot,
                    history.type or MISSING,
                    Cell(str(len(history.time)), order=len(history.time)),
                    Cell(significant(history.hours), order=history.hours),
                    Cell(percent(100 * float(error[worst])), order=float(error[worst])),
                    history.joints[worst],
                    Cell(significant(float(np.nanmedian(recent))), order=float(np.nanmedian(recent))),
                    Cell(str(len(history.alarms)), order=len(history.alarms)),
                    Cell(str(len(history.events)), order=len(history.events)),
                    "its sisters' first sessions" if history.borrowed else f"its first {history.baseline} sessions",
                ]
            )
        columns = [
            "arm",
            "type",
            "sessions",
            "hours",
            "error at first [%]",
            "of joint",
            "error now / before any change",
        ]
        columns += ["alarms", "events", "reference"]
        return _sortable(table("Arms", columns, rows, text_columns=(0, 1, 5, 9)))

    def _share_watched(self) -> str:
        every = [one for history in self.histories for one in history.series]
        watched = sum(one.watched for one in every)
        if watched == len(every):
            return ""
        why = "the others are known too roughly, or from too few sessions"
        return f"{watched} of {counted(len(every), 'parameter')} could be watched; {why}."

    def _watched(self) -> Html:
        parameters = {one.parameter: one.name for history in self.histories for one in history.series}
        rows: list[list[str | Cell]] = []
        for history in self.histories:
            cells = [_smallest(history, parameter) for parameter in parameters]
            there = sum(one.watched for one in history.series)
            rows.append([history.robot, Cell(f"{there} of {len(history.series)}", order=there), *cells])
        names = [name if name != "tool" else "mass of a tool" for name in parameters.values()]
        note = (
            "The smallest change that two more sessions would be sure of, for the median of the joints that are "
            "watched, and how many these are. Not watched is what sessions know to a quarter only, or worse, and what "
            f"fewer than {FEWEST_SESSIONS} sessions measure; for gain and mass, sessions of the reference do not count."
        )
        return join([_sortable(table("Smallest changes", ["arm", "watched", *names], rows)), paragraph(note)])

    def _outliers(self) -> Html:
        rows = [
            [
                history.robot,
                one["joint"],
                one["parameter"],
                significant(one["value"]),
                significant(one["sisters"]),
                Cell(significant(one["deviations"]), order=one["deviations"]),
            ]
            for history in self.histories
            for one in history.outliers
        ]
        events = [
            [history.robot, one["joint"], one["session"], Cell(significant(one["ratio"]), order=one["ratio"])]
            for history in self.histories
            for one in history.events
        ]
        parts = []
        if rows:
            columns = ["arm", "joint", "parameter", "value", "median of the type", "standard deviations"]
            parts.append(_sortable(table("Unlike their sisters", columns, rows, text_columns=(0, 1, 2))))
        if events:
            columns = ["arm", "joint", "session", "times the error of the sessions around"]
            parts.append(_sortable(table("Single sessions", columns, events, text_columns=(0, 1, 2))))
        return join(parts) if parts else paragraph("None.")

    def _findings(self) -> Html:
        rows = [
            [
                history.robot,
                finding.kind.replace("_", " "),
                finding.subject or "the whole log",
                Cell(f"{len(finding.sessions)} of {history.recorded}", order=len(finding.sessions)),
                finding.sessions[0],
                Cell(finding.rank, order=RANKS.index(finding.rank)),
            ]
            for history in self.histories
            for finding in history.findings
            if finding.rank != "know"
        ]
        notes = sum(finding.rank == "know" for history in self.histories for finding in history.findings)
        more = f"{counted(notes, 'note')} on single arms are in alarms.json." if notes else ""
        mixed = [text for history in self.histories for text in history.mixed]
        if not rows:
            nothing = paragraph(f"Nothing that speaks against them. {more}")
            return join([items(map(prose, mixed)), nothing]) if mixed else nothing
        said = dict.fromkeys(
            f"{finding.kind.replace('_', ' ')}, as in {history.robot}, {finding.sessions[0]}: {finding.message}"
            for history, finding in self._worst_of_each_kind()
        )
        columns = ["arm", "finding", "about", "sessions", "first", "what to do"]
        return join(
            [
                _sortable(table("Findings", columns, rows, text_columns=(0, 1, 2, 4, 5))),
                items(map(prose, [*mixed, *said])),
                paragraph(more),
            ]
        )

    def _worst_of_each_kind(self) -> list[tuple[ArmHistory, LogFinding]]:
        """Of each kind of finding that is no mere note the one that most sessions have."""
        every = [(history, one) for history in self.histories for one in history.findings if one.rank != "know"]
        every.sort(key=lambda pair: -len(pair[1].sessions))
        first: dict[str, tuple[ArmHistory, LogFinding]] = {}
        for history, one in every:
            first.setdefault(one.kind, (history, one))
        return list(first.values())

    def _aside(self) -> Html:
        folder = _folder([*self.aside, *self.copies, *self.copies.values()])
        lines = [
            f"{path.removeprefix(folder)}: {reason.removeprefix(f'{path}: ')}"
            for path, reason in sorted(self.aside.items())
        ]
        for path, other in sorted(self.copies.items()):
            what = "listed twice" if path == other else f"a copy of {other.removeprefix(folder)}"
            lines.append(f"{path.removeprefix(folder)}: {what}, counts once")
        why = "its reference explains nothing of the torque: of another robot, or with other columns or units"
        lines += [f"{history.robot}, {session}: {why}" for history in self.histories for session in history.foreign]
        lines += [
            f"{history.robot}, {session}: {reason}"
            for history in self.histories
            for session, reason in history.left_out.items()
        ]
        if not lines:
            return paragraph("None.")
        where = [paragraph(f"Paths begin with {folder}")] if folder else []
        return join([*where, items(map(prose, lines))])

    def _how(self) -> Html:
        return items(
            [
                f"A change is an alarm if chance makes at most {self.false_alarms:g} such alarms per arm and year, "
                "looked for after every session, in all joints and parameters together (statistic of Shiryaev and "
                "Roberts), and if it is surely larger than 1 % (0.01 kg). Two sessions must show it.",
                "The deviation of a session is that of its residual, memory included, and what neighbouring "
                "sessions of the median arm of its type differ by beyond that, times a factor that the arm's sessions "
                "choose; so do the tails. Slow wear, a tenth of the friction in a year, is no change.",
                "Sessions with another declared tool are measured by a reference of their own.",
                "Temperature is taken off by one slope for each parameter of a type, where it is logged.",
                "The cause is the parameter of the joint that alone explains the largest change of the torque; a tool "
                "explains several joints at once. An effect that the records lack can look like it: diagnose a log.",
                f"Made with {', '.join(f'{name} {version}' for name, version in self.versions.items())}.",
            ]
        )


def _folder(paths: Sequence[str]) -> str:
    """The folder that all paths have in common, if that is worth leaving out."""
    folders = [path.split("/")[:-1] for path in paths]
    common = takewhile(lambda parts: len(set(parts)) == 1, zip(*folders, strict=False))
    return "".join(f"{parts[0]}/" for parts in common) if len(paths) > 1 else ""


def _smallest(history: ArmHistory, parameter: str) -> Cell:
    """The smallest change of a parameter that would have been seen."""
    own = [one for one in history.series if one.parameter == parameter]
    shown = [one.shows for one in own if one.watched]
    if not shown:
        return Cell("not watched", order=1e9)
    middle = float(np.median(shown))
    size = f"{significant(middle)} kg" if parameter == "tool" else percent(100 * middle) + " %"
    return Cell(size if len(own) == 1 else f"{size} ({len(shown)} of {len(own)})", order=middle)


def _ratio(history: ArmHistory) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Error of each session as a multiple of that before any change, of the joint where it grew most. Chance makes the
    largest of several joints more than one: the median of the sessions before is."""
    quiet = max(min((alarm.session for alarm in history.alarms), default=len(history.time)), 1)
    level = _median(history.error[:quiet])
    ratio = history.error / np.where(level > 0.0, level, np.nan)
    there = np.asarray(np.isfinite(ratio).any(axis=1))
    most = np.where(there, np.max(np.where(np.isfinite(ratio), ratio, -np.inf), axis=1), np.nan)
    return most / np.nanmedian(most[:quiet]) if there[:quiet].any() else most


def _mean(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else math.nan


def _median(error: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Of each joint over sessions; NaN for one that never moved."""
    columns = [column[np.isfinite(column)] for column in error.T]
    return np.array([float(np.median(column)) if column.size else np.nan for column in columns])


def _change(history: ArmHistory, alarm: Alarm) -> dict[str, Any]:
    one = _series_of(history, alarm)
    scale = 1.0 if alarm.cause == "tool" else 100.0
    x = scale * history.without_temperature(one)
    bars = 2.0 * scale * one.deviation
    stamps = [str(np.datetime64(stamp, "ns").astype("datetime64[s]")) for stamp in history.time]
    points = {
        "type": "scatter",
        "mode": "markers",
        "name": "session",
        "x": stamps,
        "y": rounded(x),
        "error_y": {"type": "data", "array": rounded(bars), "color": INTERVAL, "thickness": 1.5, "width": 0},
        "marker": {"color": MEASURED, "size": 6},
        "hovertemplate": "%{x}: %{y:.3g}<extra></extra>",
    }
    edges = [0, *sorted({alarm.session, *one.jumps}), len(x)]
    lines = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": "before" if k == 0 else "after",
            "showlegend": k < 2,
            "x": [stamps[start], stamps[end - 1]],
            "y": rounded([_mean(x[start:end])] * 2),
            "line": {"color": BEFORE if k == 0 else AFTER, "width": 3},
            "hoverinfo": "skip",
        }
        for k, (start, end) in enumerate(pairwise(edges))
    ]
    label = f"change from the reference [{'kg' if alarm.cause == 'tool' else '%'}]"
    return {"data": [points, *lines], "layout": layout(xaxis=axis("session", type="date"), yaxis=axis(label))}


def _series_of(history: ArmHistory, alarm: Alarm) -> Series:
    return next(one for one in history.series if one.joint == alarm.joint and one.name == alarm.cause)


def _amount(alarm: Alarm) -> str:
    return _signed(alarm, alarm.change)


def _interval(alarm: Alarm) -> str:
    low, high = alarm.interval
    if alarm.cause == "tool":
        return f"{low:z.2f} to {high:z.2f} kg"
    return f"{100 * low:z.1f} to {100 * high:z.1f} %"


def _of_temperature(alarm: Alarm) -> str:
    return "not logged" if alarm.of_temperature is None else _signed(alarm, alarm.of_temperature)


def _signed(alarm: Alarm, value: float) -> str:
    if alarm.cause == "tool":
        return f"{value:+z.2f} kg"
    return f"{100 * value:+z.1f} %"


def _sortable(html: Html) -> Html:
    """A table whose heads sort it."""
    return Html(html.replace("<table>", '<table class="sortable">', 1))
