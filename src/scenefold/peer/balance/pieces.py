"""Which piece of its arc a node gives: by bytes from one side, by half, up to a place (specs/13-balance.md, Pieces).

Bytes are those of records as the store counts them. A piece is an end of the arc; all of it only where the node leaves.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from scenefold.base.cover import without
from scenefold.base.location import Arc, Location
from scenefold.peer.line.ends import Side
from scenefold.store.statistics import Counts, StoreStatistics
from scenefold.store.walking import Weighed

PIECE_BYTES_MAX = 64 * 1024 * 1024
"""Of one handover. Small enough that the next node of a chain can pass on the first while we give the second, and that
not much is copied in vain for a newcomer that dies."""


class Scales(Protocol):
    """What is asked of the store."""

    async def weigh(self, arc: Arc, bytes_wanted: int, *, from_right: bool) -> Weighed: ...
    async def arc_totals(self, arc: Arc) -> Counts: ...
    async def statistics(self) -> StoreStatistics: ...


class Piece(NamedTuple):
    """An end of an arc, with what lies in it."""

    arc: Arc
    records: int
    bytes: int


async def piece_of(scales: Scales, arc: Arc, side: Side, size: int) -> Piece | None:
    """The end of the arc in which about `size` bytes lie, at least one record; None if that would be all of it, or nothing."""
    weighed = await scales.weigh(arc, size, from_right=side is Side.RIGHT)
    if weighed.records == 0:
        return None
    cut = _end_at(arc, side, weighed.location)
    return None if cut == arc else Piece(cut, weighed.records, weighed.bytes)


async def all_but_one(scales: Scales, arc: Arc, side: Side) -> Piece | None:
    """All of the arc but the location farthest from that side; None if that is nothing."""
    kept = one_at(arc, side.opposite)
    if kept is None:
        return None
    (cut,) = without(arc, kept)
    totals = await scales.arc_totals(cut)
    return Piece(cut, totals.records, totals.bytes)


def one_at(arc: Arc, side: Side) -> Arc | None:
    """The one location at that end; None if that would be all."""
    return None if arc.length == 1 else _end_at(arc, side, arc.last if side is Side.RIGHT else arc.first)


async def half_of(scales: Scales, arc: Arc, side: Side) -> Arc | None:
    """The end with half of what lies in the arc, or with a piece's worth if that is less.

    Half of its length if there is one record or none. None: it is one location.
    """
    if arc.length == 1:
        return None
    totals = await scales.arc_totals(arc)
    if totals.records > 1:
        piece = await piece_of(scales, arc, side, min(totals.bytes // 2, PIECE_BYTES_MAX))
        if piece is not None:
            return piece.arc
    middle = arc.first.number + arc.length // 2
    return _end_at(arc, side, Location.from_number(middle if side is Side.RIGHT else middle - 1))


def up_to(arc: Arc, side: Side, place: Location) -> Arc | None:
    """The end of the arc that reaches to a place inside, which is in it; None if that would be all, or not in the arc."""
    if place not in arc:
        return None
    cut = _end_at(arc, side, place)
    return None if cut == arc else cut


def _end_at(arc: Arc, side: Side, location: Location) -> Arc:
    return Arc(location, arc.last) if side is Side.RIGHT else Arc(arc.first, location)
