"""HTML in small pieces. Text is escaped unless it is `Html` already."""

import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


class Html(str):
    """Text that is markup."""

    __slots__ = ()


@dataclass(frozen=True)
class Section:
    """A part of a page, with an entry in the table of contents."""

    name: str
    title: str
    body: Html


@dataclass(frozen=True)
class Cell:
    """A cell of a table that needs more than its text."""

    content: str
    style: str = ""
    order: float | None = None


def safe(text: object) -> Html:
    """Text as markup."""
    return text if isinstance(text, Html) else Html(html.escape(str(text)))


def join(parts: Iterable[object]) -> Html:
    """Pieces one after the other."""
    return Html("\n".join(safe(part) for part in parts))


def element(tag: str, content: object, **attributes: str) -> Html:
    """`<tag ...>content</tag>`; `class_` and `aria_label` become class and aria-label."""
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(value)}"' for name, value in attributes.items() if value
    )
    return Html(f"<{tag}{written}>{safe(content)}</{tag}>")


def paragraph(text: object, class_: str = "") -> Html:
    """A paragraph."""
    return element("p", text, class_=class_)


def prose(text: str) -> Html:
    """A sentence in which `names` are set as code."""
    return Html(re.sub(r"`([^`]*)`", r"<code>\1</code>", safe(text)))


def items(texts: Iterable[object]) -> Html:
    """A list."""
    return element("ul", join(element("li", text) for text in texts))


def table(
    caption: str,
    columns: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    text_columns: Sequence[int] = (0,),
    spare_columns: Sequence[int] = (),
) -> Html:
    """A table that scrolls sideways where it does not fit. The first column names the rows.

    - `spare_columns`: columns that a narrow screen does without
    """

    def kind(k: int, style: str = "") -> str:
        return " ".join(filter(None, ["text" * (k in text_columns), "spare" * (k in spare_columns), style]))

    head = join(element("th", column, scope="col", class_=kind(k)) for k, column in enumerate(columns))
    lines = []
    for row in rows:
        cells = []
        for k, value in enumerate(row):
            content, style, order = (
                (value.content, value.style, value.order) if isinstance(value, Cell) else (value, "", None)
            )
            tag, scope = ("th", "row") if k == 0 else ("td", "")
            number = "" if order is None else f"{order:.9g}"
            # In a box of its own, so that a path of any length leaves room for the figures.
            shown = element("span", content) if k == 0 and content else content
            cells.append(element(tag, shown, scope=scope, class_=kind(k, style), data_order=number))
        lines.append(element("tr", Html("".join(cells))))
    inner = join([element("caption", caption), element("thead", element("tr", head)), element("tbody", join(lines))])
    return element("div", element("table", inner), class_="wide", tabindex="0", role="region", aria_label=caption)


def plot(name: str, height: int, label: str, note: object = "") -> Html:
    """The place of a plot."""
    place = Html(
        f'<div class="plot" id="{html.escape(name)}" style="height:{height}px" role="figure" '
        f'aria-label="{html.escape(label)}"></div>'
    )
    return element("figure", join([place, element("figcaption", note)]) if note else place)


def choice(name: str, label: str, options: Sequence[str], *, keep: bool = False) -> Html:
    """A selection, hidden if there is nothing to select and it is not to be kept."""
    entries = join(element("option", text, value=str(k)) for k, text in enumerate(options))
    select = Html(f'<select id="{html.escape(name)}">{entries}</select>')
    return element("label", join([label, select]), class_="choice" if keep or len(options) > 1 else "choice single")


def legend(entries: Iterable[tuple[str, str, str]]) -> Html:
    """What the marks mean: (symbol, colour, meaning)."""
    marks = []
    for symbol, colour, text in entries:
        mark = element("span", symbol, aria_hidden="true", style=f"color:var(--{colour[1:]},{colour})")
        marks.append(element("span", Html(f"{mark} {safe(text)}"), class_="key"))
    return element("p", join(marks), class_="legend")
