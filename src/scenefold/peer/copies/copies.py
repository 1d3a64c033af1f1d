"""All that a node keeps about copies, as one value that follows its holding (specs/20-copies.md). Pure.

It changes in the same durable change as the arc: else, after a crash between the two, a node would own a piece and not know who may
still be answered for it. So it is told what the holding was and what it is now, and finds out itself what that means:

    released     who holds copies of the piece goes to its receiver, and is told with every ClaimRange until that has answered
    claimed      and comes with it
    taken back   the piece is unrecovered: its receiver may have owned it for a while
    adopted      likewise: what its dead owner has acknowledged others have to say
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from scenefold.base.cover import without
from scenefold.base.errors import Refused
from scenefold.base.limits import SEGMENT_CONFIGURATIONS_MAX, SEGMENT_CONFIRMED_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.holding import Handover, Holding, Step
from scenefold.wire import Member


@dataclass(frozen=True, slots=True)
class Passing:
    """What the receiver of a released piece has to know. Whoever gave it takes nothing there below `number` any more."""

    handover: bytes
    number: int
    segments: tuple[Segment, ...]


@dataclass(frozen=True)
class Copies:
    """Transitions answer the value after them, the same one if nothing changes."""

    configurations: Configurations
    custody: Custody = field(default_factory=Custody)
    passing: tuple[Passing, ...] = ()
    """At most one for each side of the arc."""
    unrecovered: tuple[Arc, ...] = ()
    """Parts of the arc, in order and apart."""
    formerly: tuple[Entry, ...] = ()
    """What was held there, complete, when it became this node's. Not kept over a start: it is of use for some seconds."""

    @classmethod
    def of(cls, me: Member) -> Copies:
        """Those of a new incarnation. What lies on its disk are strays."""
        return cls(Configurations(me))

    # ------------------------------------------------------------------------------------------------- questions

    def is_recovered(self, piece: Arc) -> bool:
        """Whether this node knows all that was acknowledged in a piece that it owns."""
        return all(gap.intersection(piece) is None for gap in self.unrecovered)

    def recovered_part(self, piece: Arc) -> tuple[Arc, bool]:
        """The part of a piece, from its first place on, that is recovered as a whole or is not; and which of both."""
        part = piece
        for gap in self.unrecovered:
            if part.first in gap:
                return Arc(part.first, min(part.last, gap.last)), False
            if part.first < gap.first <= part.last:
                part = Arc(part.first, Location.from_number(gap.first.number - 1))
        return part, True

    def answers(self, layout: Layout, location: Location) -> Entry | None:
        """The entry to answer a read with, as one who holds copies, or did: of what is not recovered nobody acknowledges anything newer."""
        entry = self.custody.answers(layout, location)
        return entry or next((found for found in self.formerly if found.layout == layout and location in found.arc), None)

    def passed(self, handover: bytes) -> Passing | None:
        """What ClaimRange tells; None if that was told, or never was anything."""
        return next((found for found in self.passing if found.handover == handover), None)

    # --------------------------------------------------------------------------------------------------- changes

    def follow(self, before: Holding, after: Holding, told: Passing | None = None) -> Copies:
        """As it is once the holding is `after`. `told`: what the giver of a piece that is claimed has said of it.

        Refused if the change must not be made: an unrecovered piece is not given away.
        """
        found = self
        gained = [] if after.arc is None else without(after.arc, before.arc)
        for handover in _turned(before, after, Step.OFFERED, Step.RELEASED):
            found = found._given(handover)
        for handover in _turned(before, after, Step.NOTED, Step.TAKEN):
            if told is not None and told.handover == handover.id:
                found = found._taken(handover.piece, told)
                gained = _apart(gained, handover.piece)
        # Whatever came in another way, or from a giver that said nothing, may have been anybody's.
        for gap in gained:
            found = found._lost_sight_of(gap)
        kept = tuple(passing for passing in found.passing if _is_released(after, passing.handover))
        return found if kept == found.passing else replace(found, passing=kept)

    def recover(self, gap: Arc, heard: Mapping[Member, Sequence[Entry]], number: int) -> Copies:
        """Everybody has said what lies there, and it is here. Refused unless all of the gap is unrecovered."""
        if not any(part.first <= gap.first and gap.last <= part.last for part in self.unrecovered):
            raise Refused(RejectReason.STALE_VERSION, "the piece is recovered already, or another node's")
        rest = tuple(left for part in self.unrecovered for left in without(part, gap))
        formerly = tuple(replace(entry, arc=left) for entry in self.formerly for left in without(entry.arc, gap))
        return replace(self, configurations=self.configurations.adopt(gap, heard, number), unrecovered=rest, formerly=formerly)

    # --------------------------------------------------------------------------------------------------- helpers

    def _given(self, handover: Handover) -> Copies:
        piece = handover.piece
        if not self.is_recovered(piece):
            raise Refused(RejectReason.NOT_READY, "what was acknowledged there is not known yet: the piece is being recovered")
        met = self.custody.highest(piece)
        own = self.configurations if self.configurations.number > met else replace(self.configurations, number=met)
        rest, number, segments = own.give(piece)
        if any(
            len(segment.configurations) > SEGMENT_CONFIGURATIONS_MAX or len(segment.confirmed) > SEGMENT_CONFIRMED_MAX
            for segment in segments
        ):
            raise Refused(RejectReason.BUSY, "too much of who holds copies there has not settled yet")
        told = Passing(handover.id, number, segments)
        return replace(self, configurations=rest, custody=self.custody.promise(piece, number), passing=(*self.passing, told))

    def _taken(self, piece: Arc, told: Passing) -> Copies:
        number = max(told.number, self.custody.highest(piece))
        return replace(self, configurations=self.configurations.take(number, told.segments), custody=self.custody.claim(piece))

    def _lost_sight_of(self, gap: Arc) -> Copies:
        joined: list[Arc] = []
        for part in sorted((*self.unrecovered, gap), key=lambda part: part.first):
            if joined and joined[-1].last.next() == part.first:
                joined[-1] = Arc(joined[-1].first, part.last)
            else:
                joined.append(part)
        held = (entry for entry in self.custody.within(gap) if entry.whole)
        return replace(self, custody=self.custody.claim(gap), unrecovered=tuple(joined), formerly=(*self.formerly, *held))


def _turned(before: Holding, after: Holding, from_step: Step, to_step: Step) -> list[Handover]:
    """Handovers that have made just this step."""
    was = {found.id: found.step for _, found in before.handovers}
    return [found for _, found in after.handovers if found.step is to_step and was.get(found.id) is from_step]


def _is_released(holding: Holding, handover: bytes) -> bool:
    found = holding.find(handover)
    return found is not None and found[1].step is Step.RELEASED


def _apart(pieces: Sequence[Arc], taken: Arc) -> list[Arc]:
    return [left for piece in pieces for left in without(piece, taken)]
