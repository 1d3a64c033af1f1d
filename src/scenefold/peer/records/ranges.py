"""Which places hold a record: packets 16 to 18 (thesis C.4; specs/18-data.md, Ranges).

A node answers for its own arc only, and says which part of the question it has answered; the asker goes on behind it.
That nothing lies somewhere is a claim as well, so it needs a lease; without one, what is there is listed as stale.
"""

from __future__ import annotations

import trio

from scenefold.base.limits import RANGE_LOCATIONS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import wanted_place
from scenefold.peer.handlers import Handlers
from scenefold.peer.holdings import LOOKS_MAX, Holdings, Known, Lease
from scenefold.peer.records.copying import TOLD_S_MAX, Copying
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.store import RangeAnswer, Store
from scenefold.wire import Packet, QueryRange, RejectRange, ReturnRange


class Ranges:
    """The owner's side of range queries."""

    def __init__(self, store: Store, scenes: Scenes, line: Holdings, lease: Lease, copying: Copying, known: Known) -> None:
        self._store = store
        self._scenes = scenes
        self._line = line
        self._lease = lease
        self._copying = copying
        self._known = known

    def register(self, handlers: Handlers) -> None:
        handlers.add(QueryRange, self._on_query)

    async def answer(
        self, packet: QueryRange, limit: int = RANGE_LOCATIONS_MAX, *, ask: bool = True, asker: str = "", patience_s: float = TOLD_S_MAX
    ) -> ReturnRange | RejectRange:
        """At most `limit` locations; Refused (19) for a shadow, and if nobody knows the scene, or without `ask` this node does not.

        `patience_s`: for what is unsettled.
        """
        until = trio.current_time() + patience_s
        known = await self._scenes.known(packet.scene, ask=ask, asker=asker)
        known.check_no_shadow(packet.space, "list")
        for _ in range(LOOKS_MAX):
            mine = self._mine(packet)
            if mine is None:
                return range_rejection(packet, RejectReason.OUTSIDE_BOUNDS)
            arc = self._line.arc
            # What is known of the question's first part must not be held up by a gap behind it.
            mine, is_recovered = self._known.part_of(mine)
            answer = await self._store.range(packet.scene, packet.space, mine, limit)
            is_settled = await self._copying.list_settled(packet.scene, packet.space, answer.covered, until)
            self._store.check_kept(packet.scene)
            if self._line.arc is not arc:
                # What was given away may have been deleted while we looked, also if an equal arc is ours again.
                continue
            stale = not (is_recovered and is_settled and self._lease.holds())
            locations, objects = self._decided_here(answer)
            if stale and not locations:
                return range_rejection(packet, RejectReason.NOT_READY)
            return ReturnRange(
                scene=packet.scene,
                space=packet.space,
                first=answer.covered.first,
                last=answer.covered.last,
                locations=locations,
                objects=objects,
                stale=stale,
            )
        return range_rejection(packet, RejectReason.NOT_READY)

    def _decided_here(self, answer: RangeAnswer) -> tuple[tuple[Location, ...], tuple[bytes, ...]]:
        """What is listed, without objects that lie here while another node decides about them: that one has them, or will."""
        if not answer.objects:
            return tuple(answer.locations), ()
        pairs = zip(answer.locations, answer.objects, strict=True)
        kept = [(location, name) for location, name in pairs if not any(name) or self._line.owns(wanted_place(name))]
        return tuple(location for location, _ in kept), tuple(name for _, name in kept)

    def _mine(self, packet: QueryRange) -> Arc | None:
        arc = self._line.arc
        return None if arc is None else Arc(packet.first, packet.last).intersection(arc)

    async def _on_query(self, packet: QueryRange, peer: str) -> Packet:
        return await self.answer(packet, asker=peer)


def range_rejection(packet: QueryRange, reason: RejectReason) -> RejectRange:
    """The answer for a question that gets none."""
    return RejectRange(scene=packet.scene, space=packet.space, location=packet.first, reason=reason)
