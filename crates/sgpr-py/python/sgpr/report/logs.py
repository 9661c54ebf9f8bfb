"""Data quality: the logs, what was repaired, what was found in them."""

from collections.abc import Sequence
from typing import Any

from .markup import Cell, Html, element, join, paragraph, prose, table
from .numbers import MISSING, counted, significant


def logs_section(logs: Sequence[dict[str, Any]], left_out: dict[str, int]) -> Html:
    """Table of the logs, and the findings of each."""
    columns = ["log", "used to", "samples", "duration [s]", "rate [Hz]", "used samples", "errors", "warnings", "notes"]
    rows = [
        [
            Cell(log["file"], "path"),
            {"train": "identify", "test": "judge", "compared": "judge"}[log["role"]],
            str(log["samples"]),
            significant(log["duration_s"], 4),
            MISSING if log["rate_hz"] is None else significant(log["rate_hz"], 4),
            str(sum(part["samples"] for part in log["used"])),
            *(str(_count(log, severity)) for severity in ("error", "warning", "note")),
        ]
        for log in logs
    ]
    findings = {log["file"]: _findings(log, left_out) for log in logs}
    parts = [
        join([element("h3", file), element("ul", join(lines), class_="plain")])
        for file, lines in findings.items()
        if lines
    ]
    clean = [file for file, lines in findings.items() if not lines]
    if clean:
        parts.append(paragraph(f"Nothing suspicious found in {', '.join(clean)}."))
    return join([table("Logs", columns, rows, text_columns=(0, 1)), *parts])


def _count(log: dict[str, Any], severity: str) -> int:
    others = len(log["notes"]) if severity == "note" else 0
    return others + len([found for found in log["issues"] if found["severity"] == severity])


def _findings(log: dict[str, Any], left_out: dict[str, int]) -> list[Html]:
    lines: list[Html] = [_line(found["severity"], found["message"]) for found in log["issues"]]
    lines += [_line("note", text) for text in log["notes"]]
    lines += [_line("note", f"repaired on request: {text}") for text in log["actions"]]
    if log["file"] in left_out:
        count = counted(left_out[log["file"]], "sample")
        lines.append(
            _line("warning", f"{count} without prediction: repaired, or in stretches too short to be filtered")
        )
    return lines


def _line(severity: str, message: str) -> Html:
    return element("li", join([element("span", severity, class_=f"badge {severity}"), element("span", prose(message))]))
