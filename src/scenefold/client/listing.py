"""Several things in one sentence. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

NAMED_MAX = 4


def some_text(names: Iterable[str]) -> str:
    """The first four, and how many others there are."""
    listed = list(names)
    return ", ".join(listed[:NAMED_MAX]) + (f" and {len(listed) - NAMED_MAX} others" if len(listed) > NAMED_MAX else "")


def and_text(names: Sequence[str]) -> str:
    return _joined(names, "and")


def or_text(names: Sequence[str]) -> str:
    return _joined(names, "or")


def _joined(names: Sequence[str], word: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"
