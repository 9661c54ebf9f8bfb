"""The program: its commands and what surrounds them."""

import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

from .. import __version__
from .arguments import Command
from .compare import compare
from .demo import demo
from .diagnose import diagnose
from .effects import effects
from .errors import guarded
from .excite import excite
from .export import export
from .identify import identify
from .info import info
from .learn import learn
from .options import with_option_groups
from .payload import payload
from .predict import predict
from .reproduce import reproduce
from .simulate import simulate

app = typer.Typer(
    name="sgpr",
    help="Identifies torque models of robot arms from logs, says how good they are and what they lack.\n\n"
    "Exit code: 0 success, 2 wrong use, 1 bad data (one message on standard error says what to do).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def register(command: Callable[..., Any]) -> None:
    """Makes a function a command of its name."""
    epilog = "Options whose value ends in ... take several values, up to the next option or --: --effects a b c."
    alone = command in (demo, effects)
    app.command(cls=Command, epilog=epilog, no_args_is_help=not alone)(with_option_groups(guarded(command)))


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
    excite,
    simulate,
    export,
    reproduce,
):
    register(each)


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
