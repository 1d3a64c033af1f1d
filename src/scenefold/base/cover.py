"""The line as cut by claims that may overlap and leave gaps: whom to ask for a place, in which order (specs/11-peers.md, Routing). Pure.

What nodes say of their arcs is never of one moment, so of two that claim a place one is out of date, and which one cannot be
told from the claims: pieces move both ways. So all claimants are kept. A place that nobody claims is on its way between
the two beside it, or its owner is gone.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar

from scenefold.base.location import FIRST, LAST, Arc, Location

T = TypeVar("T")


class Cover(Generic[T]):
    """The whole line, in stretches of equal claimants. Empty claims: nobody for any place."""

    def __init__(self, claims: Sequence[tuple[Arc, T]]) -> None:
        """`claims` in the order of preference; that of the line does for arcs that hardly overlap."""
        begins: dict[Location, list[int]] = {}
        ends: dict[Location, list[int]] = {}
        for index, (arc, _) in enumerate(claims):
            begins.setdefault(arc.first, []).append(index)
            following = arc.last.next()
            if following is not None:
                ends.setdefault(following, []).append(index)
        self._firsts: list[Location] = sorted({FIRST, *begins, *ends})
        held: list[list[int]] = []
        open_ones: list[int] = []
        for first in self._firsts:
            for index in ends.get(first, ()):
                open_ones.remove(index)
            for index in begins.get(first, ()):
                insort(open_ones, index)
            held.append(list(open_ones))
        self._gaps = [not found for found in held]
        self._held = [tuple(claims[index][1] for index in found or _beside(stretch, held)) for stretch, found in enumerate(held)]

    def at(self, location: Location) -> tuple[T, ...]:
        """The claimants of a place; where there is none, those beside the gap: right, then left."""
        return self._held[bisect_right(self._firsts, location) - 1]

    def is_gap(self, location: Location) -> bool:
        """Whether nobody claims a place."""
        return self._gaps[bisect_right(self._firsts, location) - 1]

    def stretches(self) -> Iterator[tuple[Arc, tuple[T, ...]]]:
        """The whole line in order, each stretch with whom to ask for it."""
        for index, held in enumerate(self._held):
            last = LAST if index + 1 == len(self._firsts) else Location.from_number(self._firsts[index + 1].number - 1)
            yield Arc(self._firsts[index], last), held


def _beside(gap: int, held: Sequence[Sequence[int]]) -> list[int]:
    """Who is next to a gap: the one on the right first, since an arc whose beginning is not known begins behind its left neighbour's."""
    right = held[gap + 1][:1] if gap + 1 < len(held) else []
    left = held[gap - 1][-1:] if gap else []
    return [*right, *left]


def runs(stretches: Sequence[tuple[Arc, T]]) -> list[tuple[Arc, T]]:
    """Adjacent stretches of the same one joined."""
    joined: list[tuple[Arc, T]] = []
    for arc, value in stretches:
        if joined and joined[-1][1] == value and joined[-1][0].last.next() == arc.first:
            joined[-1] = Arc(joined[-1][0].first, arc.last), value
        else:
            joined.append((arc, value))
    return joined


def without(arc: Arc, taken: Arc | None) -> list[Arc]:
    """What is left of an arc: up to two pieces."""
    inside = None if taken is None else arc.intersection(taken)
    if inside is None:
        return [arc]
    left = [] if inside.first == arc.first else [Arc(arc.first, Location.from_number(inside.first.number - 1))]
    return left if inside.last == arc.last else [*left, Arc(Location.from_number(inside.last.number + 1), arc.last)]
