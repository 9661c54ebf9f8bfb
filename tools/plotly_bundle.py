"""Makes the part of plotly.js that the pages use out of the whole of it, as the plotly package brings it.

    pip install tree-sitter tree-sitter-javascript
    python tools/plotly_bundle.py

plotly.js is one file of modules that call each other by name, and one list of the kinds of plots. What no wanted kind
reaches by name is left out; what stays is unchanged. The tests of the pages in a browser draw all kinds with it.
"""

import re
from pathlib import Path

import plotly
import tree_sitter_javascript
from plotly.offline import get_plotlyjs
from tree_sitter import Language, Node, Parser

KINDS = ("bar", "heatmap")
"""Kinds of plots beside `scatter`, which plotly.js always has."""

PLACE = Path(__file__).resolve().parents[1] / "crates/sgpr-py/python/sgpr/report/plotly.min.js"

NAMES = ("identifier", "shorthand_property_identifier")
LIST = re.compile(rb"\.register\(\[((?:[\w$]+\(\),?)+)\]\)")


def main() -> None:
    source = get_plotlyjs().encode()
    root = Parser(Language(tree_sitter_javascript.language())).parse(source).root_node
    body = largest_block(root)
    text = pruned(source, body)
    PLACE.write_bytes(text)
    print(f"plotly {plotly.__version__}: {len(source) / 1e6:.2f} MB to {len(text) / 1e6:.2f} MB in {PLACE}")


def largest_block(root: Node) -> Node:
    """The function that holds all modules."""
    found, waiting = root, [root]
    while waiting:
        node = waiting.pop()
        if node.type == "statement_block" and node.named_child_count > found.named_child_count:
            found = node
        if node.end_byte - node.start_byte > 1_000_000:
            waiting += node.children
    return found


def pruned(source: bytes, body: Node) -> bytes:
    """The source with the wanted kinds, and what they reach."""
    pieces = [piece for statement in body.named_children for piece in pieces_of(statement)]
    texts = {piece.id: source[piece.start_byte : piece.end_byte] for piece in pieces}
    owner: dict[bytes, list[Node]] = {}
    for piece in pieces:
        for name in declared(piece):
            owner.setdefault(name, []).append(piece)
    [entry] = [piece for piece in pieces if LIST.search(texts[piece.id])]
    listed = re.findall(rb"[\w$]+", LIST.search(texts[entry.id]).group(1))
    wanted = [name for name in listed if kind_of(name, owner, texts) in KINDS]
    assert len(wanted) == len(KINDS), "plotly.js is built in another way than this program knows"
    calls = b",".join(name + b"()" for name in wanted)
    texts[entry.id] = LIST.sub(lambda _: b".register([" + calls + b"])", texts[entry.id])
    kept: set[int] = set()
    waiting = [piece for piece in pieces if piece.type == "return_statement"]
    while waiting:
        piece = waiting.pop()
        if piece.id in kept:
            continue
        kept.add(piece.id)
        names = used(piece)
        if piece is entry:
            names -= set(listed) - set(wanted)
        waiting += [other for name in names for other in owner.get(name, [])]
    inner = b"".join(written(piece, texts) for piece in pieces if piece.id in kept)
    return source[: body.start_byte + 1] + inner + source[body.end_byte - 1 :]


def pieces_of(statement: Node) -> list[Node]:
    """A statement, or the variables that it declares one by one."""
    if statement.type == "variable_declaration":
        return [child for child in statement.named_children if child.type == "variable_declarator"]
    return [] if statement.type == "comment" else [statement]


def declared(piece: Node) -> list[bytes]:
    """The names that a piece gives a meaning; a call names first what it fills."""
    if piece.type == "expression_statement":
        first = piece.named_children[0].child_by_field_name("arguments").named_children[0]
        return [first.text]
    if piece.type == "return_statement":
        return []
    name = piece.child_by_field_name("name")
    return (
        [name.text]
        if name.type == "identifier"
        else sorted(used(name, ("shorthand_property_identifier_pattern", *NAMES)))
    )


def used(piece: Node, kinds: tuple[str, ...] = NAMES) -> set[bytes]:
    """Names in a piece, of whatever scope: too many is no harm."""
    found, waiting = set(), [piece]
    while waiting:
        node = waiting.pop()
        if node.type in kinds:
            found.add(node.text)
        waiting += node.children
    return found


def kind_of(name: bytes, owner: dict[bytes, list[Node]], texts: dict[int, bytes]) -> str | None:
    """The kind of plot that an entry of the list stands for, which is one call away."""
    text = texts[owner[name][0].id]
    inner = re.search(rb"exports=([\w$]+)\(\)", text)
    module = texts[owner[inner.group(1)][0].id] if inner else text
    found = re.search(rb'moduleType:"trace",name:"(\w+)"', module)
    return found.group(1).decode() if found else None


def written(piece: Node, texts: dict[int, bytes]) -> bytes:
    """A piece as a statement."""
    if piece.type == "variable_declarator":
        return b"var " + texts[piece.id] + b";"
    return texts[piece.id]


if __name__ == "__main__":
    main()
