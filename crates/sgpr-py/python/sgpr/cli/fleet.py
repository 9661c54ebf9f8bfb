"""`sgpr fleet`: records of many logs, and what changed in which arm."""

import json
from pathlib import Path
from typing import Annotated

import typer

from .. import Model, Robot
from ..fleet.changes import FALSE_ALARMS, histories, to_dict
from ..fleet.engine import kinds_of, make_records
from ..fleet.files import iterate_records
from ..fleet.logs import find
from ..fleet.simulated import SECONDS, simulate_fleet
from ..report.fleet import FleetPage
from ..report.numbers import counted
from ..report.versions import versions
from .console import Output, to_json
from .errors import STOPPED, of_command_line, wrong_use
from .inputs import kind_of, load_model
from .options import Joints, Open, OutFolder, open_page
from .output_folder import OutputFolder
from .reading import ReadingOptions
from .robots import load_robot

FEW = 10
RobotsOption = Annotated[
    list[str],
    typer.Option(
        "--robot",
        metavar="[TYPE=]ROBOT...",
        help="Robot or saved model (.sgpr); of several types of arms one each: ur5=ur5.urdf ur10=ur10.sgpr.",
    ),
]


def run(
    logs: Annotated[
        str, typer.Argument(metavar="LOGS", help="Pattern (quoted), or a table with path, robot, session, type.")
    ],
    robot: RobotsOption,
    reading: ReadingOptions,
    output: Output,
    out: Annotated[str, typer.Option("--out", metavar="DIR", help="Folder for the records; a run goes on in it.")],
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Of Dask; a cluster here by default.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", help="Of the cluster here.", show_default="all processors")
    ] = None,
    blocks: Annotated[int, typer.Option("--blocks", help="Parts of a log that keep factors of their own.")] = 5,
    lags: Annotated[
        bool,
        typer.Option(
            "--lags",
            help="Keep what standard deviations of several logs together need: records become four times as large.",
        ),
    ] = False,
    joints: Joints = None,
    storage: Annotated[
        str | None, typer.Option("--storage", metavar="JSON", help="Options of the object store, as fsspec takes them.")
    ] = None,
) -> None:
    """Makes the record of each log: what it says about the parameters, without the log.

    Writes to DIR: records/, one file per log; processing.json, how logs are processed; aside.json, logs that could
    not be recorded, with the reasons. A run that was stopped goes on where it was.
    """
    if workers is not None and workers < 1:
        raise wrong_use("there must be one", "--workers")
    if not 1 <= blocks <= 1000:
        raise wrong_use("1 to 1000", "--blocks")
    try:
        options = json.loads(storage) if storage else {}
    except json.JSONDecodeError as error:
        raise wrong_use(f"no JSON: {error}", "--storage") from None
    found = find(logs, options)
    place = Path(out)
    place.mkdir(parents=True, exist_ok=True)
    how = {"read": reading.arguments(), "repair": reading.repairs()}
    try:
        kinds = kinds_of(robots_of(robot, joints), found, place, reading=how, storage=options)
        with output.progress() as progress:
            outcome = make_records(
                found,
                kinds,
                place,
                scheduler=scheduler,
                workers=workers,
                reading=how,
                storage=options,
                blocks=blocks,
                lags=lags,
                progress=progress,
            )
    except KeyboardInterrupt:
        output.note("stopped; the records that are made stay, and the same command goes on")
        raise typer.Exit(STOPPED) from None
    arms = len({log.robot for log in found})
    output.line(f"{counted(len(found), 'log')} of {counted(arms, 'arm')}: {outcome.made} recorded, {outcome.kept} kept")
    for path, reason in list(outcome.aside.items())[:FEW]:
        output.warning(f"set aside: {path}: {of_command_line(reason).removeprefix(f'{path}: ')}")
    if len(outcome.aside) > FEW:
        output.warning(f"set aside: {len(outcome.aside) - FEW} more, see {place / 'aside.json'}")
    for path, other in list(outcome.copies.items())[:FEW]:
        output.warning(f"{path} is {'listed twice' if path == other else f'a copy of {other}'} and counts once")
    output.next("sgpr", "fleet", "report", out, "--robot", *robot, "--out", "report", why="what changed in which arm")
    output.result(
        {
            "command": "fleet run",
            "logs": len(found),
            "made": outcome.made,
            "kept": outcome.kept,
            "aside": outcome.aside,
            "copies": outcome.copies,
        }
    )
    if found and not outcome.made and not outcome.kept:
        raise typer.Exit(1)


def simulate(
    output: Output,
    out: Annotated[str, typer.Option("--out", metavar="DIR", help="Folder for logs, table and truth.")],
    robot: Annotated[
        list[str] | None, typer.Option("--robot", metavar="TYPE=ROBOT...", show_default="puma560 and two_link")
    ] = None,
    arms: Annotated[int, typer.Option("--arms")] = 40,
    days: Annotated[int, typer.Option("--days")] = 30,
    sessions: Annotated[int, typer.Option("--sessions", help="Per day.")] = 2,
    seconds: Annotated[float, typer.Option("--seconds", help="Of each session.")] = SECONDS,
    faulty: Annotated[float, typer.Option("--faulty", help="Share of arms to which something happens.")] = 0.2,
    seed: Annotated[int, typer.Option("--seed")] = 0,
    workers: Annotated[int | None, typer.Option("--workers", metavar="N", show_default="all processors")] = None,
) -> None:
    """Makes the logs of a fleet that does not exist, with faults that are known."""
    known = robots_of(robot, None).items() if robot else ()
    types = {name: one.robot if isinstance(one, Model) else one for name, one in known} or None
    with output.progress() as progress:
        table = simulate_fleet(
            out,
            types=types,
            arms=arms,
            days=days,
            sessions_per_day=sessions,
            seconds=seconds,
            faulty=faulty,
            seed=seed,
            workers=workers,
            progress=progress,
        )
    output.line(f"table: {table}")
    output.line(f"truth: {Path(out) / 'truth.json'}")
    of_types = robot or ["puma560=puma560", "two_link=two_link"]
    output.next("sgpr", "fleet", "run", str(table), "--robot", *of_types, "--out", str(Path(out) / "records"))
    output.result({"command": "fleet simulate", "table": str(table)})


def report(
    records: Annotated[str, typer.Argument(metavar="RECORDS", help="Folder that `sgpr fleet run` wrote.")],
    robot: RobotsOption,
    out: OutFolder,
    output: Output,
    joints: Joints = None,
    false_alarms: Annotated[
        float, typer.Option("--false-alarms", metavar="N", help="Alarms per arm and year that chance may make.")
    ] = FALSE_ALARMS,
    temperature: Annotated[
        str, typer.Option("--temperature", metavar="NAME", help="What the names of temperature channels contain.")
    ] = "temperature",
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if there is an alarm.")] = False,
    open_report: Open = False,
) -> None:
    """Says what changed in which arm, and when. Only the records are read.

    Writes to DIR: report.html, one page whose tables sort, and alarms.json for machines.
    """
    if not 0.0 < false_alarms <= 100.0:
        raise wrong_use("more than 0 and at most 100", "--false-alarms")
    place = Path(records)
    kept = place / "records" if (place / "records").is_dir() else place
    robots = robots_of(robot, joints)
    with OutputFolder(out) as folder:
        with output.progress() as progress:
            found = histories(
                iterate_records(kept), robots, false_alarms=false_alarms, temperature=temperature, progress=progress
            )
        notes = place / "aside.json"
        aside = json.loads(notes.read_text(encoding="utf-8")) if notes.exists() else {"aside": {}, "copies": {}}
        reasons = {path: of_command_line(reason) for path, reason in aside["aside"].items()}
        page = FleetPage(found, reasons, aside["copies"], false_alarms, versions())
        folder.write("report.html", page.html())
        data = {
            "command": "fleet report",
            "false_alarms_per_arm_and_year": false_alarms,
            "arms": [to_dict(history) for history in found],
            **{key: aside[key] for key in ("aside", "copies")},
            "versions": versions(),
        }
        folder.write("alarms.json", to_json(data))
    alarms = [alarm for history in found for alarm in history.alarms]
    changed = len({alarm.robot for alarm in alarms})
    every = [one for history in found for one in history.series]
    watched = f"{sum(one.watched for one in every)} of {counted(len(every), 'parameter')} could be watched"
    none = f"no change seen in {counted(len(found), 'arm')}; {watched}"
    output.line(f"{counted(changed, 'arm')} of {len(found)} changed; {watched}:" if alarms else none)
    for alarm in alarms:
        output.line(f"  {alarm.text}")
    for history in found:
        for session in history.foreign:
            output.warning(f"{history.robot}, {session}: the reference explains nothing of its torque; left out")
        for session, reason in history.left_out.items():
            output.warning(f"{history.robot}, {session}: {reason}; left out")
        for text in history.mixed:
            output.warning(text)
    doubts = [finding for history in found for finding in history.findings if finding.rank != "know"]
    if doubts:
        arms = sum(any(finding.rank != "know" for finding in history.findings) for history in found)
        kinds = ", ".join(sorted({finding.kind.replace("_", " ") for finding in doubts}))
        output.warning(f"a look at the logs of {counted(arms, 'arm')} found: {kinds}; see the report")
    output.line(f"report: {Path(out) / 'report.html'}")
    output.line(f"alarms: {Path(out) / 'alarms.json'}")
    output.result(data)
    if open_report:
        open_page(Path(out) / "report.html")
    if strict and alarms:
        raise typer.Exit(1)


def robots_of(given: list[str], joints: list[str] | None) -> dict[str, Robot | Model]:
    """Robots and models by the name of their type; the empty name for the only one."""
    found: dict[str, Robot | Model] = {}
    for text in given:
        name, equals, file = text.partition("=")
        if not equals:
            name, file = "", text
        if name in found or (not name and len(given) > 1):
            raise wrong_use(f"`{text}`: of several robots each needs a name of its own: TYPE=ROBOT", "--robot")
        found[name] = load_model(file, joints) if kind_of(file) == "model" else load_robot(file, joints)
    return found
