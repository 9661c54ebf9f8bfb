"""Names of effects on the command line, and `sgpr effects`, which explains them."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from .. import effects as registry
from .console import Output
from .errors import one_of

DEFAULT_EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset")


def effects_option(help_: str, usual: Sequence[str] = DEFAULT_EFFECTS, panel: str | None = None) -> Any:
    """The option that names the effects of a model."""
    return typer.Option(
        "--effects", metavar="EFFECT...", help=help_, show_default=" ".join(usual), rich_help_panel=panel
    )


def checked_effects(names: Sequence[str], option: str = "--effects") -> list[str]:
    """The effects, each once, as `effect` or `effect@joint`; `none` stands for no effect."""
    if list(names) == ["none"]:
        return []
    known = [effect["name"] for effect in registry()]
    for name in names:
        one_of(name.partition("@")[0], known, option, "effect")
    return list(dict.fromkeys(names))


def fitted_effects(*wishes: Sequence[str] | None) -> list[str]:
    """The first wish that there is, checked; the usual effects of a fit if there is none."""
    return checked_effects(next((wish for wish in wishes if wish is not None), DEFAULT_EFFECTS))


def effects(
    output: Output,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Effects to explain.", show_default="a list of all")
    ] = None,
) -> None:
    """Lists the physical effects of the library, or explains some of them."""
    known = {effect["name"]: effect for effect in registry()}
    for name in names or ():
        one_of(name, known, "NAME", "effect")
    if not names:
        output.table(
            ["effect", "what it is"], [[name, effect["summary"]] for name, effect in known.items()], text_columns=(0, 1)
        )
        output.line(f"in a fit from the start: {', '.join(DEFAULT_EFFECTS)}")
        output.next("sgpr", "effects", "coulomb_friction", why="explains one")
    for name in names or ():
        show_effect(known[name], output)
    output.result([known[name] for name in names] if names else list(known.values()))


def show_effect(effect: dict[str, Any], output: Output) -> None:
    """An effect for people."""
    output.heading(effect["name"])
    output.line(effect["summary"])
    said = {
        "torque": effect["formula"],
        "seen as": effect["signature"],
        "needs": effect["excitation"],
        "looks like": ", ".join(effect["confusable_with"]),
        "told apart by": effect["experiment"],
        "the same as": effect["alias_of"] or "",
        "source": effect["source"],
        "in a controller": f"it is of {effect['origin']}, and a feed-forward torque "
        f"{'holds it' if effect['fed_forward'] else 'leaves it out (--keep, keep=)'}: {effect['origin_reason']}",
    }
    for what, text in said.items():
        if text:
            output.line(f"  {what}: {text}")
    for symbol, unit, sliding in effect["parameters"]:
        other = f" ({sliding} for a joint that slides)" if sliding != unit else ""
        output.line(f"  parameter {symbol}: {unit or '1'}{other}")
    for symbol, unit, low, high in effect["constants"]:
        where = f"from {low:g} to {high:g} {unit}" if math.isfinite(low) else "among the times of the logs"
        output.line(f"  constant {symbol}: looked for {where}")
    output.line("")
