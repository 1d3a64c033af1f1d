"""What a node owns of the line and what is on its way, as a value (specs/12-line.md, Holding and Steps). Pure.

A node changes its holding durably, one change at a time, and every packet that tells of a change leaves after it. So this
value is all that a restarted node needs in order to go on. Each transition answers the holding after it, the same one
if that has happened already, or Refused with the reason why it must not happen.

    giver      -  offer->  OFFERED  release->  RELEASED  confirm->  GIVEN  finish->  -        OFFERED  withdraw->  -
    receiver   -  note->   NOTED    claim->    TAKEN     drop->     -                         NOTED    drop->      -

    if the log removed the peer:
    giver      RELEASED  take_back->  -                        OFFERED, GIVEN  drop_removed->  -
    receiver                                                   NOTED, TAKEN    drop_removed->  -

Up to GIVEN the giver may yet take the piece back. So what is TAKEN goes to nobody else: the giver may not know of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from scenefold.base.errors import Refused
from scenefold.base.ids import address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.ends import Side, is_end_of, joined, touches, without
from scenefold.wire import Member

_NUMBER_BYTES = 8
HANDOVER_BYTES = 16


class Step(StrEnum):
    """How far a handover is: the first three at its giver, the others at its receiver."""

    OFFERED = "offered"
    RELEASED = "released"
    GIVEN = "given"
    NOTED = "noted"
    TAKEN = "taken"


GIVING = frozenset((Step.OFFERED, Step.RELEASED, Step.GIVEN))
OPEN = frozenset((Step.OFFERED, Step.RELEASED, Step.NOTED))
"""The bound between giver and receiver is not where it will be."""


@dataclass(frozen=True, slots=True)
class Handover:
    """A piece of the line between this node and the neighbour `peer`."""

    id: bytes
    step: Step
    peer: Member
    piece: Arc

    @property
    def gives(self) -> bool:
        return self.step in GIVING

    @property
    def is_open(self) -> bool:
        return self.step in OPEN


@dataclass(frozen=True, slots=True)
class Heard:
    """The highest number of a handover that a giver has offered here: what comes later with a lower one is late."""

    giver: Member
    number: int


def handover_id(number: int, salt: bytes) -> bytes:
    """The id of a giver's handover: `number` is the revision that offering makes, `salt` 8 random bytes."""
    return number.to_bytes(_NUMBER_BYTES, "big") + salt


def number_of(handover: bytes) -> int:
    return int.from_bytes(handover[:_NUMBER_BYTES], "big")


def behind_left_fence(arc: Arc, location: Location) -> bool:
    """Whether a place is not left of the arc's fence. Whose right bound lies where is not asked: that may be old news."""
    return location >= arc.first


@dataclass(frozen=True, slots=True)
class Holding:
    """The arc, at most one handover on either side, and what keeps late packets out."""

    arc: Arc | None = None
    """The same object as long as nothing of it is given or taken; what went and came back is equal, and another one."""
    left: Handover | None = None
    right: Handover | None = None
    revision: int = 0
    heard: tuple[Heard, ...] = ()

    # ------------------------------------------------------------------------------------------------- questions

    def on(self, side: Side) -> Handover | None:
        return self.left if side is Side.LEFT else self.right

    def find(self, handover: bytes) -> tuple[Side, Handover] | None:
        """The handover with this id and the side that it is on."""
        return next(((side, found) for side, found in self.handovers if found.id == handover), None)

    def owns(self, location: Location) -> bool:
        return self.arc is not None and behind_left_fence(self.arc, location) and location <= self.arc.last

    def is_open(self, side: Side) -> bool:
        """Whether a bound on that side is on its way; an empty node has no sides."""
        return any(found is not None and found.is_open for found in ((self.left, self.right) if self.arc is None else (self.on(side),)))

    def may_be_taken_back(self, piece: Arc) -> bool:
        """Whether something in it came by a handover that its giver may not have as given yet: it must stay here."""
        return any(found.step is Step.TAKEN and found.piece.intersection(piece) is not None for _, found in self.handovers)

    @property
    def handovers(self) -> list[tuple[Side, Handover]]:
        return [(side, found) for side in Side if (found := self.on(side)) is not None]

    @property
    def kept(self) -> list[Arc]:
        """Where records lie by right: in the arc, and in what is on its way. All others are strays."""
        return [*(found.piece for _, found in self.handovers), *([] if self.arc is None else [self.arc])]

    # ---------------------------------------------------------------------------------------------------- giving

    def offer(self, handover: bytes, side: Side, peer: Member, piece: Arc) -> Holding:
        """Begin to give an end of the arc, or all of it, to the neighbour on that side."""
        if self.on(side) is not None:
            raise _busy(f"a handover with the {side} neighbour is under way")
        if self.arc is None or not is_end_of(piece, self.arc, side):
            raise Refused(RejectReason.OUTSIDE_BOUNDS, f"the piece is not the {side} end of this node's arc")
        other = self.on(side.opposite)
        if other is not None and other.step is Step.OFFERED and other.piece.intersection(piece) is not None:
            raise _busy("a part of the piece is being given to the other neighbour")
        if self.may_be_taken_back(piece):
            raise _busy("a part of the piece was taken from a neighbour that has not said yet that it knows")
        if number_of(handover) != self.revision + 1:
            raise Refused(RejectReason.STALE_VERSION, "the holding has changed since the handover got its number")
        return self._with(side, Handover(handover, Step.OFFERED, peer, piece))

    def withdraw(self, handover: bytes) -> Holding:
        """Keep what was offered. Nothing to do for an id that is not known; refused if it was released."""
        found = self.find(handover)
        if found is None:
            return self
        side, known = found
        if known.step is not Step.OFFERED:
            raise _busy(f"the handover is {known.step} already")
        return self._with(side, None)

    def release(self, handover: bytes) -> Holding:
        """Let the piece go: from here on it is not ours."""
        side, known = self._given(handover)
        if known.step is not Step.OFFERED:
            return self
        assert self.arc is not None
        rest = without(self.arc, known.piece, side)
        return replace(self._with(side, replace(known, step=Step.RELEASED)), arc=rest)

    def confirm(self, handover: bytes, is_removed: Callable[[Member], bool]) -> Holding:
        """The receiver owns it durably: what lies in the piece may be deleted. Too late once the log has removed it."""
        side, known = self._given(handover)
        if known.step is Step.OFFERED:
            raise Refused(RejectReason.ILL_FORMED, "a piece that was not released cannot be the receiver's")
        if known.step is Step.RELEASED and is_removed(known.peer):
            raise Refused(RejectReason.WRONG_INCARNATION, "the receiver was removed from the cluster")
        return self if known.step is Step.GIVEN else self._with(side, replace(known, step=Step.GIVEN))

    def finish(self, handover: bytes) -> Holding:
        """Everything is deleted here and the receiver has forgotten the handover."""
        found = self.find(handover)
        if found is None:
            return self
        side, known = found
        if known.step is not Step.GIVEN:
            raise _busy(f"the handover is {known.step}, not given")
        return self._with(side, None)

    # ------------------------------------------------------------------------------------------------- receiving

    def note(self, handover: bytes, side: Side, giver: Member, piece: Arc) -> Holding:
        """Be ready to take a piece from the neighbour on that side."""
        known = self.on(side)
        if known is not None and known.id == handover and known.peer == giver and known.piece == piece:
            return self
        if number_of(handover) <= self._heard_from(giver):
            raise Refused(RejectReason.STALE_VERSION, "this offer is older than one that was taken")
        if known is not None and (known.gives or known.peer != giver):
            raise _busy(f"a handover with the {side} neighbour is under way")
        # A giver has one handover a side, so by a new one it says that it has ended the one before.
        if not self._fits(piece, side):
            raise Refused(RejectReason.OUTSIDE_BOUNDS, f"the piece does not touch this node's arc on the {side}")
        heard = (*(other for other in self.heard if other.giver != giver), Heard(giver, number_of(handover)))
        return replace(self._with(side, Handover(handover, Step.NOTED, giver, piece)), heard=heard)

    def _fits(self, piece: Arc, side: Side) -> bool:
        """Whether the piece can be claimed, whatever ends in between."""
        if self.arc is not None:
            return touches(piece, self.arc, side)
        other = self.on(side.opposite)
        return other is None or other.step not in (Step.NOTED, Step.RELEASED) or touches(piece, other.piece, side)

    def claim(self, handover: bytes, piece: Arc) -> Holding:
        """Own a noted piece, which its giver has released."""
        found = self.find(handover)
        if found is None or found[1].gives or found[1].piece != piece:
            raise Refused(RejectReason.ILL_FORMED, "no such handover is noted here")
        side, known = found
        if known.step is Step.TAKEN:
            return self
        if self.arc is not None and not touches(piece, self.arc, side):
            raise Refused(RejectReason.OUTSIDE_BOUNDS, f"the piece does not touch this node's arc on the {side}")
        return replace(self._with(side, replace(known, step=Step.TAKEN)), arc=joined(self.arc, piece))

    def drop(self, handover: bytes) -> Holding:
        """Forget a noted or taken handover: its giver has ended it. Nothing to do for an id that is not known."""
        found = self.find(handover)
        if found is None:
            return self
        side, known = found
        if known.gives:
            raise _busy("this node gives in that handover")
        return self._with(side, None)

    # ------------------------------------------------------------------------------------------- without the peer

    def drop_removed(self, is_removed: Callable[[Member], bool]) -> Holding:
        """Forget handovers with incarnations that the log has removed, but for what can be taken back; their records become strays."""
        heard = tuple(other for other in self.heard if not is_removed(other.giver))
        ended = [side for side, found in self.handovers if found.step is not Step.RELEASED and is_removed(found.peer)]
        if not ended and heard == self.heard:
            return self
        left, right = (None if side in ended else self.on(side) for side in Side)
        return replace(self, left=left, right=right, heard=heard, revision=self.revision + 1)

    def take_back(self, handover: bytes, is_removed: Callable[[Member], bool]) -> Holding:
        """Own a released piece again, since the log has removed its receiver, whose leases must be over."""
        found = self.find(handover)
        if found is None:
            return self
        side, known = found
        if known.step is not Step.RELEASED or not is_removed(known.peer):
            raise _busy(f"the handover is {known.step}, and its receiver may go on with it")
        if self.arc is not None and not touches(known.piece, self.arc, side):
            raise Refused(RejectReason.OUTSIDE_BOUNDS, f"the piece does not touch this node's arc on the {side}")
        return replace(self._with(side, None), arc=joined(self.arc, known.piece))

    def adopt(self, gap: Arc, *, revision: int) -> Holding:
        """Own a gap beside the arc, or the whole line for a node without one, as surveyed at this revision."""
        if revision != self.revision:
            raise Refused(RejectReason.STALE_VERSION, "the holding has changed since the gap was surveyed")
        sides = tuple(Side) if self.arc is None else tuple(side for side in Side if touches(gap, self.arc, side))
        if not sides:
            raise Refused(RejectReason.OUTSIDE_BOUNDS, "the gap does not touch this node's arc")
        for side in sides:
            known = self.on(side)
            if known is not None and (known.is_open or (known.gives and known.piece.intersection(gap) is not None)):
                raise _busy(f"a handover with the {side} neighbour is under way")
        return replace(self, arc=joined(self.arc, gap), revision=self.revision + 1)

    def found(self, arc: Arc) -> Holding:
        """Take a founding arc: the first change of a founder's first holding."""
        if self != Holding():
            raise Refused(RejectReason.STALE_VERSION, "a founding arc is taken once")
        return replace(self, arc=arc, revision=1)

    # -------------------------------------------------------------------------------------------------- helpers

    def _given(self, handover: bytes) -> tuple[Side, Handover]:
        found = self.find(handover)
        if found is None or not found[1].gives:
            raise Refused(RejectReason.ILL_FORMED, "this node gives nothing under that id")
        return found

    def _heard_from(self, giver: Member) -> int:
        return next((other.number for other in self.heard if other.giver == giver), 0)

    def _with(self, side: Side, handover: Handover | None) -> Holding:
        if side is Side.LEFT:
            return replace(self, left=handover, revision=self.revision + 1)
        return replace(self, right=handover, revision=self.revision + 1)


def _busy(what: str) -> Refused:
    return Refused(RejectReason.BUSY, what)


def describe(handover: Handover) -> str:
    """One line for logs and people."""
    direction = "to" if handover.gives else "from"
    return f"handover {handover.id.hex()[:16]} {direction} {address_of(handover.peer.node)}, {handover.step}"
