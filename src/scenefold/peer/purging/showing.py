"""Suspects are shown to members of their scene, and deleted by a writer's word: packets 108 to 113 (specs/22-purge.md, Who was away).

Nobody else is shown them: what a scene's members have deleted, and purged, is no business of others. Who is a member says the scene's
public header, which holds a lockbox for each.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, SceneId
from scenefold.base.limits import BULK_BYTES_MAX, STORE_READ_BATCH_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import DISCARD_DOMAIN, PublicKey, Record, RecordPlace
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.line.parts import Parts
from scenefold.peer.purging.suspects import Suspects, told
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Spot
from scenefold.wire import (
    DiscardOrder,
    DiscardSuspects,
    FetchSuspects,
    HandItem,
    ListSuspects,
    Packet,
    RecordEntry,
    SuspectsDiscarded,
    SuspectsFetched,
    SuspectsListed,
)

IsMember = Callable[[str, KnownScene], bool]
"""Whether a user holds keys of a scene, as far as its public header tells."""
_ITEM_FRAMING_BYTES = 64


class Showing:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, suspects: Suspects, is_member: IsMember) -> None:
        self._parts = parts
        self._suspects = suspects
        self._is_member = is_member

    def register(self, handlers: Handlers) -> None:
        handlers.add(ListSuspects, self._on_list, senders=Senders.USERS)
        handlers.add(FetchSuspects, self._on_fetch, senders=Senders.USERS)
        handlers.add(DiscardSuspects, self._on_discard, senders=Senders.USERS)

    async def _on_list(self, packet: ListSuspects, peer: str) -> Packet:
        await self._scene_of(packet.scene, peer)
        page = await self._parts.store.suspects(packet.scene, packet.after, packet.limit)
        return SuspectsListed(self._parts.own.member, tuple(map(told, page.records)), page.cursor)

    async def _on_fetch(self, packet: FetchSuspects, peer: str) -> Packet:
        for scene in sorted({entry.scene for entry in packet.entries}):
            await self._scene_of(scene, peer)
        items: list[HandItem] = []
        missing: list[int] = []
        room = BULK_BYTES_MAX
        for start in range(0, len(packet.entries), STORE_READ_BATCH_MAX):
            batch = packet.entries[start : start + STORE_READ_BATCH_MAX]
            found = await self._parts.store.suspect_records([_spot_of(entry) for entry in batch])
            for index, (entry, record) in enumerate(zip(batch, found, strict=True), start):
                if not isinstance(record, Record) or record.header.digest != entry.digest:
                    missing.append(index)
                    continue
                room -= len(record.signature) + len(record.header_bytes) + len(record.ciphertext) + _ITEM_FRAMING_BYTES
                if room < 0 and (items or missing):
                    return SuspectsFetched(tuple(items), tuple(missing))
                place = entry.scene, entry.space, entry.location, entry.object
                items.append(HandItem(*place, record.signature, record.header_bytes, record.ciphertext))
        return SuspectsFetched(tuple(items), tuple(missing))

    async def _on_discard(self, packet: DiscardSuspects, peer: str) -> Packet:
        order = packet.order
        scene = await self._scene_of(order.scene, peer, position=order.position)
        if order.holder != self._parts.own.member:
            raise Refused(RejectReason.WRONG_INCARNATION, "the order speaks of another node, or of this one before it began anew")
        await self._parts.world.workers.run("crypto", check_order, order, scene)
        places = [Spot(RecordPlace(order.scene, item.space, item.location), item.object) for item in order.items]
        digests = [item.digest for item in order.items]
        return SuspectsDiscarded(await self._suspects.discard(list(zip(places, digests, strict=True))))

    async def _scene_of(self, scene: SceneId, peer: str, *, position: int = 0) -> KnownScene:
        """Refused (12) for who is no member of it."""
        known = await self._parts.scenes.known(scene, position=position, asker=peer)
        if not self._is_member(peer, known):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no member of scene {scene:08x}")
        return known


def check_order(order: DiscardOrder, scene: KnownScene) -> None:
    """Refused unless a present writer of the scene has signed it. Pure; some 150 us."""
    if order.position > scene.public.position:
        raise Refused(RejectReason.NOT_READY, f"the scene's header of position {order.position} is not here yet")
    try:
        present_writer(scene, order.writer).verify(order.signature, DISCARD_DOMAIN, order.signable(scene.public.genesis))
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem


def present_writer(scene: KnownScene, writer: KeyId) -> PublicKey:
    """The key of who may write now; Refused (12, 17) otherwise."""
    key, entries = scene.keys.get(writer), scene.writers.get(writer, ())
    if key is None or not entries:
        raise Refused(RejectReason.NOT_AUTHORISED, f"key {writer:08x} is no writer of the scene")
    if not any(entry.from_position <= scene.public.position <= entry.until_position for entry in entries):
        raise Refused(RejectReason.KEY_REVOKED, f"key {writer:08x} may write in the scene no more")
    return key


def _spot_of(entry: RecordEntry) -> Spot:
    return Spot(RecordPlace(entry.scene, entry.space, entry.location), entry.object)
