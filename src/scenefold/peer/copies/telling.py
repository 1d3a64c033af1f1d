"""What nodes tell each other about copies, as packets have it and as nodes keep it (specs/03-wire.md, 20-copies.md). Pure."""

from __future__ import annotations

from scenefold.base.location import Arc
from scenefold.peer.copies.copies import Passing
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.wire import ClaimRange, Confirmed, CustodyEntry, PassedSegment


def told_entry(entry: Entry) -> CustodyEntry:
    """Whether it is fenced is its holder's own affair."""
    return CustodyEntry(entry.layout, entry.arc.first, entry.arc.last, entry.number, entry.members, entry.needed, entry.whole)


def entry_of(told: CustodyEntry) -> Entry:
    return Entry(told.layout, Arc(told.first, told.last), told.number, told.members, told.needed, told.whole)


def claim_of(handover: bytes, piece: Arc, passing: Passing | None) -> ClaimRange:
    """`passing`: None if that was told already."""
    if passing is None:
        return ClaimRange(handover, piece.first, piece.last)
    return ClaimRange(handover, piece.first, piece.last, passing.number, tuple(map(_told_segment, passing.segments)))


def passing_of(claim: ClaimRange) -> Passing:
    """What a giver says with its claim, also if that is nothing: then nobody held copies there."""
    return Passing(claim.handover, claim.number, tuple(map(_segment_of, claim.segments)))


def _told_segment(segment: Segment) -> PassedSegment:
    confirmed = sorted(segment.confirmed, key=lambda found: (found[0].node, found[0].incarnation))
    return PassedSegment(
        segment.layout,
        segment.arc.first,
        segment.arc.last,
        segment.configurations,
        tuple(Confirmed(member, number) for member, number in confirmed),
    )


def _segment_of(told: PassedSegment) -> Segment:
    confirmed = frozenset((found.member, found.number) for found in told.confirmed)
    return Segment(told.layout, Arc(told.first, told.last), told.configurations, confirmed=confirmed)
