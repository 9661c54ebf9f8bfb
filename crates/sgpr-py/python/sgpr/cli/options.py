"""Options that several commands share: types of single ones, and groups kept together as dataclasses."""

import dataclasses
import functools
import inspect
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from .errors import wrong_use

OutFolder = Annotated[
    str, typer.Option("--out", metavar="DIR", help="Folder for the results; an existing one is reused.")
]
Joints = Annotated[
    list[str] | None,
    typer.Option("--joints", metavar="JOINT...", help="Joints of the URDF to model; the others are locked."),
]
Gravity = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--gravity", metavar="X Y Z", help="Gravity in base axes, m/s².", show_default="0 0 -9.81"),
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Write no report.html.")]
Open = Annotated[bool, typer.Option("--open", help="Show the report in the browser.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="Exit with 1 if the model is worse on the test logs than the one before.")
]


def open_page(path: Path) -> None:
    """Shows a page in the browser of the user."""
    webbrowser.open(path.resolve().as_uri())


def check_not_input(out: str, inputs: Sequence[str]) -> None:
    """Refuses to write over what is read."""
    place = Path(out)
    if place.exists() and any(Path(given).exists() and place.samefile(given) for given in inputs):
        raise wrong_use(f"{out} is read by this command and would be overwritten", "--out")


def with_option_groups(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command in which each parameter whose type is a dataclass is replaced by one option per field."""
    hints = get_type_hints(command, include_extras=True)
    signature = inspect.signature(command)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if dataclasses.is_dataclass(hint)}
    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if name not in groups:
            parameters.append(parameter.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        types = get_type_hints(groups[name], include_extras=True)
        for field in dataclasses.fields(groups[name]):
            kind = inspect.Parameter.KEYWORD_ONLY
            parameters.append(inspect.Parameter(field.name, kind, default=field.default, annotation=types[field.name]))

    @functools.wraps(command)
    def flat(**values: Any) -> Any:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in dataclasses.fields(group)})
        return command(**values)

    del flat.__wrapped__
    flat.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return flat
