"""What speaks against logs and fit: at the top of a page what is to be looked at, at its end what is good to know."""

from collections.abc import Mapping, Sequence

from .markup import Html, Section, element, items, prose

Messages = Sequence[Mapping[str, str]]
"""Findings as in the JSON files: "rank", "where", "text"."""


def is_known(message: Mapping[str, str]) -> bool:
    """Whether it is right more often than a fault, or nobody can act on it."""
    return message["rank"] == "know"


def please_note(messages: Messages) -> list[Html]:
    """What is to be looked at; nothing if nothing is."""
    look = [one for one in messages if not is_known(one)]
    notes = [f"{one['where']}: {one['text']}" if one["where"] else one["text"] for one in look]
    return [element("h2", "Please note"), items(map(prose, notes))] if notes else []


def good_to_know(messages: Messages) -> list[Section]:
    """The rest, but for that of a log, which stands with it."""
    texts = [one["text"] for one in messages if is_known(one) and not one["where"]]
    return [Section("known", "Good to know", items(map(prose, texts)))] if texts else []
