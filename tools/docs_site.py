"""Pages of the site that follow from the library, and links that lead out of the site.

mkdocs calls these functions (see mkdocs.yml). Generated are the command line (from its parser), the Python reference
(from docstrings), the effects (from the catalogue), error messages, the numbers of the diagnosis (from its sources),
and a page for each data set.
"""

import inspect
import os
import re
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import click
import sgpr
import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from sgpr.cli.app import app
from sgpr.cli.console import OUTPUT_PANEL
from sgpr.cli.data import identify_command

sys.path.insert(0, str(Path(__file__).parent))
from docstrings import described, stub_signatures

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

PYTHON = {
    "Robots, logs, reading": [
        "Robot",
        "robots",
        "read",
        "read_csv",
        "read_mcap",
        "Recording",
        "LogSet",
        "Repaired",
        "Issue",
    ],
    "Identification": [
        "identify",
        "Model",
        "IdentificationReport",
        "Parameters",
        "Parameter",
        "BaseParameters",
        "Processing",
        "identify_payload",
        "identify_drive_gains",
        "Effect",
        "effects",
        "register_effect",
    ],
    "Comparison and diagnosis": [
        "compare",
        "compare_streaming",
        "Comparison",
        "compare_sessions",
        "SessionComparison",
        "diagnose",
        "Diagnosis",
        "Finding",
    ],
    "What physics leaves over": ["SemiParametricModel", "GaussianProcess", "Kernel"],
    "In a control loop": [
        "Predictor",
        "SemiParametricPredictor",
        "Compensation",
        "MomentumObserver",
        "OnlineModel",
        "OnlineGaussianProcess",
    ],
    "Motion": ["excite", "Excitation", "Trajectory", "simulate", "Simulation", "Drive"],
    "Data sets": ["datasets"],
}
"""What stands first; every other public name comes under "More"."""

PARTS = {
    "recording": "Logs",
    "robot": "Robots",
    "motion": "Motion",
    "signal": "Filters",
    "identification": "Identification",
    "effects": "Effects",
    "diagnosis": "Diagnosis",
    "model/record": "Records of logs",
    "model/semi_parametric": "Learned models",
    "model": "Models",
    "gp": "Gaussian processes",
    "excitation": "Excitation",
    "simulation": "Simulation",
    "export": "Export",
    "stream": "Control loop",
    "control": "Torque from outside",
    "online": "Models that learn while the arm runs",
    "progress": "Interrupted work",
}
"""Where messages come from, in the words of a user."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Leaves out pages that do not exist, fills in those of folders, and adds those that the list does not know."""
    every = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} | set(_generated())
    known: set[str] = set()
    config.nav = [
        {title: [there for page in pages if (there := _there(page, every, known))]}
        for part in config.nav
        for title, pages in part.items()
    ]
    if more := sorted(every - known):
        config.nav.append({"More": more})
    return config


def _there(entry: str | dict[str, str], every: set[str], known: set[str]) -> Any:
    """An entry of the list with what there is of it."""
    if isinstance(entry, str):
        known |= {entry} & every
        return entry if entry in every else None
    ((title, pattern),) = entry.items()
    pages = sorted(page for page in every if fnmatch(page, pattern))
    # The index of a folder comes first.
    pages.sort(key=lambda page: not page.endswith("index.md"))
    known.update(pages)
    return {title: pages} if pages else None


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Adds the pages that follow from the library."""
    for name, text in _generated().items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to files of the repository, which the site does not have, become their names."""
    folder = (DOCS / page.file.src_uri).parent

    def replace(match: re.Match[str]) -> str:
        text, target = match.groups()
        place = (folder / target.partition("#")[0]).resolve()
        if re.match(r"[a-z]+:|#", target):
            return match.group()
        if place.is_dir() and place.is_relative_to(DOCS):
            return f"[{text}]({os.path.relpath(place / 'index.md', folder)})"
        if place.is_relative_to(DOCS) and place.suffix != ".ipynb":
            return match.group()
        name = place.relative_to(ROOT).as_posix()
        return f"{text} (`{name}` in the repository)"

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", replace, markdown)


def on_page_content(html: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """An option in a line of text stays in one piece; browsers would break it behind its first hyphen."""

    def replace(match: re.Match[str]) -> str:
        return re.sub(r"(?<![\w-])--?[a-z][a-z-]*", r'<span class="option">\g<0></span>', match.group())

    return re.sub(r"(?<!<pre>)<code>[^<]*</code>", replace, html)


def _generated() -> dict[str, str]:
    """Page -> text."""
    pages = {
        "reference/command-line.md": "\n".join(command_line()),
        "reference/python.md": "\n".join(python_index()),
        "effects/index.md": "\n".join(effects()),
        "reference/diagnosis-numbers.md": "\n".join(diagnosis_numbers()),
        "reference/errors.md": (DOCS / "reference/errors.md").read_text() + "\n".join(messages()),
    }
    pages |= {f"reference/python/{_slug(title)}.md": "\n".join(python(title, names)) for title, names in groups()}
    return pages | {f"datasets/{name}.md": "\n".join(dataset(name)) for name in sgpr.datasets.names()}


def command_line() -> Iterator[str]:
    """Every command with its options, as `--help` says."""
    yield "# Command line\n"
    yield "From the parser of the program: what `sgpr COMMAND --help` says. Options whose value ends in ..."
    yield "take several values. Exit code: 0 success, 1 bad data (with `--strict` also a limit that is not met, or a "
    yield "model worse than the one before), 2 wrong use, 130 Ctrl-C.\n"
    program = typer.main.get_command(app)
    yield from _commands(program, "sgpr")


def _commands(group: Any, name: str) -> Iterator[str]:
    for command in group.commands.values():
        whole = f"{name} {command.name}"
        if hasattr(command, "commands"):
            yield from _commands(command, whole)
            continue
        yield f"## {whole}\n"
        yield f"{inspect.cleandoc(command.help or '')}\n"
        context = click.Context(command)
        panels: dict[str, list[Any]] = {}
        for parameter in command.params:
            panels.setdefault(getattr(parameter, "rich_help_panel", None) or "", []).append(parameter)
        # Options of the command itself first, those of all commands last.
        for panel, parameters in sorted(panels.items(), key=lambda item: (item[0] == OUTPUT_PANEL, bool(item[0]))):
            if panel:
                yield f"**{panel}**\n"
            yield "| option | value | what it does |\n|---|---|---|"
            for each in parameters:
                yield _option(each, context)
            yield ""


def _option(parameter: Any, context: Any) -> str:
    argument = parameter.param_type_name == "argument"
    names = parameter.metavar or parameter.name if argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    flag = getattr(parameter, "is_flag", False)
    value = "" if argument or flag else parameter.metavar or parameter.name.upper()
    text = " ".join((getattr(parameter, "help", None) or "").split())
    shown = getattr(parameter, "show_default", None)
    default = shown if isinstance(shown, str) else parameter.default
    if parameter.required:
        text += " *Required.*"
    elif default not in (None, False, "", ()) and not callable(default):
        text += f" Default: {default}."
    return "| " + " | ".join((f"`{names}`", f"`{value}`" if value else "", text.replace("|", "\\|"))) + " |"


def groups() -> list[tuple[str, list[str]]]:
    """The public names of the library by subject; all of them, each once."""
    named = {name for names in PYTHON.values() for name in names}
    rest = [name for name in sgpr.__all__ if name not in named and not name.startswith("__")]
    return [*PYTHON.items(), ("More", rest)]


def _slug(title: str) -> str:
    return re.sub(r"\W+", "-", title.lower()).strip("-")


def python_index() -> Iterator[str]:
    """All public names with their first sentence."""
    yield "# Python\n"
    yield "Arrays are `[samples, joints]`, SI units. What the library refuses is an `SgprError`, a `ValueError`.\n"
    for title, names in groups():
        page = f"python/{_slug(title)}.md"
        yield f"## {title}\n\n| name | what it is |\n|---|---|"
        for name in names:
            text = inspect.getdoc(getattr(sgpr, name)) or ""
            yield f"| [`{name}`]({page}#sgpr.{name}) | {_first(text)} |"
        yield ""


def _first(text: str) -> str:
    """The first sentence."""
    paragraph = " ".join(text.split("\n\n")[0].split())
    return re.split(r"(?<=[.!?])\s", paragraph)[0].replace("|", "\\|")


def python(title: str, names: list[str]) -> Iterator[str]:
    """A page of docstrings."""
    yield f"# {title}\n"
    signatures = stub_signatures()
    for name in names:
        yield from described(name, getattr(sgpr, name), signatures)


def effects() -> Iterator[str]:
    """The catalogue."""
    yield "# Effects\n"
    yield "What a model can have beside rigid bodies, and what a diagnosis looks for. Also: `sgpr effects NAME`.\n"
    yield "| effect | what it is | seen as |\n|---|---|---|"
    for effect in sgpr.effects():
        cells = (f"[`{effect['name']}`]({effect['name']}.md)", effect["summary"], effect["signature"])
        yield "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def diagnosis_numbers() -> Iterator[str]:
    """Every named number of the diagnosis, with the sentence that stands above it."""
    yield "# Numbers of the diagnosis\n"
    yield "Every number with a name in the diagnosis, in the order of its sources, and what it is for. What decides,"
    yield "and why, is told in [the method](../diagnosis.md).\n"
    source = ROOT / "crates/sgpr-core/src/diagnosis"
    constant = re.compile(
        r"((?:^ *//[^\n]*\n)*)^ *(?:pub(?:\([a-z: ]+\))? )?const (\w+): (?!&str)[^=\n]+ = ([^;]+);", re.M
    )
    for path in sorted(source.rglob("*.rs")):
        own = constant.findall(path.read_text().split("#[cfg(test)]")[0])
        if own:
            yield f"\n## {path.relative_to(source).with_suffix('')}\n\n| number | value | what for |\n|---|---|---|"
        for comment, name, value in own:
            words = " ".join(line.strip().lstrip("/").strip() for line in comment.splitlines())
            yield f"| `{name}` | {' '.join(value.split())} | " + words.replace("|", "\\|") + " |"


def messages() -> Iterator[str]:
    """Every error message of the crates that compute, by the part of the library that says it."""
    yield "\n## All messages\n\nWords in braces stand for what was found: a file, a joint, a number.\n"
    by_part: dict[str, list[str]] = {title: [] for title in PARTS.values()}
    # Where a crate is one room of the library, its files are those of the room.
    crates = {"core": "", "predict": "", "recording": "recording/", "gp": "gp/", "numeric": ""}
    for crate, room in crates.items():
        source = ROOT / f"crates/sgpr-{crate}/src"
        for path in sorted(source.rglob("*.rs")):
            texts = re.findall(r'#\[error\("((?:[^"\\]|\\.)*)"', path.read_text())
            if said := [text for text in texts if re.sub(r"\{[^}]*\}", "", text).strip(": ")]:
                place = room + path.relative_to(source).as_posix()
                by_part[next(title for part, title in PARTS.items() if place.startswith(part))] += said
    for title, said in by_part.items():
        yield f"### {title}\n"
        yield from (f"- `{text.replace('`', '')}`" for text in said)
        yield ""


def dataset(name: str) -> Iterator[str]:
    """A recipe: what the robot is, one command, and what comes out."""
    known = sgpr.datasets.describe(name)
    found = sgpr.datasets.Fetched(known, Path(name))
    yield f"# {name}\n"
    yield f"{known.robot}. {known.physics}\n"
    yield f"- Torque: {known.torque}, {known.rate_hz:g} Hz"
    yield f"- Licence: {known.licence}"
    yield f"- Cite: {known.citation}"
    yield f"- Origin: <{known.home}>, {known.size / 1e6:.1f} MB\n"
    yield "## Recipe\n"
    command = f"sgpr data get {name}\n"
    if known.robot_file:
        command += _wrapped(identify_command(found))
    yield f"```text\n{command}\n```\n"
    if known.program:
        yield f"```python\n{known.program.strip()}\n```\n"
        yield f"*Expected*: {known.expected}.\n"
    if known.unseen_percent is not None:
        yield f"*Expected*: {known.unseen_percent:g} % of the torque of the test logs is left, while a joint moves.\n"
    if known.published:
        yield f"*Published*: {known.published}.\n"
    yield "| log | for | what |\n|---|---|---|"
    for log in known.logs:
        yield f"| `{log.file}` | {log.role} | {log.what} |"
    if known.settings:
        yield f"\n`sgpr.toml` beside the logs says how they are read:\n\n```toml\n{known.settings.strip()}\n```"


def _wrapped(command: list[str]) -> str:
    """A command with a line for each option."""
    return " ".join(f"\\\n    {word}" if word.startswith("--") else word for word in command).replace(" \\", " \\")
