"""What readers tell an owner of its holders: it compares those few places (specs/20-copies.md, Repair, What readers meet).

A reader may be wrong, as what it read was being written, or lie. So nothing is believed: what is told says where to look, and there are
bounds on how often.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.limits import COMPARED_ARCS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.crypto import wanted_place
from scenefold.peer.handlers import Handlers
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.comparing_progress import Progress
from scenefold.peer.replication.comparing_space import Merge, SpaceComparison
from scenefold.wire import CopiesLookedAt, LookAtCopies, Member

QUEUE_MAX = 1_024
PLACE_S = 0.02
"""For each place that was looked at: fifty a second, whoever tells what."""
AGAIN_S = 60.0
"""What was looked at so lately is not looked at once more."""
REMEMBERED_MAX = 4_096

_log = logging.getLogger("scenefold.peer.replication")


class _Place(NamedTuple):
    node: NodeId
    scene: SceneId
    space: SpaceId
    home: Location


class Looking:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster, merge: Merge) -> None:
        """`merge`: into this node's own arc."""
        self._parts = parts
        self._roster = roster
        self._merge = merge
        self._waiting: OrderedDict[_Place, Layout] = OrderedDict()
        self._looked_at: OrderedDict[_Place, float] = OrderedDict()
        self._wake = trio.Event()

    def register(self, handlers: Handlers) -> None:
        handlers.add(LookAtCopies, self._on_told)

    async def _on_told(self, packet: LookAtCopies, _peer: str) -> CopiesLookedAt:
        known = await self._parts.scenes.known(packet.scene, ask=False)
        now, taken = self._parts.world.clock.now(), 0
        for key in packet.keys:
            home = wanted_place(key.object) if key.object else key.location
            place, layout = _Place(packet.holder, packet.scene, key.space, home), known.layouts.get(key.space)
            is_new = now - self._looked_at.get(place, -AGAIN_S) >= AGAIN_S and place not in self._waiting
            if layout and is_new and len(self._waiting) < QUEUE_MAX and self._holder(place, layout) is not None:
                self._waiting[place] = layout
                taken += 1
        if taken:
            self._wake.set()
        return CopiesLookedAt(taken)

    async def run(self) -> None:
        """Look until cancelled."""
        while True:
            await self._wake.wait()
            self._wake = trio.Event()
            while self._waiting:
                places, layout = self._next()
                await self._look(places, layout)
                await self._parts.world.clock.sleep(PLACE_S * len(places))

    def _next(self) -> tuple[list[_Place], Layout]:
        """Those of the first one's node and space, as many as one comparison takes."""
        first, layout = next(iter(self._waiting.items()))
        places = [place for place in self._waiting if place[:3] == first[:3]][:COMPARED_ARCS_MAX]
        now = self._parts.world.clock.now()
        for place in places:
            del self._waiting[place]
            self._looked_at[place] = now
            self._looked_at.move_to_end(place)
        while len(self._looked_at) > REMEMBERED_MAX:
            self._looked_at.popitem(last=False)
        return places, layout

    async def _look(self, places: Sequence[_Place], layout: Layout) -> None:
        """Compare these places. What cannot be compared now is met again, or waits for the next round of all."""
        holders = {place.home: self._holder(place, layout) for place in places}
        _, scene, space, _ = places[0]
        for holder in {found for found in holders.values() if found is not None}:
            arcs = [Arc(home, home) for home in sorted(holders) if holders[home] == holder]
            progress = Progress(self._parts.world.clock)
            try:
                await SpaceComparison(self._parts, self._merge, progress, holder, scene, space, arcs).run()
                self._parts.events["looked at for readers"] += len(arcs)
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("what %s has is not looked at for a reader: %s", address_of(holder.node), problem)

    def _holder(self, place: _Place, layout: Layout) -> Member | None:
        """The node as a holder that should have what lies there, all but what is owed to it; None if it is none, or is compared anyway."""
        keeper = self._parts.keeper
        if not keeper.holding.owns(place.home) or not self._roster.is_believed_alive(place.node):
            return None
        segment = keeper.copies.configurations.at(layout, place.home)
        if segment is None:
            return None
        return next(
            (
                member
                for member in segment.holders(keeper.copies.configurations.me)
                if member.node == place.node and member in segment.sound
            ),
            None,
        )
