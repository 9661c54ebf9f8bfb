"""Options with several values: `--train a.csv b.csv` is understood like `--train a.csv --train b.csv`."""

import re
from collections.abc import Collection, Iterable
from typing import Any

from typer.core import TyperCommand

from .errors import wrong_use

FILES = ("--robot", "--train", "--test")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


class Command(TyperCommand):
    """A command whose options of several values take all that follow, up to the next option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses what the user wrote."""
        known = {name for param in self.params for name in param.opts}
        several = [param for param in self.params if getattr(param, "multiple", False)]
        names = {name: is_pair(param.metavar) for param in several for name in param.opts}
        takes_value = {
            name: param.nargs
            for param in self.params
            if param.param_type_name == "option" and not getattr(param, "is_flag", False)
            for name in param.opts
        }
        words = expand(args, names, takes_value, known)
        if not any(param.param_type_name == "argument" for param in self.params):
            self._no_bare_words(words, takes_value, known)
        return super().parse_args(ctx, words)

    def _no_bare_words(self, words: list[str], takes_value: dict[str, int], known: set[str]) -> None:
        """A file without its option is told which options take files; the parser would call it extra."""
        rest = list(words)
        while rest:
            word = rest.pop(0)
            if word in takes_value:
                del rest[: takes_value[word]]
            elif word.startswith("--") and word.partition("=")[0] not in known:
                return  # The parser names it, and what may have been meant.
            elif not word.startswith("-"):
                required = [param.opts[0] for param in self.params if param.required]
                options = dict.fromkeys([*(name for name in FILES if name in takes_value), *required])
                raise wrong_use(f"needs its option before it: {', '.join(options)}", word)


def is_pair(metavar: str | None) -> bool:
    """Whether the values of an option are of the form KEY=VALUE, so that anything else is none of them."""
    return metavar is not None and "=" in metavar


def expand(
    args: Iterable[str], several: dict[str, bool], takes_value: dict[str, int], known: Collection[str] = ()
) -> list[str]:
    """Repeats the option before each of its values.

    - `several`: options with several values, and whether these are of the form KEY=VALUE
    - `takes_value`: how many values each option takes at a time
    - `known`: options, which are never the value of another one
    """
    result: list[str] = []
    rest = list(args)
    while rest:
        argument = rest.pop(0)
        if argument == "--":
            return [*result, argument, *rest]
        name, _, attached = argument.partition("=") if argument.startswith("--") else (argument, "", "")
        result.append(argument)
        if name not in several:
            if name in takes_value and not attached:
                if early := [word for word in rest[: takes_value[name]] if word in known]:
                    count = takes_value[name]
                    raise wrong_use(f"needs {'a value' if count == 1 else f'{count} values'} before {early[0]}", name)
                result += rest[: takes_value[name]]
                del rest[: takes_value[name]]
            continue
        pair = several[name]
        if not attached and rest:
            if not is_value(rest[0], pair=False):
                raise wrong_use(f"needs a value before {rest[0]}", name)
            # Where already the first is no pair, all that follows belongs to the same mistake.
            pair = pair and "=" in rest[0]
            result.append(rest.pop(0))
        while rest and is_value(rest[0], pair=pair):
            result += [name, rest.pop(0)]
    return result


def is_value(argument: str, *, pair: bool) -> bool:
    """Whether an argument continues the list of values."""
    if argument.startswith("-") and not NUMBER.fullmatch(argument):
        return False
    return "=" in argument if pair else True
