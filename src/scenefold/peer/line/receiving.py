"""The receiver's side of a handover: noted, taken, forgotten (specs/12-line.md, Steps).

Packets 41, 42, 43, 65 and 67, from the neighbour that gives and from nobody else. A CopyRecords is answered only when
its records are durable: on that the giver relies when it lets go.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Sequence

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace
from scenefold.peer.copies.numbers import is_possible
from scenefold.peer.copies.telling import passing_of
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.line import likeness
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Handover, Holding, Step, describe
from scenefold.peer.line.parts import Parts, check_reply
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.rules import side_of_giver
from scenefold.peer.line.unsettled import Doubt
from scenefold.peer.records.verification import KnownScene, epochs_of, verify_copies, verify_copies_and_husks
from scenefold.store import Outcome, Put, Spot, Store
from scenefold.wire import (
    ClaimRange,
    CopyRecords,
    DropHandover,
    HandItem,
    HandoverReply,
    OfferRange,
    OfferRecords,
    Packet,
    RecordsWanted,
)
from scenefold.world import Priority

IDLE_S = 10.0
"""Without a sign of the giver for so long: ask it what became of the handover."""
ASK_S_MAX = 5.0
VERIFY_BATCH = 128

_log = logging.getLogger("scenefold.peer.line")


class Receiving:
    """Used from the Trio thread only. `refuses`: why this node takes nothing at present; "" if it does."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._heard_at: dict[bytes, float] = {}
        self.refuses = ""

    def register(self, handlers: Handlers) -> None:
        handlers.add(OfferRange, self._on_offer, senders=Senders.NODES)
        handlers.add(OfferRecords, self._on_list, senders=Senders.NODES)
        handlers.add(CopyRecords, self._on_copy, senders=Senders.NODES)
        handlers.add(ClaimRange, self._on_claim, senders=Senders.NODES)
        handlers.add(DropHandover, self._on_drop, senders=Senders.NODES)

    async def tend(self, side: Side) -> None:
        """Ask a giver that has fallen silent whether its handover is still on, until cancelled."""
        keeper = self._parts.keeper
        pauses = Pauses(self._parts.world)
        while True:
            revision = keeper.holding.revision
            handover = keeper.holding.on(side)
            if handover is None or handover.gives:
                self._heard_at = {known: at for known, at in self._heard_at.items() if keeper.holding.find(known) is not None}
                await keeper.changed_after(revision)
                pauses.reset()
                continue
            idle_s = self._parts.world.clock.now() - self._heard_at.setdefault(handover.id, self._parts.world.clock.now())
            if idle_s < IDLE_S:
                with trio.move_on_after(IDLE_S - idle_s):
                    await keeper.changed_after(revision)
                continue
            try:
                await self._inquire(handover)
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("%s: %s", describe(handover), problem)
            await pauses.wait()

    async def _inquire(self, handover: Handover) -> None:
        """The giver refuses (13) as long as it knows the handover; else it has ended."""
        request = DropHandover(handover.id)
        check_reply(await self._parts.peers.ask(handover.peer.node, Priority.LOW, request, HandoverReply, ASK_S_MAX))
        await self._parts.keeper.change(lambda holding: holding.drop(handover.id))
        self._parts.events["dropped"] += 1

    # ------------------------------------------------------------------------------------------------- handlers

    async def _on_offer(self, packet: OfferRange, peer: str) -> Packet:
        return await _replied(packet.handover, self._note(packet, peer))

    async def _note(self, packet: OfferRange, peer: str) -> None:
        parts = self._parts
        if node_of(peer) != packet.giver.node:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} offers in the name of {address_of(packet.giver.node)}")
        if self.refuses:
            raise Refused(RejectReason.BUSY, self.refuses)
        parts.arrival.require()
        parts.require_lease()
        if parts.cluster_log.registry.position < packet.log_position:
            await parts.cluster_log.pull_from(packet.giver.node)
        if parts.cluster_log.registry.position < packet.log_position:
            raise Refused(RejectReason.NOT_READY, "this node does not know the cluster's log that far yet")
        await self._check_room(packet.bytes)
        piece, claims = Arc(packet.first, packet.last), parts.claims
        await claims.look(piece, parts.keeper.holding.arc, giver=packet.giver.node)

        def note(holding: Holding) -> Holding:
            # Looked up inside, since the log may have gone on while we waited for our turn.
            side = side_of_giver(parts.cluster_log.registry, parts.own.member, packet.giver, packet.receiver)
            claims.require_free(piece, holding.arc, giver=packet.giver.node)
            return holding.note(packet.handover, side, packet.giver, piece)

        await parts.keeper.change(note)
        self._touch(packet.handover)

    async def _check_room(self, size_bytes: int) -> None:
        """STORAGE_FULL beforehand, rather than in the midst of copying; and for an empty piece, too, if no record can be put in it."""
        statistics = await self._parts.store.statistics()
        if statistics.disk_total_bytes - statistics.disk_used_bytes < max(size_bytes, 1):
            raise Refused(RejectReason.STORAGE_FULL, "the receiver's disk has no room for the piece")
        # What the node says that it may store: less than the disk has, if somebody has set it a bound.
        capacity = self._parts.own.load.disk_total_bytes
        if capacity and capacity - statistics.disk_used_bytes < size_bytes:
            raise Refused(RejectReason.STORAGE_FULL, "the receiver may not store as much as the piece holds")

    async def _on_list(self, packet: OfferRecords, peer: str) -> Packet:
        handover = self._noted(packet.handover, peer)
        spots = [Spot(RecordPlace(entry.scene, entry.space, entry.location), entry.object) for entry in packet.entries]
        _check_inside(spots, handover.piece)
        present = await self._parts.store.digests(spots)
        self._touch(packet.handover)
        has_let_go = self._parts.store.has_let_go
        unlike = (index for index, entry in enumerate(packet.entries) if present[index] != entry.digest)
        lacking = tuple(index for index in unlike if not has_let_go(packet.entries[index].scene))
        return RecordsWanted(packet.handover, lacking)

    async def _on_copy(self, packet: CopyRecords, peer: str) -> Packet:
        return await _replied(packet.handover, self._copy(packet, peer))

    async def _copy(self, packet: CopyRecords, peer: str) -> None:
        handover = self._noted(packet.handover, peer)
        _check_inside([spot_of_item(item) for item in packet.items], handover.piece)
        verdicts = await verified(self._parts, packet.items, or_husks=True)
        self._touch(packet.handover)
        for verdict in verdicts:
            if isinstance(verdict, Refused):
                raise verdict
        async with self._parts.writing((), anywhere=any(item.object for item in packet.items)):
            # Asked again, since verifying takes its time: what comes after the end of a handover would only be a stray.
            self._noted(packet.handover, peer)
            await keep_durably(self._parts.store, [verdict for verdict in verdicts if isinstance(verdict, Put)])
        self._parts.events["received"] += len(packet.items)
        self._touch(packet.handover)

    async def _on_claim(self, packet: ClaimRange, peer: str) -> Packet:
        return await _replied(packet.handover, self._claim(packet, peer))

    async def _claim(self, packet: ClaimRange, peer: str) -> None:
        handover = self._of(packet.handover, peer)
        self._parts.require_lease()
        if not is_possible(packet.number, self._parts.cluster_log.registry.position):
            await self._parts.cluster_log.pull_from(handover.peer.node)
        if not is_possible(packet.number, self._parts.cluster_log.registry.position):
            raise Refused(RejectReason.ILL_FORMED, "no owner can have come to such a number of configurations")
        if any(found.number > packet.number for segment in packet.segments for found in segment.configurations):
            raise Refused(RejectReason.ILL_FORMED, "a configuration has a higher number than all that the giver has met")
        piece = Arc(packet.first, packet.last)
        unlike: set[Layout] = set()
        if handover.step is Step.NOTED:
            # What settles begins to settle before anybody can be told that it is here, and once more when it is.
            self._parts.settling.note(piece)
            # Copying takes its time, and who gave it to another meanwhile may not say so.
            await self._parts.claims.look(piece, self._parts.keeper.holding.arc, giver=handover.peer.node)
            unlike = await likeness.unlike(self._parts, handover.peer.node, piece)
        was_noted = False

        def claim(holding: Holding) -> Holding:
            nonlocal was_noted
            found = holding.find(packet.handover)
            was_noted = found is not None and found[1].step is Step.NOTED
            return holding.claim(packet.handover, piece)

        await self._parts.keeper.change(claim, passing_of(packet))
        if was_noted and unlike:
            # Nothing was awaited since the commit: nobody can have been told anything there yet.
            for layout in sorted(unlike):
                self._parts.unsettled.doubt(Doubt(layout, piece, rules=2))
            self._parts.events["unlike"] += 1
        self._touch(packet.handover)
        if handover.step is Step.NOTED:
            self._parts.settling.note(piece)
            self._parts.events["taken"] += 1

    async def _on_drop(self, packet: DropHandover, peer: str) -> Packet:
        return await _replied(packet.handover, self._drop(packet, peer))

    async def _drop(self, packet: DropHandover, peer: str) -> None:
        found = self._parts.keeper.holding.find(packet.handover)
        if found is None:
            return
        if found[1].peer.node != node_of(peer):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} has no part in this handover")
        # As its giver we refuse as long as we know it: that is our answer to a receiver that asks.
        await self._parts.keeper.change(lambda holding: holding.drop(packet.handover))

    # -------------------------------------------------------------------------------------------------- helpers

    def _of(self, handover: bytes, peer: str) -> Handover:
        found = self._parts.keeper.holding.find(handover)
        if found is None or found[1].gives or found[1].peer.node != node_of(peer):
            raise Refused(RejectReason.ILL_FORMED, f"no such handover from {peer} is noted here")
        return found[1]

    def _noted(self, handover: bytes, peer: str) -> Handover:
        known = self._of(handover, peer)
        if known.step is not Step.NOTED:
            raise Refused(RejectReason.STALE_VERSION, "the piece is this node's already")
        return known

    def _touch(self, handover: bytes) -> None:
        self._heard_at[handover] = self._parts.world.clock.now()


async def keep_durably(store: Store, puts: Sequence[Put]) -> None:
    """Return once all of this, or something newer, is durable here. Refused (11) if the disk is full."""
    if any(result.outcome is Outcome.FULL for result in await store.merge(puts)):
        raise Refused(RejectReason.STORAGE_FULL, "the receiver's disk is full")


async def verified(parts: Parts, items: Sequence[HandItem], *, or_husks: bool = False) -> list[Put | Refused]:
    """What other nodes hand over, judged like a put but for the write floor; headers that the records' authors knew are pulled first.

    `or_husks`: what is left of rotten records is taken as well.
    """
    scenes: dict[SceneId, KnownScene] = {}
    for scene, epoch in epochs_of(items).items():
        try:
            scenes[scene] = await parts.scenes.known(scene, position=epoch)
        except Refused as refusal:
            _log.info("records of a scene that is unknown here: %s", refusal)
    unknown = Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "the scene is unknown to the receiver")
    verdicts: list[Put | Refused] = []
    for start in range(0, len(items), VERIFY_BATCH):
        batch = items[start : start + VERIFY_BATCH]
        claims = [(item, scenes[item.scene]) for item in batch if item.scene in scenes]
        judged = iter(await parts.world.workers.run("crypto", verify_copies_and_husks if or_husks else verify_copies, claims))
        verdicts += [next(judged) if item.scene in scenes else unknown for item in batch]
    return verdicts


def spot_of_item(item: HandItem) -> Spot:
    return Spot(RecordPlace(item.scene, item.space, item.location), item.object)


def _check_inside(spots: Sequence[Spot], piece: Arc) -> None:
    if any(spot.place.location not in piece or spot.home not in piece for spot in spots):
        raise Refused(RejectReason.OUTSIDE_BOUNDS, "a record lies outside of the piece that is handed over")


async def _replied(handover: bytes, action: Awaitable[None]) -> HandoverReply:
    """The reply to a step: 0, or the reason why not."""
    try:
        await action
    except Refused as refusal:
        return HandoverReply(handover, int(refusal.reason), str(refusal)[:256])
    return HandoverReply(handover, 0, "")
