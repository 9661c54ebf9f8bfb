"""Options of the command line, keywords in Python, stubs and the options of the core: one set under one name."""

import ast
import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sgpr
import typer.main
from sgpr.cli.app import app
from sgpr.cli.reading import ReadingOptions

CRATES = Path(__file__).parents[2]
STUB = ast.parse((Path(sgpr.__file__).parent / "_sgpr.pyi").read_text())
ROBOT = sgpr.robots.two_link()

CALLS: dict[str, Callable[..., Any]] = {
    "choose_processing": lambda **options: sgpr.choose_processing(ROBOT, [], **options),
    "compare_sessions": lambda **options: sgpr.compare_sessions(ROBOT, {"a": [], "b": []}, **options),
    "cutoff_influence": lambda **options: sgpr.cutoff_influence(ROBOT, [], sgpr.Model.nominal(ROBOT), **options),
    "identify_payload": lambda **options: sgpr.identify_payload(ROBOT, [], [], **options),
    "identify_drive_gains": lambda **options: sgpr.identify_drive_gains(ROBOT, [], [], payload={}, **options),
    "excite": lambda **options: sgpr.excite(ROBOT, max_acceleration=[1.0, 1.0], **options),
    "simulate": lambda **options: sgpr.simulate(ROBOT, [0.0, 0.0], **options),
    "random": lambda **options: sgpr.Trajectory.random(ROBOT, max_acceleration=[1.0, 1.0], **options),
}
"""Functions that hand keywords on to others; the message about an unknown one lists all that they take."""


def keys_of(name: str) -> set[str]:
    """Keys of a dictionary of options in the stub, with those of what it extends."""
    (found,) = (node for node in STUB.body if isinstance(node, ast.ClassDef) and node.name == name)
    bases = [base.id for base in found.bases if isinstance(base, ast.Name) and base.id != "TypedDict"]
    own = {
        line.target.id for line in found.body if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name)
    }
    return own.union(*map(keys_of, bases))


def stub_of(name: str) -> ast.FunctionDef:
    """A function of the stub, or a method that no other class has."""
    (found,) = (node for node in ast.walk(STUB) if isinstance(node, ast.FunctionDef) and node.name == name)
    return found


@pytest.mark.parametrize("name", CALLS)
def test_the_stub_has_the_options_that_the_module_takes(name: str) -> None:
    with pytest.raises((TypeError, sgpr.SgprError)) as told:
        CALLS[name](no_such_option=1)
    listed = re.search(r"(?:options|known) are (.*)", str(told.value))
    assert listed, told.value
    arguments = stub_of(name).args
    handed_on: set[str] = set()
    if arguments.kwarg is not None:
        annotation = ast.unparse(arguments.kwarg.annotation or ast.Constant(None))
        handed_on = keys_of(annotation.removeprefix("Unpack[").removesuffix("]"))
    assert handed_on | {each.arg for each in arguments.kwonlyargs} >= set(listed[1].split(", "))
    assert handed_on <= set(listed[1].split(", "))


READING = {field.name for field in dataclasses.fields(ReadingOptions)}
OUTPUT = {"json", "quiet", "out", "no_report", "open_report", "strict", "report", "mcap"}
ARM = {"robot", "joints", "gravity", "arm"}
LOGS = {"train", "test", "files", "logs", "motion", "unloaded", "loaded"}
OF_THE_COMMAND = READING | OUTPUT | ARM | LOGS
"""How logs are read, where results go, and what files are named: arguments of other functions in Python."""

OF_PROGRAMS = {"progress", "recordings", "robot", "model", "reference", "sessions", "processing", "ranked"}
"""What a program has in its hands."""

RENAMED = {
    "cutoff": "cutoff_hz",
    "order": "filter_order",
    "jobs": "n_jobs",
    "look_for": "effects",
    "seed": "random_state",
}
RENAMED |= {"fundamental": "fundamental_hz", "box": "boxes", "evaluations": "max_evaluations"}
RENAMED |= {
    "period": "control_period",
    "resolution": "position_resolution",
    "known": "payload",
    "lowest_gains": "lowest",
}
"""Options with a shorter name on the command line."""

COMMANDS: dict[str, tuple[tuple[str, ...], set[str], set[str]]] = {
    "identify": (
        ("identify",),
        {"no_prior"},
        # Noise that is known, and what `sgpr info` tells of a log.
        {"noise", "forecast"},
    ),
    "diagnose": (("diagnose",), {"effects", "apply"}, set()),
    "excite": (
        ("excite",),
        {"rate"},
        # A shape of its own for each link is an object.
        {"n_jobs", "link_shapes"},
    ),
    "simulate": (
        ("simulate",),
        set(),
        {"feed_forward", "drives", "integrator", "record_period", "position_noise", "actuation_noise", "velocity"}
        | {"torque_limits", "pick_up", "duration"},
    ),
    "sessions": (("compare_sessions",), set(), set()),
    "payload": (
        ("identify_payload", "identify_drive_gains"),
        set(),
        {"method", "noise", "start", "essential", "forecast", "uncertainty", "instruments", "kp", "kd"},
    ),
}
"""Functions behind a command, options that the command alone has, and keywords that it does without."""


def keywords_of(name: str) -> dict[str, Any]:
    """Keywords of a function with their defaults, by the stub; those that are handed on have none here."""
    arguments = stub_of(name).args
    found: dict[str, Any] = {}
    if arguments.kwarg is not None:
        annotation = ast.unparse(arguments.kwarg.annotation or ast.Constant(None))
        found = dict.fromkeys(keys_of(annotation.removeprefix("Unpack[").removesuffix("]")))
    with_default = arguments.args[len(arguments.args) - len(arguments.defaults) :]
    for argument, default in (
        *zip(with_default, arguments.defaults, strict=True),
        *zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True),
    ):
        found[argument.arg] = None if default is None else ast.literal_eval(default)
    return found


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_line_has_the_keywords_of_python(command: str) -> None:
    functions, of_the_command, of_python = COMMANDS[command]
    keywords: dict[str, Any] = {}
    for function in functions:
        keywords |= keywords_of(function)
    parameters = typer.main.get_command(app).commands[command].params  # type: ignore[attr-defined]
    options = {RENAMED.get(str(each.name), str(each.name)): each.default for each in parameters}
    own = set(options) - OF_THE_COMMAND - of_the_command
    assert own - set(keywords) == set(), "an option that no keyword of Python has"
    assert set(keywords) - set(options) - OF_PROGRAMS - LOGS == of_python, "a keyword that no option has"
    for name in own:
        # None stands for what the help says in words, or for what the function itself takes.
        if options[name] is not None and keywords[name] is not None:
            assert options[name] == keywords[name], name


CORE: dict[str, tuple[str, str, dict[str, tuple[str, ...]]]] = {
    "IdentifyOptions": (
        "sgpr-core/src/model/identify/mod.rs",
        "identify",
        {
            "consistency": ("consistent", "prior", "prior_deviation", "bounds"),
            "cross_validated_prior": ("prior_deviation",),
            "controller": ("kp", "kd"),
            "conditioning": ("cutoff_hz", "filter_order"),
        },
    ),
    "Conditioning": ("sgpr-core/src/motion/processing.rs", "identify", {"order": ("filter_order",)}),
    "ExciteOptions": (
        "sgpr-core/src/excitation/optimise.rs",
        "excite",
        {
            "limits": ("max_acceleration", "position_range", "max_velocity", "max_torque"),
            "parameters": ("model",),
            "nominal": ("model", "effects"),
            "surroundings": ("floor", "boxes", "self_collision", "clearance", "max_tip_speed"),
            "evaluations": ("max_evaluations",),
            "threads": ("n_jobs",),
            "seed": ("random_state",),
        },
    ),
}
"""Options of the core: file, function in Python, and the keywords of fields that are called otherwise."""


@pytest.mark.parametrize("name", CORE)
def test_options_of_the_core_are_keywords_of_python(name: str) -> None:
    file, function, renamed = CORE[name]
    struct = re.search(rf"pub struct {name}(?:<[^>]*>)? \{{(.*?)\n\}}", (CRATES / file).read_text(), re.DOTALL)
    assert struct, name
    fields = re.findall(r"^    pub (\w+):", struct[1], re.MULTILINE)
    assert len(fields) > 5 and set(renamed) <= set(fields)
    keywords = set(keywords_of(function))
    for field in fields:
        for keyword in renamed.get(field, (field,)):
            assert keyword in keywords, f"{name}::{field} is no keyword of sgpr.{function}"
