"""What every node answers about places that are to be purged: AskPlaces, DropPurged (specs/22-purge.md, Asking).

A node that says that it has nothing older there has to be believed from then on, as long as its process lives. So it first remembers
that nothing older is taken (store/bygone.py), waits until what it is sending to others has arrived, and only then looks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.copies.versions import rank_of, told_version
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Name, name_of
from scenefold.peer.purging.orders import check_order, spot_in
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication.holding_rules import require_meant, require_sender
from scenefold.store import Spot
from scenefold.store.versions import version_of
from scenefold.wire import (
    AskPlaces,
    DropPurged,
    Packet,
    PlacesAsked,
    PlaceState,
    PurgedDropped,
    PurgeItem,
    PurgeOrder,
)

CARRIED_S_MAX = 5.0
"""For what this node is sending to arrive, or to be given up."""
_TEXT_MAX = 256


class Asked:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, in_hand: Callable[[Name], bool]) -> None:
        """`in_hand`: whether there is a version of a record in memory that may still be sent."""
        self._parts = parts
        self._in_hand = in_hand

    def register(self, handlers: Handlers) -> None:
        handlers.add(AskPlaces, self._on_ask, senders=Senders.NODES)
        handlers.add(DropPurged, self._on_drop, senders=Senders.NODES)

    # ------------------------------------------------------------------------------- what the owner does itself, too

    async def checked(self, order: PurgeOrder) -> KnownScene:
        """The order's scene, its header durable here as far as the order's; Refused if the order does not count."""
        scene = await self._parts.scenes.known(order.scene, position=order.position)
        await self._parts.world.workers.run("crypto", check_order, order, scene)
        return scene

    async def look(self, order: PurgeOrder) -> list[PlaceState]:
        """What lies at each place of a checked order. From now on nothing older comes to lie there, as long as this process lives."""
        parts = self._parts
        spots = [spot_in(order.scene, item) for item in order.items]
        if not parts.store.mark_bygone([(spot, rank_of(item.version)) for spot, item in zip(spots, order.items, strict=True)]):
            raise Refused(RejectReason.NOT_READY, "too much was purged lately to remember more", remedy="go on in some minutes")
        in_hand = set(filter(self._in_hand, map(name_of, spots)))
        with trio.move_on_after(CARRIED_S_MAX) as patience:
            await parts.carrying.ended()
        if patience.cancelled_caught:
            raise Refused(RejectReason.NOT_READY, "records are on their way from here that may be older")
        # What was given to the store before it was marked is on the disk when this returns.
        await parts.store.flush()
        found = await parts.store.read(spots)
        states = []
        for spot, item, record in zip(spots, order.items, found, strict=True):
            if name_of(spot) in in_hand or parts.unsettled.of(name_of(spot)):
                states.append(PlaceState.OTHER)
            elif record is None:
                states.append(PlaceState.NOTHING)
            else:
                is_this = isinstance(record, Record) and told_version(record.header_bytes) == item.version
                states.append(PlaceState.THIS if is_this else PlaceState.OTHER)
        return states

    async def drop(self, spots: Sequence[Spot], items: Sequence[PurgeItem]) -> None:
        """None of these versions is here any more, durably. Refused (16) for what this process was not asked about."""
        store = self._parts.store
        if not all(store.bygone.is_marked(spot, rank_of(item.version)) for spot, item in zip(spots, items, strict=True)):
            raise Refused(RejectReason.NOT_READY, "this process was not asked about one of them, or about a newer version since")
        headers = await store.record_headers(spots)
        gone = [
            (spot, version_of(header))
            for spot, item, header in zip(spots, items, headers, strict=True)
            if header is not None and told_version(header) == item.version
        ]
        if gone:
            self._parts.events["purged"] += await store.drop(gone)

    # ------------------------------------------------------------------------------------------------- handlers

    async def _on_ask(self, packet: AskPlaces, peer: str) -> Packet:
        boot = self._parts.own.boot
        try:
            await self._check(packet, peer)
            if packet.order is None:
                return PlacesAsked(0, boot, (), "")
            await self.checked(packet.order)
            states = tuple(await self.look(packet.order))
            # Whoever registers from here on learns of the scene's header by somebody who has it.
            self._require_position(packet.log_position)
        except Refused as refusal:
            return PlacesAsked(int(refusal.reason), boot, (), str(refusal)[:_TEXT_MAX])
        return PlacesAsked(0, boot, states, "")

    async def _check(self, packet: AskPlaces, peer: str) -> None:
        parts = self._parts
        require_sender(peer, packet.asker)
        require_meant(parts, packet.asked)
        parts.arrival.require()
        if parts.cluster_log.registry.position < packet.log_position:
            await parts.cluster_log.pull_from(packet.asker.node)
        self._require_position(packet.log_position)
        self._require_registered(packet)

    def _require_position(self, position: int) -> None:
        if self._parts.cluster_log.registry.position != position:
            raise Refused(RejectReason.POSITION_BEHIND, "the cluster's log is known differently far at the two nodes", remedy="ask again")

    def _require_registered(self, packet: AskPlaces | DropPurged) -> None:
        if not self._parts.cluster_log.registry.is_current(packet.asker):
            raise Refused(RejectReason.NOT_AUTHORISED, "who asks is no member of this cluster, as far as is known here")

    async def _on_drop(self, packet: DropPurged, peer: str) -> Packet:
        parts = self._parts
        try:
            require_sender(peer, packet.asker)
            require_meant(parts, packet.asked)
            self._require_registered(packet)
            if packet.boot != parts.own.boot:
                raise Refused(RejectReason.NOT_READY, "this node has started anew since it was asked")
            await self.drop([spot_in(packet.scene, item) for item in packet.items], packet.items)
        except Refused as refusal:
            return PurgedDropped(int(refusal.reason), str(refusal)[:_TEXT_MAX])
        return PurgedDropped(0, "")
