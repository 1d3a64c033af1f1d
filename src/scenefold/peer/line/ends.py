"""The ends of an arc: what touches them, what can be cut off and joined again (specs/12-line.md, Steps). Pure."""

from __future__ import annotations

from enum import StrEnum

from scenefold.base import cover
from scenefold.base.location import Arc


class Side(StrEnum):
    """Where on the line a neighbour stands."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def opposite(self) -> Side:
        return Side.RIGHT if self is Side.LEFT else Side.LEFT


def touches(piece: Arc, arc: Arc, side: Side) -> bool:
    """Whether the piece lies directly on that side of the arc, outside of it."""
    return piece.last.next() == arc.first if side is Side.LEFT else arc.last.next() == piece.first


def is_end_of(piece: Arc, arc: Arc, side: Side) -> bool:
    """Whether the piece is that end of the arc, or all of it."""
    inside = arc.first <= piece.first and piece.last <= arc.last
    return inside and (piece.first == arc.first if side is Side.LEFT else piece.last == arc.last)


def without(arc: Arc, piece: Arc, side: Side) -> Arc | None:
    """What is left of an arc that loses that end; None if nothing is."""
    assert is_end_of(piece, arc, side)
    return next(iter(cover.without(arc, piece)), None)


def joined(arc: Arc | None, piece: Arc) -> Arc:
    """The arc with a piece that touches it; the piece if there is no arc. A new object, always: Holding.arc."""
    return Arc(piece.first, piece.last) if arc is None else Arc(min(arc.first, piece.first), max(arc.last, piece.last))
