"""How it stands with the copies of what a node owns, by what it knows (specs/20-copies.md, Health). Pure.

A copy counts if its node answers and is known to have all that is not owed to it. So what is said here is never better than it is; it may
be worse for a while, as long as nobody knows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scenefold.base.cover import without
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.prefixes import AddressPrefix, forbids
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import GONE, Segment
from scenefold.wire import Member

Pieces = tuple[tuple[Layout, Arc], ...]
"""In order of layouts and places, neighbours as one."""


class Lacking(NamedTuple):
    """There are so many copies fewer than the layout asks for, all along the arc."""

    layout: Layout
    arc: Arc
    missing: int


@dataclass(frozen=True, slots=True)
class Standing:
    """Of all segments of an arc. One that is in none of these has all its copies where they belong."""

    segments: int = 0
    lacking: tuple[Lacking, ...] = ()
    comparing: Pieces = ()
    """Inherited: as many as there should be are there, and this owner has not compared all of them yet."""
    moving: Pieces = ()
    """All copies are there, and placement gives other holders by now, who are being filled."""
    forbidden: Pieces = ()
    """A copy lies where the owner's blacklist forbids it."""
    forbidden_on: tuple[NodeId, ...] = ()

    @property
    def copies_missing_max(self) -> int:
        return max((one.missing for one in self.lacking), default=0)


def standing_of(
    copies: Copies,
    arc: Arc | None,
    layouts: Iterable[Layout],
    is_there: Callable[[Member], bool],
    blacklist: Sequence[AddressPrefix] = (),
) -> Standing:
    """`layouts`: those of the spaces that there are. What is not recovered is left out: nobody knows what was there.

    `is_there`: whether a node answers as this incarnation. Who has come back with an empty disk answers, and has no copy.
    """
    found, me = copies.configurations, copies.configurations.me
    wanted = {layout for layout in layouts if layout}
    lacking: list[Lacking] = []
    comparing: list[tuple[Layout, Arc]] = []
    moving: list[tuple[Layout, Arc]] = []
    forbidden: list[tuple[Layout, Arc]] = []
    forbidden_on: set[NodeId] = set()
    for segment in found.segments:
        piece = segment.layout, segment.arc
        if segment.layout in wanted:
            missing, is_inherited = _missing(segment, me, is_there)
            if missing:
                lacking.append(Lacking(*piece, missing))
            elif is_inherited:
                comparing.append(piece)
            elif _moves(segment, me):
                moving.append(piece)
        nodes = {member.node for member in segment.holders(me) if forbids(blacklist, member.node, owner=me.node)}
        if nodes:
            forbidden.append(piece)
            forbidden_on |= nodes
    for layout in sorted(wanted):
        rest = [] if arc is None else [arc]
        for taken in (*copies.unrecovered, *(segment.arc for segment in found.segments if segment.layout == layout)):
            rest = [left for part in rest for left in without(part, taken)]
        lacking += [Lacking(layout, left, len(layout)) for left in rest]
    return Standing(
        len(found.segments), _alike(lacking), _joined(comparing), _joined(moving), _joined(forbidden), tuple(sorted(forbidden_on))
    )


def _missing(segment: Segment, me: Member, is_there: Callable[[Member], bool]) -> tuple[int, bool]:
    """How many copies are missing, and whether that counts some of which only an earlier owner knew that they are complete."""
    complete = set(segment.sound & set(segment.holders(me)))
    active = segment.active(me)
    if active is not None:
        complete |= set(active.members)
    told = set() if active is not None or segment.newest is None else set(segment.newest.members)
    there, by_word = ({member for member in members if _counts(segment, member, me, is_there)} for members in (complete, complete | told))
    shadows = len(segment.layout)
    return max(0, shadows - len(by_word)), len(there) < min(shadows, len(by_word))


def _counts(segment: Segment, member: Member, me: Member, is_there: Callable[[Member], bool]) -> bool:
    return member.node != me.node and segment.bound_of(member) != GONE and is_there(member)


def _moves(segment: Segment, me: Member) -> bool:
    active, change = segment.active(me), segment.change
    return active is not None and change is not None and set(change.holders) != set(active.members[1:])


def _alike(pieces: Iterable[Lacking]) -> tuple[Lacking, ...]:
    found: list[Lacking] = []
    for piece in sorted(pieces, key=lambda piece: (piece.layout, piece.arc.first)):
        last = found[-1] if found else None
        if last is not None and (last.layout, last.missing) == (piece.layout, piece.missing) and last.arc.last.next() == piece.arc.first:
            found[-1] = last._replace(arc=Arc(last.arc.first, piece.arc.last))
        else:
            found.append(piece)
    return tuple(found)


def _joined(pieces: Iterable[tuple[Layout, Arc]]) -> Pieces:
    return tuple((layout, arc) for layout, arc, _ in _alike(Lacking(layout, arc, 0) for layout, arc in pieces))


def by_layout(pieces: Iterable[tuple[Layout, Arc]]) -> Mapping[Layout, list[Arc]]:
    """The arcs of each layout, in order and apart."""
    found: dict[Layout, list[Arc]] = {}
    for layout, arc in _joined(pieces):
        found.setdefault(layout, []).append(arc)
    return found
