"""What people may call clusters, users, scenes and spaces, and how that is told to them."""

from __future__ import annotations

import re

from scenefold.base.limits import SPACE_NAME_BYTES_MAX

NAME_CHARACTERS_MAX = 64
USER_NAME_CHARACTERS_MAX = 50
"""So a certificate's common name, which has 64, holds one for certain."""
SPACE_NAME_RULE = f"printable characters, 1 to {SPACE_NAME_BYTES_MAX} bytes of UTF-8, not all of them digits"

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


def name_rule(characters_max: int = NAME_CHARACTERS_MAX) -> str:
    """What `is_name` asks for."""
    return f"1 to {characters_max} letters, digits, '-', '_' or '.', not beginning with '-' or '.'"


def is_name(text: str, characters_max: int = NAME_CHARACTERS_MAX) -> bool:
    """Whether it can be a file name on every system."""
    return len(text) <= characters_max and _NAME.fullmatch(text) is not None


def is_space_name(text: str) -> bool:
    """Whether a space may be called so: digits alone are its number."""
    return 0 < len(text.encode("utf-8", "surrogatepass")) <= SPACE_NAME_BYTES_MAX and text.isprintable() and not text.isdecimal()
