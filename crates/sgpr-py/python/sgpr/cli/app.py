"""The program: its commands and what surrounds them."""

import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

from .. import __version__
from . import data
from .arguments import Command
from .compare import compare
from .demo import demo
from .diagnose import diagnose
from .effects import effects
from .errors import guarded
from .excite import excite
from .export import export
from .fleet import report as fleet_report
from .fleet import run as fleet_run
from .fleet import simulate as fleet_simulate
from .identify import identify
from .info import info
from .learn import learn
from .options import with_option_groups
from .payload import payload
from .predict import predict
from .reproduce import reproduce
from .sessions import sessions
from .simulate import simulate
from .workbench import workbench

app = typer.Typer(
    name="sgpr",
    help="Identifies torque models of robot arms from logs, says how good they are and what they lack.\n\n"
    "Exit code: 0 success, 2 wrong use, 1 bad data (one message on standard error says what to do).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


fleet = typer.Typer(name="fleet", help="Many arms: records of their logs, and what changed in which.")
app.add_typer(fleet, no_args_is_help=True)


def register(command: Callable[..., Any], group: typer.Typer = app) -> None:
    """Makes a function a command of its name."""
    epilog = "Options whose value ends in ... take several values, up to the next option or --: --effects a b c."
    alone = command in (demo, effects, workbench, data.list_)
    name = command.__name__.strip("_")
    group.command(name, cls=Command, epilog=epilog, no_args_is_help=not alone)(with_option_groups(guarded(command)))


for each in (
    demo,
    info,
    identify,
    compare,
    diagnose,
    learn,
    predict,
    effects,
    payload,
    sessions,
    excite,
    simulate,
    export,
    reproduce,
):
    register(each)
register(workbench)

for of_fleet in (fleet_run, fleet_report, fleet_simulate):
    register(of_fleet, fleet)


data_app = typer.Typer(name="data", help="Public logs of real robots, by name.", no_args_is_help=True)
register(data.list_, data_app)
register(data.get, data_app)
app.add_typer(data_app)


def show_version(wanted: bool) -> None:
    """Prints the version and ends."""
    if wanted:
        typer.echo(f"sgpr {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=show_version, is_eager=True)
    ] = False,
) -> None:
    """Options of the program itself."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the program; ends it with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        # Unit signs must not end a program on a terminal or in a file of another encoding.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    app(args=None if arguments is None else list(arguments), prog_name="sgpr")
