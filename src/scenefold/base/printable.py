"""Words of others, before they come to a terminal or into a log.

A terminal obeys whoever writes to it, and marks of direction (Unicode's bidirectional controls) make a line read otherwise than it is.
Python's `isprintable` is false for all of these: controls, marks of format and direction, separators of lines, halves of pairs.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

CHARACTERS_MAX = 400
_CUT = "…"
_IN_JSON = re.compile(r"[^\x20-\x7e\n]")


def printable(text: str, most: int = CHARACTERS_MAX) -> str:
    """The text on one line, of bounded length; what a terminal would act on instead of showing it is written out."""
    shown = _written_out(text[: most + 1])
    return shown if len(shown) <= most else shown[: most - len(_CUT)] + _CUT


def printable_lines(text: str) -> str:
    """Our own lines, as they are laid out, with words of others in them."""
    return "\n".join(map(_written_out, text.split("\n")))


def printable_json(document: Any, *, indent: int | None = None) -> str:
    """The document as JSON that says the same, and steers no terminal either. Numbers that JSON has none for are null."""
    try:
        shown = json.dumps(document, indent=indent, ensure_ascii=False, allow_nan=False)
    except ValueError:
        shown = json.dumps(_finite(document), indent=indent, ensure_ascii=False, allow_nan=False)
    return _IN_JSON.sub(_escaped, shown)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _written_out(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def _escaped(found: re.Match[str]) -> str:
    char = found[0]
    return char if char.isprintable() else json.dumps(char)[1:-1]
