"""What a command prints: results on standard output, everything else on standard error."""

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

OUTPUT_PANEL = "Output"
WIDTH_OF_FILES = 200

ProgressCallback = Callable[[str, int, int], object]


@dataclass(frozen=True)
class Output:
    """The options that every command has, and what they do."""

    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON and nothing else.", rich_help_panel=OUTPUT_PANEL)
    ] = False
    quiet: Annotated[
        bool,
        typer.Option("--quiet", "-q", help="Print errors only (and JSON, if asked for).", rich_help_panel=OUTPUT_PANEL),
    ] = False

    @property
    def _talks(self) -> bool:
        return not (self.json or self.quiet)

    def result(self, data: Any) -> None:
        """The result for programs."""
        if self.json:
            sys.stdout.write(to_json(data, ascii_only=True))

    def heading(self, text: str) -> None:
        """A line in bold."""
        if self._talks:
            _console(sys.stdout).print(Text(text, style="bold"))

    def line(self, text: str, style: str = "") -> None:
        """A line of the result for people."""
        if self._talks:
            _console(sys.stdout).print(Text(text, style=style), soft_wrap=True)

    def table(
        self,
        columns: Sequence[str],
        rows: Sequence[Sequence[str]],
        *,
        text_columns: Sequence[int] = (0,),
        title: str | None = None,
    ) -> None:
        """A table of the result for people; numbers are aligned to the right."""
        if not self._talks:
            return
        table = Table(box=box.SIMPLE_HEAD, title=title and escape(title), title_justify="left", title_style="bold")
        for index, column in enumerate(columns):
            justify: Any = "left" if index in text_columns else "right"
            table.add_column(escape(column), justify=justify, overflow="fold")
        for row in rows:
            table.add_row(*map(escape, row))
        _console(sys.stdout).print(table)

    def note(self, text: str) -> None:
        """Something worth knowing, on standard error."""
        if not self.quiet:
            _console(sys.stderr).print(Text(text, style="dim"), soft_wrap=True)

    def warning(self, text: str) -> None:
        """Something the user should read, on standard error."""
        if not self.quiet:
            _console(sys.stderr).print(Text("warning: ", style="yellow") + Text(text), soft_wrap=True)

    @contextmanager
    def progress(self) -> Iterator[ProgressCallback | None]:
        """A listener that shows a bar on standard error, if that is a terminal."""
        console = _console(sys.stderr)
        if self.quiet or not console.is_terminal:
            yield None
            return
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True) as bar:
            tasks: dict[str, Any] = {}

            def step(stage: str, done: int, total: int) -> None:
                if stage not in tasks:
                    tasks[stage] = bar.add_task(stage, total=total)
                bar.update(tasks[stage], completed=done, total=total)

            yield step


def print_error(message: str) -> None:
    """One message on standard error."""
    _console(sys.stderr).print(Text("sgpr: ", style="bold red") + Text(message), soft_wrap=True)


def to_json(data: Any, *, ascii_only: bool = False) -> str:
    """JSON text: numbers that JSON does not know (infinite, not a number) become null."""
    return json.dumps(plain(data), indent=2, ensure_ascii=ascii_only, allow_nan=False) + "\n"


def plain(data: Any) -> Any:
    """Lists, dicts, strings and finite numbers only."""
    match data:
        case Mapping():
            return {str(key): plain(value) for key, value in data.items()}
        case str() | bool() | None:
            return data
        case np.ndarray():
            return plain(data.tolist())
        case np.generic():
            return plain(data.item())
        case float():
            return data if math.isfinite(data) else None
        case int():
            return data
        case Sequence():
            return [plain(value) for value in data]
    return str(data)


def _console(stream: Any) -> Console:
    console = Console(file=stream, highlight=False)
    # A file has no width: lines of a table must not be cut at that of a terminal that is not there.
    return console if console.is_terminal else Console(file=stream, highlight=False, width=WIDTH_OF_FILES)
