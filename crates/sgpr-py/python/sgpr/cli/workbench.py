"""`sgpr workbench`: compare, see where it fails, add what is missing, by hand, in a browser."""

import threading
import webbrowser
from importlib.util import find_spec
from typing import Annotated

import typer

from .console import Output
from .errors import BadData

NEEDED = ("starlette", "uvicorn", "tsdownsample", "tomlkit", "scipy")


def workbench(
    output: Output,
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="FOLDER | ROBOT LOG...", help="A folder with a robot and logs, or these files."),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address and open nothing.")] = False,
    port: Annotated[int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="0: any that is free.")] = 0,
) -> None:
    """Opens a page on this machine: robot, logs, fit, compare, where it fails, what is missing, add and take back.

    What is done there is kept in sgpr.toml beside the logs; Ctrl-C ends it. Needs pip install sgpr[workbench].
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise BadData(f"the workbench needs {', '.join(missing)}: pip install 'sgpr[workbench]'")
    from .._workbench.running import Workbench

    running = Workbench(files or ["."], port)
    # Whatever is asked for, without the address nobody gets in.
    typer.echo(f'{{"url": "{running.url}"}}' if output.json else f"workbench: {running.url}")
    output.line("Ctrl-C ends it; what you do is kept in sgpr.toml beside the logs")
    if not no_browser:
        threading.Timer(0.3, webbrowser.open, [running.url]).start()
    running.run()
