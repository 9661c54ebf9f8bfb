"""`sgpr workbench`: compare, see where it fails, add what is missing, by hand, in a browser."""

import threading
import webbrowser
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from ..report.numbers import percent
from .console import Output
from .errors import BadData
from .output_folder import OutputFolder

NEEDED = ("starlette", "uvicorn", "tsdownsample", "tomlkit", "scipy")


def workbench(
    output: Output,
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="FOLDER | ROBOT LOG...", help="A folder with a robot and logs, or these files."),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address and open nothing.")] = False,
    repeat: Annotated[
        str | None,
        typer.Option(
            "--repeat",
            metavar="DIR",
            help="Open no page: make the current model of sgpr.toml again and write what the page hands out to DIR.",
        ),
    ] = None,
    port: Annotated[int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="0: any that is free.")] = 0,
) -> None:
    """Opens a page on this machine: robot, logs, fit, compare, where it fails, what is missing, add and take back.

    What is done there is kept in sgpr.toml beside the logs; Ctrl-C ends it. Needs the extra `workbench` of the package.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise BadData(f"the workbench needs {', '.join(missing)}: pip install 'sgpr[workbench]'")
    if repeat is not None:
        write_again(files or ["."], repeat, output)
        return
    # What the extra brings is not needed by other commands.
    from .._workbench.running import Workbench

    running = Workbench(files or ["."], port)
    # Whatever is asked for, without the address nobody gets in.
    typer.echo(f'{{"url": "{running.url}"}}' if output.json else f"workbench: {running.url}")
    output.line("Ctrl-C ends it; what you do is kept in sgpr.toml beside the logs")
    if not no_browser:
        threading.Timer(0.3, webbrowser.open, [running.url]).start()
    try:
        running.run()
    except KeyboardInterrupt:
        output.line("ended; what you did is in sgpr.toml")


def write_again(files: list[str], out: str, output: Output) -> None:
    """Model, report, commands and script of the steps in sgpr.toml, without a page."""
    from .._workbench import takeaway
    from .._workbench.running import opened

    folder = OutputFolder(out)
    bench = opened(files)
    try:
        bench.work.wait()
    finally:
        bench.work.cancel()
    if bench.message is not None:
        raise BadData(bench.message["text"])
    step = takeaway.chain_of(bench)[-1]
    with folder:
        Path(folder.file("model.sgpr")).write_bytes(takeaway.model_file(bench))
        folder.write("report.html", takeaway.report(bench))
        folder.write("repeat.py", takeaway.script(bench))
        folder.write("commands.sh", takeaway.commands(bench))
    on = "test" if "test" in step.errors else "train"
    where = "unseen logs" if on == "test" else "the training logs"
    output.heading(f"{step.name}: on {where} the error is {percent(step.errors[on]['relative'])} % of the torque")
    output.line(f"results: {folder.path}")
    output.result({"command": "workbench", **step.to_dict()})
    output.next("sgpr", "compare", str(folder.path / "model.sgpr"), "ANOTHER_LOG", "--out", "comparison")
