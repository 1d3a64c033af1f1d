"""Who has no room for the copies that it is to hold (specs/20-copies.md, Full disks).

A holder that is being filled and has no room would hold up the change of its segment for as long as that lasts. So it is left out where it
is not complete, until its own word says that there is room again. Where it has everything it stays: else all copies would leave a full disk at once,
and come back as soon as that was no longer full.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from scenefold.base.cover import without
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.balance.policy import FILL_MAX
from scenefold.peer.balance.seams import fill_of
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.segment import Segment
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.placing_wishes import Piece
from scenefold.wire import Member
from scenefold.world import Clock

AGAIN_S_MIN, AGAIN_S_MAX = 30.0, 600.0
"""So long at least, twice as long each time: what a node says of its disk is coarse, and each try copies what there was room for."""
FORGOTTEN_S = 3 * AGAIN_S_MAX
"""Who has not refused for so long begins anew."""

Place = Callable[[Arc, Mapping[NodeId, Member]], list[Piece]]
"""What placement gives a piece of the arc if these may be taken."""


class _Refusal(NamedTuple):
    at: float
    pause_s: float


class FullHolders:
    """Used from the Trio thread only."""

    def __init__(self, clock: Clock, roster: Roster) -> None:
        self._clock = clock
        self._roster = roster
        self._refusals: dict[Member, _Refusal] = {}

    def note(self, holder: Member) -> None:
        """It has just refused a copy, as its disk is full."""
        before, now = self._refusals.get(holder), self._clock.now()
        if before is None or now > before.at + FORGOTTEN_S:
            pause_s = AGAIN_S_MIN
        elif now < before.at + before.pause_s:
            # Of what was on its way already.
            return
        else:
            pause_s = min(2 * before.pause_s, AGAIN_S_MAX)
        self._refusals[holder] = _Refusal(now, pause_s)

    def among(self, members: Iterable[Member]) -> frozenset[Member]:
        """Who of them had no room lately, and does not say that there is some now."""
        now = self._clock.now()
        full = {member for member, refusal in self._refusals.items() if self._is_full(member.node, refusal, now)}
        self._refusals = {member: one for member, one in self._refusals.items() if member in full or now <= one.at + FORGOTTEN_S}
        return frozenset(full.intersection(members))

    def says_room(self, node: NodeId) -> bool:
        """Whether there is some by its own word; who says nothing may have some."""
        status = self._roster.status(node)
        used, capacity = (0, 0) if status is None else fill_of(status)
        return used <= FILL_MAX * capacity

    def _is_full(self, node: NodeId, refusal: _Refusal, now: float) -> bool:
        return now - refusal.at < refusal.pause_s or not self.says_room(node)


def around_full(
    found: Configurations, layout: Layout, arc: Arc, allowed: Mapping[NodeId, Member], full: frozenset[Member], place: Place
) -> list[Piece]:
    """What placement gives if who is full is taken only where it has everything already. Pure but for `place`."""
    if not full:
        return place(arc, allowed)
    pieces: list[Piece] = []
    rest = [arc]
    for segment in found.segments:
        common = segment.arc.intersection(arc) if segment.layout == layout else None
        if common is not None:
            rest = [left for part in rest for left in without(part, common)]
            pieces += place(common, _without(allowed, full - _complete(segment, found.me)))
    for part in rest:
        pieces += place(part, _without(allowed, full))
    return sorted(pieces, key=lambda piece: piece[0].first)


def _complete(segment: Segment, me: Member) -> frozenset[Member]:
    active = segment.active(me)
    return segment.sound if active is None else segment.sound | frozenset(active.members)


def _without(allowed: Mapping[NodeId, Member], full: frozenset[Member]) -> Mapping[NodeId, Member]:
    return {node: member for node, member in allowed.items() if member not in full}
