"""Words of others, before they come to a terminal or into a log."""

from __future__ import annotations

CHARACTERS_MAX = 400


def printable(text: str) -> str:
    """The text, of bounded length, with a question mark for each character that a terminal would act on instead of showing it."""
    return "".join(char if char.isprintable() else "?" for char in text[:CHARACTERS_MAX])
