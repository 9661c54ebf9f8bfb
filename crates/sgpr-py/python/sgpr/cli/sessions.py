"""`sgpr sessions`: what changed between sessions of one arm."""

import shlex
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from .. import compare_sessions
from ..report.numbers import chance, percent, significant, with_deviation
from ..report.sessions import SessionsPage
from . import describe
from .console import Output, to_json
from .errors import wrong_use
from .findings import as_data, of_logs
from .findings import show as show_ranked
from .fit_options import EquationOptions
from .options import Gravity, Joints, Open, open_page
from .output_folder import OutputFolder
from .project import joints_of
from .reading import Log, ReadingOptions, read_logs, stretches, tell_layouts
from .results import headed
from .robots import load_robot
from .screening import doubts

HOUR = 3600 * 10**9
NANOSECONDS_PER_DAY = 24 * HOUR
FIRST_DATE = 946_684_800 * 10**9
"""Of stamps that are dates: the year 2000, ns. Others count from the start of a log or a machine."""


def sessions(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT", help="URDF, DH table (.toml, .json), puma560 or two_link.")
    ],
    logs: Annotated[
        list[str],
        typer.Option(
            "--logs",
            metavar="SESSION=FILE...",
            help="The logs of each session: monday=a.csv monday=b.csv tuesday=c.csv. Changes are told against the "
            "first one.",
        ),
    ],
    equations: EquationOptions,
    reading: ReadingOptions,
    output: Output,
    joints: Joints = None,
    gravity: Gravity = None,
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Folder for report.html, sessions.json and a model of each session."),
    ] = None,
    open_report: Open = False,
) -> None:
    """Tells what changed between sessions of one arm: friction, offset and gain of each joint, and the tool.

    All other parameters are common to the sessions. Effects are those that are linear in the present motion.
    """
    files = _by_session(logs)
    options = equations.arguments()
    joints = joints_of(robot, joints, [path for paths in files.values() for path in paths])
    arm = load_robot(robot, joints, gravity)
    folder = OutputFolder(out) if out else None
    read = {name: read_logs(paths, reading, arm.joint_names, output) for name, paths in files.items()}
    with output.progress() as progress:
        logs_of = {name: stretches(own) for name, own in read.items()}
        found = compare_sessions(arm, logs_of, progress=progress, **options)
        # Of the first session, against which changes are told: those of others are told as such.
        first, *others = read.values()
        told = [*doubts(arm, first, options, progress), *of_logs(log for own in others for log in own)]
    data: dict[str, Any] = headed(
        "sessions",
        arm,
        logs=[describe.repaired_log(log, name) for name, own in read.items() for log in own],
        settings={**options, "reading": reading.to_dict()},
        sessions=found.names,
        sentences=found.sentences,
        tests=found.tests,
        messages=as_data(told),
    )
    if folder:
        with folder:
            folder.write("sessions.json", to_json(data))
            folder.write("report.html", SessionsPage(found, data).html())
            for place, name in enumerate(found.names):
                found.model(name).save(folder.file(model_file(place, name)))
    tell_layouts([log for own in read.values() for log in own], output, of_all=joints is None)
    show(data, output)
    show_ranked(told, output, "see the report (--out), or sgpr info")
    if folder:
        output.line(f"report: {folder.path / 'report.html'}")
    output.result(data)
    if folder and open_report:
        open_page(folder.path / "report.html")
    last = found.names[-1]
    if folder:
        path = folder.path / model_file(len(found.names) - 1, last)
        output.next("sgpr", "compare", str(path), files[last][-1], why=f"the model of {last}")
    else:
        output.next(
            "sgpr",
            "sessions",
            "--robot",
            robot,
            "--logs",
            *logs,
            "--out",
            "sessions",
            why="a page, and a model of each",
        )


def tell_sessions(robot: str, logs: Sequence[Log], output: Output) -> None:
    """Says how to ask what changed if logs were recorded in several sessions."""
    apart = by_time(logs)
    if len(apart) < 2:
        return
    days = (_start(apart[-1][0]) - _start(apart[0][0])) / NANOSECONDS_PER_DAY
    pairs = [f"session_{k + 1}={log.path}" for k, own in enumerate(apart) for log in own]
    command = shlex.join(["sgpr", "sessions", "--robot", robot, "--logs", *pairs])
    output.note(
        f"the training logs are of {len(apart)} sessions over {significant(days, 2)} days, and one model is of all of "
        f"them; what changed between them: {command}"
    )


def by_time(logs: Sequence[Log]) -> list[list[Log]]:
    """Logs in the order of time, those within an hour of each other together; none if their stamps are no dates."""
    dated = sorted((log for log in logs if log.stretches), key=_start)
    if not dated or _start(dated[0]) < FIRST_DATE:
        return []
    sessions = [[dated[0]]]
    for log in dated[1:]:
        end = max(int(one.stretches[-1].time_ns[-1]) for one in sessions[-1])
        if _start(log) - end > HOUR:
            sessions.append([])
        sessions[-1].append(log)
    return sessions


def _start(log: Log) -> int:
    return int(log.stretches[0].time_ns[0])


def model_file(place: int, name: str) -> str:
    """The file of a session's model."""
    safe = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
    return f"model_{place + 1}_{safe[:40]}.sgpr"


def _by_session(pairs: list[str]) -> dict[str, list[str]]:
    files: dict[str, list[str]] = {}
    for pair in pairs:
        name, equals, path = pair.partition("=")
        if not (name and equals and path):
            raise wrong_use(f"`{pair}`: expected SESSION=FILE, as monday=log.csv", "--logs")
        files.setdefault(name, []).append(path)
    if len(files) < 2:
        raise wrong_use(f"one session, {next(iter(files))}: two or more make a comparison", "--logs")
    return files


def show(data: dict[str, Any], output: Output) -> None:
    """The result for people."""
    changed = [test for test in data["tests"] if test["changed"]]
    count = "nothing" if not changed else "one thing" if len(changed) == 1 else f"{len(changed)} things"
    output.heading(f"{count} changed between {', '.join(data['sessions'])}")
    for sentence in data["sentences"] if changed else []:
        output.line(sentence)
    shown = changed or sorted(data["tests"], key=lambda test: test["chance"])[:5]
    if not changed:
        output.line("the least alike, all of them within chance or too small to matter:")
    rows = []
    for test in shown:
        for name, value, deviation in zip(data["sessions"], test["values"], test["standard_deviations"], strict=True):
            written, spread = with_deviation(float(value), float(deviation))
            rows.append(
                [
                    test["joint"] or "last link",
                    "mass" if test["cause"] == "tool" else test["cause"],
                    name,
                    written,
                    spread,
                    test["unit"],
                    chance(test["chance"]),
                    percent(test["saved_percent"]),
                ]
            )
    output.table(
        ["joint", "what", "session", "value", "std", "unit", "chance", "saved, %"],
        rows,
        text_columns=(0, 1, 2, 5),
        spare=("saved, %", "unit"),
    )
