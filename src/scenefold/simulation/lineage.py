"""Who durably owned each location, and how it came to the next owner (specs/17-simulation.md, Laws). Pure.

Fed with every durable change of a node's arc, in order, it says of each gain whether it was a *handover* (the one before
had durably let go, in favour of this node), a *founding* (nobody had it yet), an *adoption* (the one before was removed), or
that it is here *again* (let go in favour of a node that was removed). Anything else is a violation: two owners, or a place
that nobody was entitled to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum

from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location


class Way(Enum):
    """How a piece of the line came to a node."""

    FOUNDING = "founding"
    HANDOVER = "handover"
    ADOPTION = "adoption"
    AGAIN = "again"
    """The node itself had it before, and had let go of it: a piece that was taken back."""


@dataclass(frozen=True, slots=True)
class Holder:
    """A node of one incarnation, by slot."""

    slot: int
    incarnation: bytes


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of the line and whose it durably is (None: nobody's yet).

    `released`: that one has let go of it, in favour of `towards` (None: not known).
    """

    arc: Arc
    holder: Holder | None = None
    released: bool = False
    towards: Holder | None = None
    since_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Gain:
    """A piece that changed hands. `before`: the piece as it was."""

    arc: Arc
    way: Way
    holder: Holder
    before: Piece


Towards = Callable[[Arc], Holder | None]


def _nobody(_arc: Arc) -> None:
    return None


class Lineage:
    """The whole line, cut where owners change."""

    def __init__(self) -> None:
        self._pieces: list[Piece] = [Piece(WHOLE_LINE)]
        self._gone: set[Holder] = set()

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The whole line in order."""
        return tuple(self._pieces)

    def gone(self, holder: Holder) -> None:
        """The node was removed, or its disk is another now: it will never come back with this incarnation."""
        self._gone.add(holder)

    def is_gone(self, holder: Holder) -> bool:
        return holder in self._gone

    def holder_of(self, location: Location) -> Piece:
        return next(piece for piece in self._pieces if location in piece.arc)

    def changed(self, holder: Holder, arc: Arc | None, now_s: float, towards: Towards = _nobody) -> tuple[list[Gain], list[Gain]]:
        """A node's durable arc is this now; what it lost went `towards(arc)`. Its gains, and those it had no right to."""
        if holder in self._gone:
            # A removed incarnation may not know it yet; what it believes to own counts no more, and it has no lease.
            return [], []
        gains: list[Gain] = []
        pieces: list[Piece] = []
        for piece in self._pieces:
            inside = None if arc is None else piece.arc.intersection(arc)
            for rest in _without(piece.arc, inside):
                if piece.holder == holder and not piece.released:
                    pieces.append(replace(piece, arc=rest, released=True, towards=towards(rest)))
                else:
                    pieces.append(replace(piece, arc=rest))
            if inside is None:
                continue
            if piece.holder == holder and not piece.released:
                pieces.append(replace(piece, arc=inside))
                continue
            gains.append(Gain(inside, self._way(piece, holder), holder, replace(piece, arc=inside)))
            pieces.append(Piece(inside, holder, since_s=now_s))
        self._pieces = _joined(sorted(pieces, key=lambda piece: piece.arc.first))
        return gains, [gain for gain in gains if self._is_wrong(gain)]

    def _way(self, piece: Piece, holder: Holder) -> Way:
        if piece.holder is None:
            return Way.FOUNDING
        if piece.holder == holder:
            return Way.AGAIN
        if piece.holder in self._gone:
            return Way.ADOPTION
        return Way.HANDOVER

    def _is_wrong(self, gain: Gain) -> bool:
        before = gain.before
        if gain.way is Way.HANDOVER:
            return not before.released or before.towards not in (None, gain.holder)
        return gain.way is Way.AGAIN and before.towards not in (None, gain.holder) and before.towards not in self._gone


def _without(arc: Arc, inside: Arc | None) -> Iterator[Arc]:
    if inside is None:
        yield arc
        return
    if inside.first > arc.first:
        yield Arc(arc.first, Location.from_number(inside.first.number - 1))
    if inside.last < arc.last:
        yield Arc(Location.from_number(inside.last.number + 1), arc.last)


def _joined(pieces: list[Piece]) -> list[Piece]:
    joined: list[Piece] = []
    for piece in pieces:
        last = joined[-1] if joined else None
        if last is not None and replace(last, arc=piece.arc) == piece:
            joined[-1] = replace(last, arc=Arc(last.arc.first, piece.arc.last))
        else:
            joined.append(piece)
    return joined


def tiling_problems(arcs: list[tuple[str, Arc]]) -> list[str]:
    """What is wrong with arcs that should tile the line, in words; empty if nothing is."""
    problems = []
    expected: Location | None = FIRST
    for name, arc in sorted(arcs, key=lambda pair: (pair[1].first, pair[1].last)):
        if expected is None:
            problems.append(f"{name} owns {_span(arc)} behind the line's last owner")
        elif arc.first > expected:
            problems.append(f"nobody owns {_span(Arc(expected, Location.from_number(arc.first.number - 1)))}")
        elif arc.first < expected:
            problems.append(f"{name} owns {_span(arc)}, of which the part up to {expected.hex()[:8]} is another's")
        expected = arc.last.next() if expected is None or arc.last >= expected else expected
    if expected is not None:
        problems.append(f"nobody owns {_span(Arc(expected, LAST))}")
    return problems


def _span(arc: Arc) -> str:
    return f"{arc.first.hex()[:8]}… to {arc.last.hex()[:8]}…"
