"""What can go wrong, and the exit code that says so: 2 for wrong use, 1 for bad data."""

import difflib
import functools
import re
import warnings
from collections.abc import Callable, Iterable
from typing import Any

import typer

from .. import SgprError
from .console import print_error

FEW = 12
BAD_DATA = 1
LIMITS_NOT_MET = 1
STOPPED = 130
PANIC = "PanicException"
"""What a broken assertion of the compiled half is called; it is no `Exception`."""


# What messages of the library call it -> what it is called here.
OPTIONS = {
    r"\(resample: ([\d.]+) Hz\)": r"(--resample \1)",
    r"\(repair: sort, drop_duplicates\)": "(--sort, --drop-duplicates)",
    r"\(repair: drop_not_finite\)": "(--drop-not-finite)",
    r"\(repair: replace_strays\)": "(--replace-strays)",
    r"\(repair: drop_repeated\)": "(--drop-repeated)",
    r"\(repair: drop_duplicates\)": "(--drop-duplicates)",
    r"\(repair: sort\)": "(--sort)",
    r"\(repair: unwrap\)": "(--unwrap)",
    r"\(repair: trim\)": "(--trim)",
    r"\(accept: (\w+)\)": r"(--accept \1)",
    r"`accept=\[\"(\w+)\"\]`": r"`--accept \1`",
    r"`units\.(\w+)`": r"`--units \1=...`",
    r"`columns\.(\w+)`": r"`--columns \1=...`",
    r"`sample_rate_hz`": "`--rate`",
    r"`joints`": "`--joints`",
    r"`topics`": "`--topics`",
    r"`recover`": "`--recover`",
    r"`torque_constants`": "`--torque-constants`",
    r"\btorque_constants: got\b": "--torque-constants: got",
    r"\blogged_names: got\b": "--logged-joints: got",
    r"`logged_names`": "`--logged-joints`",
    r"`columns`": "`--columns`",
    r"`units`": "`--units`",
    r"`rows`": "`--rows`",
    r"`seconds`": "`--trim`",
    r"`clock`": "`--clock`",
    r" \(for a table of another name: read_csv\)": "; a table of another name needs one of these endings",
    r"`speed_limit`": "`--speed-limit`",
    r"`position_range`": "`--position-range`",
    r"`max_velocity`": "`--max-velocity`",
}


class BadData(Exception):
    """Files that cannot be used as they are; the message says which, why, and what to do."""


def wrong_use(message: str, option: str | None = None) -> typer.BadParameter:
    """The command line itself is wrong; to be raised."""
    return typer.BadParameter(message, param_hint=option)


def check_seed(seed: int) -> None:
    """Refuses what no generator of random numbers takes."""
    if not 0 <= seed < 2**64:
        raise wrong_use(f"{seed} is no seed: a whole number from 0 to 2^64 - 1", "--seed")


def one_of(value: str, known: Iterable[str], option: str, what: str) -> str:
    """`value`, if it is known; otherwise wrong use, with the nearest known value and, if they are few, all of them."""
    known = list(known)
    if value in known:
        return value
    near = difflib.get_close_matches(value, known, n=1) or [
        name for name in known if difflib.get_close_matches(value, name.split("_"), n=1)
    ]
    hint = f", did you mean {near[0]}?" if near else "."
    more = f"Known are {', '.join(known)}."
    if what == "effect" and len(known) > FEW:
        more = "`sgpr effects` lists all."
    raise wrong_use(f"there is no {what} `{value}`{hint} {more}", option)


def guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command with one clear message and an exit code in place of a traceback."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> Any:
        try:
            with warnings.catch_warnings():
                # Findings of the library are told as such, with their ranks.
                warnings.simplefilter("ignore", UserWarning)
                return command(*args, **kwargs)
        except (typer.Exit, typer.Abort, typer.TyperException, BrokenPipeError):
            raise
        except KeyboardInterrupt:
            print_error("stopped; nothing was written")
            raise typer.Exit(STOPPED) from None
        except MemoryError:
            print_error("there is not enough memory for this; use a part of the logs (--trim, --rows)")
        except OSError as error:
            print_error(_of_system(error))
        except (BadData, SgprError) as error:
            print_error(of_command_line(str(error)))
        except BaseException as error:
            if not (isinstance(error, Exception) or type(error).__name__ == PANIC):
                raise
            print_error(f"this should not happen, please report it: {type(error).__name__}: {error}")
        raise typer.Exit(BAD_DATA)

    return run


def of_command_line(message: str) -> str:
    """A message of the library, with the options of the command line in the place of arguments."""
    for pattern, option in OPTIONS.items():
        message = re.sub(pattern, option, message)
    return message


def _of_system(error: OSError) -> str:
    text = error.strerror or str(error)
    return f"{error.filename}: {text}" if error.filename else text
