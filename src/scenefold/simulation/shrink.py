"""The fewest faults that still fail (Zeller's ddmin, bounded in tries). Pure: it is told how to try.

A run of a shorter schedule draws everything else as before, because each stream of randomness has a name of its own; so
what a fault did not cause mostly stays as it was, and taking it out mostly changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, TypeVar

Item = TypeVar("Item")
"""Hashable."""

TRIES_MAX = 80


@dataclass(frozen=True, slots=True)
class Shortened(Generic[Item]):
    """`items` still fail. `is_minimal`: without any single one of them the run does not fail (as far as was tried)."""

    items: tuple[Item, ...]
    tries: int
    is_minimal: bool


def shorten(items: Sequence[Item], fails: Callable[[tuple[Item, ...]], bool], tries_max: int = TRIES_MAX) -> Shortened[Item]:
    """Take out what is not needed. `fails` of all items is taken for granted."""
    left, tries, parts = tuple(items), 0, 2
    passed: set[tuple[Item, ...]] = set()
    while left:
        for candidate in _candidates(left, parts):
            if candidate in passed:
                continue
            if tries >= tries_max:
                return Shortened(left, tries, is_minimal=False)
            tries += 1
            if fails(candidate):
                left, parts = candidate, max(2, min(parts - 1, len(candidate)))
                break
            passed.add(candidate)
        else:
            if parts >= len(left):
                break
            parts = min(len(left), parts * 2)
    return Shortened(left, tries, is_minimal=True)


def _candidates(items: tuple[Item, ...], parts: int) -> Iterator[tuple[Item, ...]]:
    """The items without one of `parts` equal parts; nothing at all first, because some bugs need no fault."""
    if parts == 2:
        yield ()
    bounds = [len(items) * part // parts for part in range(parts + 1)]
    for start, end in pairwise(bounds):
        if end > start and end - start < len(items):
            yield items[:start] + items[end:]
