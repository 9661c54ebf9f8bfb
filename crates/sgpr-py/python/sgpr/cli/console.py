"""What a command prints: results on standard output, everything else on standard error."""

import json
import math
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer
from rich import box
from rich.cells import cell_len
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
        spare: Sequence[str] = (),
    ) -> None:
        """A table of the result for people; numbers are aligned to the right and never cut.

        Where the terminal is too narrow, columns of `spare` go, the first one first; what then is still too wide
        is said in several tables, each with the first column.
        """
        if not self._talks:
            return
        console = _console(sys.stdout)
        widths = [max([_width(head), *(_width(row[k]) for row in rows)]) for k, head in enumerate(columns)]
        kept = _fitting(columns, widths, spare, console.width)
        for number, part in enumerate(_parts(kept, widths, console.width)):
            table = Table(
                box=box.SIMPLE_HEAD,
                title=escape(title) if title and number == 0 else None,
                title_justify="left",
                title_style="bold",
            )
            for k in part:
                justify: Any = "left" if k in text_columns else "right"
                alone = len(part) <= 2 and k in text_columns
                table.add_column(
                    escape(columns[k]), justify=justify, no_wrap=not alone, overflow="fold" if alone else "ellipsis"
                )
            for row in rows:
                table.add_row(*(escape(row[k]) for k in part))
            console.print(table)
        gone = [column for k, column in enumerate(columns) if k not in kept]
        if gone:
            console.print(Text(f"not shown at this width: {', '.join(gone)}", style="dim"), soft_wrap=True)

    def told(self, text: str) -> None:
        """How the input was understood, on standard error; JSON has it in its own way."""
        if self._talks:
            _console(sys.stderr).print(Text(text, style="dim"), soft_wrap=True)

    def next(self, *command: str, why: str = "") -> None:
        """The command that makes sense now."""
        if self._talks:
            reason = f"  ({why})" if why else ""
            text = Text("next: ", style="bold") + Text(shlex.join(command)) + Text(reason, style="dim")
            _console(sys.stdout).print(text, soft_wrap=True)

    def bad(self, text: str) -> None:
        """A result that the user cannot want."""
        if not self.quiet:
            _console(sys.stderr).print(Text(text, style="bold red"), soft_wrap=True)

    def note(self, text: str) -> None:
        """Something worth knowing, on standard error."""
        if not self.quiet:
            _console(sys.stderr).print(Text(text, style="dim"), soft_wrap=True)

    def finding(self, text: str, style: str) -> None:
        """Something found, on standard error."""
        if not self.quiet:
            _console(sys.stderr).print(Text(text, style=style), soft_wrap=True)

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


BETWEEN_COLUMNS = 2
"""Blanks that a table has beside each of its columns, all in all, and two at its ends."""


def _width(cell: str) -> int:
    return max((cell_len(line) for line in cell.splitlines()), default=0)


def _total(part: Sequence[int], widths: Sequence[int]) -> int:
    return sum(widths[k] + BETWEEN_COLUMNS for k in part) + len(part) + 1


def _fitting(columns: Sequence[str], widths: Sequence[int], spare: Sequence[str], width: int) -> list[int]:
    """Numbers of the columns that stay."""
    kept = list(range(len(columns)))
    for name in spare:
        if _total(kept, widths) <= width:
            break
        kept = [k for k in kept if columns[k] != name]
    return kept


def _parts(kept: Sequence[int], widths: Sequence[int], width: int) -> list[list[int]]:
    """Columns in tables that fit, each with the first column."""
    first, *others = kept
    parts = [[first]]
    for k in others:
        if len(parts[-1]) > 1 and _total([*parts[-1], k], widths) > width:
            parts.append([first])
        parts[-1].append(k)
    return parts


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
