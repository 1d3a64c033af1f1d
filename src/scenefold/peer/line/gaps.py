"""Parts of the line that nobody owns since their owners were removed, as far as is known here (specs/13-balance.md, Gaps).

What lies there is in nobody's fill, and nobody can be asked for it. So balance goes round such a part, and who joins beside it is
given only as much as makes it the one to adopt it; and copies that can wait are placed once it is somebody's. Nothing here carries safety: a gap is adopted by what the nodes say themselves (survey.py).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Protocol

from scenefold.base.cover import without
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.world import Clock

GAP_REST_S = 30.0
"""Within it a gap is adopted, usually: so long nothing is moved that its next owner would have moved again."""
GAP_S_MAX = 120.0
"""So long a part is waited for that nobody takes: who should adopt it may be dead as well."""


class News(Protocol):
    """What the other nodes said of their arcs (Roster)."""

    def arcs(self) -> Mapping[NodeId, Arc | None]: ...
    def former_arcs(self, now: float) -> Sequence[Arc]: ...


class Gaps:
    """Used from the Trio thread only. Asked once a second or so: a removal is known for T_wait."""

    def __init__(self, clock: Clock, news: News) -> None:
        self._clock = clock
        self._news = news
        self._known: dict[Arc, float] = {}
        """What removed members have claimed, as it was said, and since when it is known."""

    def former(self) -> Sequence[Arc]:
        """What was claimed last by those who were removed a short time ago."""
        now = self._clock.now()
        for arc in self._news.former_arcs(now):
            self._known.setdefault(arc, now)
        self._known = {arc: since for arc, since in self._known.items() if now - since < GAP_S_MAX}
        return tuple(self._known)

    def unowned(self, own: Arc | None, within_s: float = GAP_S_MAX) -> Sequence[Arc]:
        """What of that nobody claims now, if it is known for less than `within_s`; `own`: this node's arc."""
        now = self._clock.now()
        former = [arc for arc in self.former() if now - self._known[arc] < within_s]
        return unclaimed(former, [own, *self._news.arcs().values()]) if former else ()


def unclaimed(former: Iterable[Arc], claims: Iterable[Arc | None]) -> tuple[Arc, ...]:
    """What of these arcs is in none of the claims. Pure."""
    left = list(former)
    for claim in claims:
        if claim is not None:
            left = [rest for arc in left for rest in without(arc, claim)]
    return tuple(sorted(left, key=lambda arc: arc.first))


def beside(gaps: Collection[Arc], order: Sequence[NodeId], arcs: Mapping[NodeId, Arc | None]) -> frozenset[NodeId]:
    """Who stands at a gap: the owners on both sides of it, and whoever has no arc between them. Pure."""
    found: set[NodeId] = set()
    # The numbers from which on nobody was met, and who was met since.
    begin, met = FIRST.number, list[NodeId]()
    for node in order:
        arc = arcs.get(node)
        met.append(node)
        if arc is not None:
            if _is_in_gap(gaps, begin, arc.first.number - 1):
                found.update(met)
            begin, met = arc.last.number + 1, [node]
    if _is_in_gap(gaps, begin, LAST.number):
        found.update(met)
    return frozenset(found)


def _is_in_gap(gaps: Iterable[Arc], first: int, last: int) -> bool:
    return any(first <= gap.last.number and gap.first.number <= last for gap in gaps) if first <= last else False


def share_of(gap: Arc, waiting: int, former: Iterable[Arc]) -> Arc:
    """What of a gap on its left a node adopts itself if so many nodes without an arc stand there, who are to adopt the rest. Pure.

    Up to where one of the former owners ended or began, if that is known; else each gets as much of its length.
    """
    if not waiting or gap.length <= waiting:
        return gap
    first, last = gap.first.number, gap.last.number
    bounds = {number for arc in former for number in (arc.first.number, arc.last.number + 1)}
    inside = [number for number in bounds if first < number <= last]
    begin = max(inside, default=last + 1 - gap.length // (waiting + 1))
    return Arc(Location.from_number(begin), gap.last)
