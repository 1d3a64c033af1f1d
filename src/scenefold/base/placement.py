"""Which nodes hold the copies of a piece of the line (thesis Algorithm 7; specs/20-copies.md, Placement). Pure.

What nodes say of their arcs is never of one moment: a place may have nobody, or several. Both count as they were said. A place
in two arcs is in both, at distance 0; one in none is as far from the arcs beside it as it lies from their ends. Nodes without
an arc take part only where those that have one are too few for a write to count. So whoever believes the same line gets the same
holders, and a line that is a little wrong gives a little too early or too late what the right one will give.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass

from scenefold.base.cover import runs
from scenefold.base.ids import NodeId
from scenefold.base.location import LINE_LENGTH, Arc, Location

Layout = tuple[Location, ...]
"""The offsets of a space's shadows, in the order of their numbers."""
Holders = tuple[NodeId, ...]
"""One for each shadow, in their order; fewer where there are no more nodes."""


class Line:
    """The arcs of all nodes as stretches with equal claimants, in numbers: made once for each view of the line."""

    def __init__(self, claims: Iterable[tuple[NodeId, Arc | None]]) -> None:
        """One node may have several claims. None: it has no arc."""
        begins: dict[int, list[NodeId]] = {}
        ends: dict[int, list[NodeId]] = {}
        nodes: set[NodeId] = set()
        for node, arc in claims:
            nodes.add(node)
            if arc is not None:
                begins.setdefault(arc.first.number, []).append(node)
                ends.setdefault(arc.last.number + 1, []).append(node)
        self.firsts = sorted({0, *begins, *ends} - {LINE_LENGTH})
        self.claimants: list[tuple[NodeId, ...]] = []
        """Of each stretch, the lowest id first; none in a gap."""
        self.waiting = tuple(sorted(nodes.difference(*begins.values())))
        """Who has no arc (yet), the lowest id first."""
        present: list[NodeId] = []
        for first in self.firsts:
            for node in ends.get(first, ()):
                present.remove(node)
            for node in begins.get(first, ()):
                insort(present, node)
            self.claimants.append(tuple(present))

    def stretch_at(self, place: int) -> int:
        return bisect_right(self.firsts, place) - 1

    def last_of(self, stretch: int) -> int:
        return (self.firsts[stretch + 1] if stretch + 1 < len(self.firsts) else LINE_LENGTH) - 1


@dataclass(frozen=True, slots=True)
class _Neighbour:
    """Who is met first when one walks off from a place; `end` may lie beyond the line's ends, as the line is a circle here."""

    node: NodeId
    end: int


def segments(
    line: Line, owner: NodeId, forbidden: Container[NodeId], layout: Layout, piece: Arc, least: int = 0
) -> list[tuple[Arc, Holders]]:
    """The piece, cut where the holders change. The cost is that of the cuts: a walk from each, past whom may not be taken.

    `least`: so many holders, the owner not among them, a write asks for.
    """
    offsets = [offset.number for offset in layout]
    found: list[tuple[Arc, Holders]] = []
    place, last = piece.first.number, piece.last.number
    while place <= last:
        holders, until = _holders(line, owner, forbidden, offsets, place, least)
        until = min(until, last)
        found.append((Arc(Location.from_number(place), Location.from_number(until)), holders))
        place = until + 1
    return runs(found)


def holders_at(line: Line, owner: NodeId, forbidden: Container[NodeId], layout: Layout, location: Location, least: int = 0) -> Holders:
    """The holders of one place that `owner` owns."""
    return _holders(line, owner, forbidden, [offset.number for offset in layout], location.number, least)[0]


def _holders(line: Line, owner: NodeId, forbidden: Container[NodeId], offsets: list[int], place: int, least: int) -> tuple[Holders, int]:
    """The holders of a place, and up to where they are certainly the same."""
    taken: list[NodeId] = []
    until = LINE_LENGTH - 1
    for offset in offsets:
        copy = (place + offset) % LINE_LENGTH
        found = _nearest(line, lambda node: node != owner and node not in taken and node not in forbidden, copy)
        if found is None:
            break
        taken.append(found[0])
        until = min(until, place + found[1] - copy)
    # How many have an arc is the same at every place, and so is who comes instead.
    missing = min(least, len(offsets)) - len(taken)
    if missing > 0:
        taken += [node for node in line.waiting if node != owner and node not in forbidden][:missing]
    return tuple(taken), until


def _nearest(line: Line, is_allowed: Callable[[NodeId], bool], place: int) -> tuple[NodeId, int] | None:
    """The allowed node whose arc is nearest, and up to where (the line's end at most) it stays so; None if none is allowed."""
    stretch = line.stretch_at(place)
    inside = next(filter(is_allowed, line.claimants[stretch]), None)
    if inside is not None:
        return inside, line.last_of(stretch)
    right = _met(line, is_allowed, stretch, step=1)
    if right is None:
        return None
    left = _met(line, is_allowed, stretch, step=-1)
    assert left is not None
    # Between the two, the left one is nearest up to the middle, which is its own if its id is the lower one.
    distance = right.end - left.end
    turn = left.end + distance // 2 - (distance % 2 == 0 and right.node < left.node)
    if place <= turn:
        return left.node, min(turn if left.node != right.node else right.end - 1, LINE_LENGTH - 1)
    return right.node, min(right.end - 1, LINE_LENGTH - 1)


def _met(line: Line, is_allowed: Callable[[NodeId], bool], stretch: int, *, step: int) -> _Neighbour | None:
    """The first allowed node behind a stretch that has none, and where its arc begins as seen from there."""
    count = len(line.firsts)
    for away in range(1, count + 1):
        around, index = divmod(stretch + step * away, count)
        node = next(filter(is_allowed, line.claimants[index]), None)
        if node is not None:
            return _Neighbour(node, around * LINE_LENGTH + (line.firsts[index] if step > 0 else line.last_of(index)))
    return None
