"""Docstrings in NumPy's style as Markdown, with the types of the stub file."""

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import sgpr

LINE = 88
"""Characters that a signature may have."""

STUB = Path(sgpr.__file__).with_name("_sgpr.pyi")


def stub_signatures() -> dict[str, str]:
    """`Class.method` or `function` -> its parameters and result, as the stub file has them."""
    found: dict[str, str] = {}

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef):
                visit(node.body, f"{node.name}.")
            elif isinstance(node, ast.FunctionDef):
                is_property = any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)
                result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
                found.setdefault(prefix + node.name, result if is_property else _parameters(node.args) + result)

    visit(ast.parse(STUB.read_text(encoding="utf-8")).body, "")
    return found


def _parameters(arguments: ast.arguments) -> str:
    every = [*arguments.posonlyargs, *arguments.args]
    if every and every[0].arg in ("self", "cls"):
        every[0].annotation = None
        (arguments.posonlyargs or arguments.args).pop(0)
    return f"({ast.unparse(arguments)})"


def described(name: str, thing: Any, signatures: dict[str, str]) -> Iterator[str]:
    """A public name of the library: what it is called with, its docstring, and its members."""
    kind = "class" if inspect.isclass(thing) else "module" if isinstance(thing, ModuleType) else "function"
    yield f"## {name} {{ #sgpr.{name} }}\n"
    if kind == "module":
        yield markdown(inspect.getdoc(thing) or "")
        for member in getattr(thing, "__all__", [key for key in vars(thing) if not key.startswith("_")]):
            value = getattr(thing, member)
            if callable(value) and value.__module__.startswith("sgpr"):
                yield from _member(f"{name}.{member}", value, _signature(value, ""))
        return
    own = signatures.get(name) or signatures.get(f"{name}.__new__") or signatures.get(f"{name}.__init__")
    yield f"```python\n{wrapped(name + (own or _signature(thing, '')))}\n```\n"
    yield markdown(inspect.getdoc(thing) or "")
    if kind == "class":
        for member, value in sorted(vars(thing).items()):
            if member.startswith("_"):
                continue
            value = inspect.unwrap(getattr(value, "__func__", value))
            text = signatures.get(f"{name}.{member}") or _signature(value, "")
            yield from _member(f"{name}.{member}", value, text)


def _member(name: str, thing: Any, signature: str) -> Iterator[str]:
    text = inspect.getdoc(thing) or ""
    if not text:
        return
    yield f"### {name.rpartition('.')[2]} {{ #sgpr.{name} }}\n"
    yield f"```python\n{wrapped(name.rpartition('.')[2] + signature)}\n```\n"
    yield markdown(text)


def _signature(thing: Any, otherwise: str) -> str:
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return otherwise
    parameters = [each for each in signature.parameters.values() if each.name != "self"]
    # Names of modules in types say nothing to a reader.
    return re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", str(signature.replace(parameters=parameters))).replace("'", "")


def wrapped(signature: str) -> str:
    """A signature; a long one has a line for each parameter."""
    if len(signature) <= LINE:
        return signature
    depth, lines, start = 0, [], signature.find("(") + 1
    for place, sign in enumerate(signature[start:], start):
        depth += (sign in "([{") - (sign in ")]}")
        if depth < 0 or (depth == 0 and sign == ","):
            lines.append(f"    {signature[start:place].strip()},")
            start = place + 1
        if depth < 0:
            break
    return "\n".join([signature[: signature.find("(") + 1], *lines, f"){signature[start:]}"])


def markdown(text: str) -> str:
    """A docstring: sections become bold lines, parameters lists, examples code."""
    lines = text.splitlines()
    result: list[str] = []
    in_list = in_code = False
    for index, line in enumerate(lines):
        below = lines[index + 1] if index + 1 < len(lines) else ""
        if re.fullmatch(r"-{3,}", line):
            continue
        if in_code and not line.strip():
            result.append("```")
            in_code = False
        elif not in_code and line.lstrip().startswith(">>>"):
            result += ["", "```python"]
            in_code = True
        if in_code:
            result.append(line)
        elif re.fullmatch(r"-{3,}", below):
            result += ["", f"**{line}**", ""]
            in_list = line in ("Parameters", "Returns", "Raises", "Attributes", "Yields")
        elif in_list and line and not line.startswith(" "):
            name, colon, kind = line.partition(" : ")
            result.append(f"- `{name}`" + (f": {kind}." if colon else ""))
        else:
            result.append(escaped(line.strip() if in_list and line else line, "  " if in_list and line else ""))
    if in_code:
        result.append("```")
    return "\n".join(result) + "\n"


def escaped(line: str, indent: str) -> str:
    """A line of prose; brackets of indices are no links."""
    parts = re.split(r"(`[^`]*`)", line)
    return indent + "".join(part if part.startswith("`") else part.replace("[", "\\[") for part in parts)
