"""A whole page: one file with its style, its plots and the program that draws them."""

import json
from collections.abc import Sequence
from importlib import resources
from typing import Any

from .markup import Html, Section, element, join, safe

# Nothing is loaded from anywhere: the browser is told so, too.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def page(title: str, lead: object, sections: Sequence[Section], payload: dict[str, Any]) -> str:
    """The file.

    - `payload`: `figures` (plots by the name of their place), `switches` (plots with a selection), `torque`,
      `residual`
    """
    contents = element(
        "nav",
        join(
            [
                element("h2", "Contents"),
                element("ol", join(element("li", element("a", s.title, href=f"#{s.name}")) for s in sections)),
            ]
        ),
        aria_label="Contents",
    )
    parts = [
        element("section", join([element("h2", s.title), s.body]), id=s.name, aria_label=s.title) for s in sections
    ]
    without_script = element("noscript", element("p", "The plots need JavaScript; the tables do not."))
    body = join([element("header", join([element("h1", title), lead])), contents, without_script, *parts])
    return "".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n',
            f"<title>{safe(title)}</title>\n<style>\n{_resource('page.css')}</style>\n</head>\n<body>\n<main>\n",
            body,
            "\n</main>\n",
            f'<script type="application/json" id="payload">{_data(payload)}</script>\n',
            f"<script>{plotly_source()}</script>\n",
            *(f"<script>\n{_resource(name)}</script>\n" for name in ("torque.js", "residual.js", "page.js")),
            "</body>\n</html>\n",
        ]
    )


def _data(payload: dict[str, Any]) -> str:
    text = json.dumps(payload, sort_keys=True, separators=(",", ":"), allow_nan=False)
    # Nothing in a string may end the script.
    return text.replace("<", "\\u003c")


def _resource(name: str) -> Html:
    return Html(resources.files(__package__).joinpath(name).read_text(encoding="utf-8"))


def plotly_source() -> str:
    """The part of plotly.js that pages use, see tools/plotly_bundle.py."""
    return str(_resource("plotly.min.js"))
