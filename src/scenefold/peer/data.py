"""Records in and out: packets 10 to 18 and their bulk forms 32 to 35 (Algorithm 6; specs/11-peers.md, Data).

A write is judged by the owner of its place alone: verified in worker threads, made durable, then acknowledged. Offered
to the wrong node it is refused with the owner's id. A read at the wrong node is forwarded to the owner, once: what one
node asks another is never forwarded again, so tables that disagree cannot send a request in circles.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence

import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import BULK_BYTES_MAX, RANGE_LOCATIONS_MAX
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordPlace
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.peers import Peers
from scenefold.peer.routing import Routing
from scenefold.peer.scenes import Scenes
from scenefold.peer.verification import KnownScene, verify_all
from scenefold.store import Put, Store
from scenefold.wire import (
    AcceptData,
    EmptyData,
    GetData,
    GetMany,
    GetManyReply,
    Packet,
    ProposeData,
    PutItem,
    PutMany,
    PutManyReply,
    PutOutcome,
    QueryRange,
    RecordBytes,
    RecordKey,
    RejectData,
    RejectRange,
    ReturnData,
    ReturnRange,
)
from scenefold.world import Priority, World

VERIFY_BATCH = 128
"""Records that one call in a worker thread verifies: some 10 ms."""
READ_BATCH = 128
"""Records read at a time; a reply that is full stops the reading."""
FORWARD_S_MAX = 10.0
_RECORD_FRAMING_BYTES = 16
"""MessagePack heads of one record in a reply."""


class DataService:
    """The owner's side of every read and write."""

    def __init__(self, world: World, store: Store, peers: Peers, scenes: Scenes, routing: Routing, me: NodeId) -> None:
        self._world = world
        self._store = store
        self._peers = peers
        self._scenes = scenes
        self._routing = routing
        self._me = me

    def register(self, handlers: Handlers) -> None:
        handlers.add(ProposeData, self._on_propose)
        handlers.add(PutMany, self._on_put_many)
        handlers.add(GetData, self._on_get)
        handlers.add(GetMany, self._on_get_many)
        handlers.add(QueryRange, self._on_query)

    # --------------------------------------------------------------------------------------------------- writes

    async def put(self, items: Sequence[PutItem]) -> list[PutOutcome]:
        """Verify and store; an outcome for each item, in order. What is stored is durable when this returns."""
        scenes = await self._scenes_of(items)
        outcomes = [self._refused_unseen(item, scenes[item.scene]) for item in items]
        open_ones = [index for index, outcome in enumerate(outcomes) if outcome is None]
        puts: list[tuple[int, Put]] = []
        for start in range(0, len(open_ones), VERIFY_BATCH):
            batch = open_ones[start : start + VERIFY_BATCH]
            claims = [(items[index], scenes[items[index].scene]) for index in batch]
            verdicts = await self._world.workers.run("crypto", verify_all, claims)
            for index, verdict in zip(batch, verdicts, strict=True):
                if isinstance(verdict, Refused):
                    outcomes[index] = _outcome(items[index], verdict.reason)
                else:
                    puts.append((index, verdict))
        results = await self._store.put([put for _, put in puts]) if puts else []
        for (index, _), result in zip(puts, results, strict=True):
            outcomes[index] = _outcome(items[index], result.reason)
        return [outcome for outcome in outcomes if outcome is not None]

    def _refused_unseen(self, item: PutItem, scene: KnownScene | None) -> PutOutcome | None:
        """The outcome of what need not be looked at: others' places, scenes that nobody knows."""
        owner = self._routing.owner_of(item.location)
        if owner != self._me:
            return PutOutcome(RejectReason.NOT_MY_LOCATION, item.location, owner)
        return _outcome(item, RejectReason.UNKNOWN_SCENE_OR_SPACE) if scene is None else None

    async def _scenes_of(self, items: Sequence[PutItem]) -> dict[SceneId, KnownScene | None]:
        scenes: dict[SceneId, KnownScene | None] = {}
        for scene in {item.scene for item in items}:
            try:
                scenes[scene] = await self._scenes.known(scene)
            except Refused:
                scenes[scene] = None
        return scenes

    async def _on_put_many(self, packet: PutMany, _peer: str) -> Packet:
        return PutManyReply(outcomes=tuple(await self.put(packet.items)))

    async def _on_propose(self, packet: ProposeData, _peer: str) -> Packet:
        item = PutItem(
            scene=packet.scene,
            space=packet.space,
            location=packet.location,
            expect=packet.expect,
            signature=packet.signature,
            header=packet.header,
            ciphertext=packet.ciphertext,
        )
        (outcome,) = await self.put([item])
        if outcome.reason == 0:
            return AcceptData(signature=packet.signature, location=outcome.location)
        reason = RejectReason(outcome.reason)
        behind = reason in (RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED)
        public = (await self._scenes.known(packet.scene)).public if behind else None
        return RejectData(reason=reason, owner=outcome.owner, public=public)

    # ---------------------------------------------------------------------------------------------------- reads

    async def get(self, scene: SceneId, keys: Sequence[RecordKey], position: int, *, forward: bool) -> list[RecordBytes | None]:
        """Records of the first keys, as many as fit a reply and at least one; others' are fetched if `forward`."""
        found: list[RecordBytes | None] = []
        room = BULK_BYTES_MAX
        for start in range(0, len(keys), READ_BATCH):
            batch = keys[start : start + READ_BATCH]
            for record in await self._read_batch(scene, batch, position, forward=forward):
                room -= _size_of(record)
                if room < 0 and found:
                    return found
                found.append(record)
        return found

    async def read(self, scene: SceneId, keys: Sequence[RecordKey], position: int) -> list[RecordBytes | None]:
        """All records at the keys, wherever they lie; for services of this node. Refused (16) if an owner is away."""
        found: list[RecordBytes | None] = []
        while len(found) < len(keys):
            found += await self.get(scene, keys[len(found) :], position, forward=True)
        return found

    async def _read_batch(self, scene: SceneId, keys: Sequence[RecordKey], position: int, *, forward: bool) -> list[RecordBytes | None]:
        found: dict[RecordKey, RecordBytes | None] = {}
        by_owner: dict[NodeId, list[RecordKey]] = {}
        for key in keys:
            by_owner.setdefault(self._routing.owner_of(key.location), []).append(key)
        own = by_owner.pop(self._me, [])
        if by_owner and not forward:
            owner = next(iter(by_owner))
            raise Refused(RejectReason.NOT_MY_LOCATION, f"the location belongs to node {address_of(owner)}")
        records = await self._store.get_many([RecordPlace(scene, key.space, key.location) for key in own])
        found.update(zip(own, map(_as_bytes, records), strict=True))

        async def fetch(owner: NodeId, theirs: Sequence[RecordKey]) -> None:
            while theirs:
                request = GetMany(scene=scene, position=position, keys=tuple(theirs))
                try:
                    reply = await self._peers.ask(owner, Priority.LOW, request, GetManyReply, FORWARD_S_MAX)
                except Unreachable as problem:
                    raise Refused(RejectReason.NOT_READY, f"the owner {address_of(owner)} does not answer") from problem
                if not 1 <= len(reply.records) <= len(theirs):
                    raise Refused(RejectReason.ILL_FORMED, "an owner answered with another number of records")
                found.update(zip(theirs, reply.records, strict=False))
                theirs = theirs[len(reply.records) :]

        await _for_each_owner(fetch, by_owner)
        return [found[key] for key in keys]

    async def _on_get_many(self, packet: GetMany, peer: str) -> Packet:
        await self._scenes.known(packet.scene, position=packet.position)
        records = await self.get(packet.scene, packet.keys, packet.position, forward=node_of(peer) is None)
        return GetManyReply(records=tuple(records))

    async def _on_get(self, packet: GetData, peer: str) -> Packet:
        public = (await self._scenes.known(packet.scene, position=packet.position)).public
        key = RecordKey(packet.space, packet.location)
        (record,) = await self.get(packet.scene, [key], packet.position, forward=node_of(peer) is None)
        if record is None:
            return EmptyData(
                scene=packet.scene,
                space=packet.space,
                location=packet.location,
                position=public.position,
                write_floor=public.write_floor,
            )
        return ReturnData(
            scene=packet.scene,
            space=packet.space,
            location=packet.location,
            signature=record.signature,
            header=record.header,
            ciphertext=record.ciphertext,
            position=public.position,
            write_floor=public.write_floor,
        )

    # --------------------------------------------------------------------------------------------------- ranges

    async def _on_query(self, packet: QueryRange, _peer: str) -> Packet:
        await self._scenes.known(packet.scene)

        mine = Arc(packet.first, packet.last).intersection(self._routing.arc_of(self._me))
        if mine is None:
            return RejectRange(scene=packet.scene, space=packet.space, location=packet.first, reason=RejectReason.OUTSIDE_BOUNDS)
        answer = await self._store.range(packet.scene, packet.space, mine, RANGE_LOCATIONS_MAX)
        return ReturnRange(
            scene=packet.scene,
            space=packet.space,
            first=answer.covered.first,
            last=answer.covered.last,
            locations=tuple(answer.locations),
        )


async def _for_each_owner(
    fetch: Callable[[NodeId, Sequence[RecordKey]], Awaitable[None]], by_owner: Mapping[NodeId, Sequence[RecordKey]]
) -> None:
    """Fetch from all owners at once; the first error, if any, once all have ended."""
    errors: list[ScenefoldError] = []

    async def guarded(owner: NodeId, keys: Sequence[RecordKey]) -> None:
        try:
            await fetch(owner, keys)
        except ScenefoldError as error:
            errors.append(error)

    async with trio.open_nursery() as nursery:
        for owner, keys in by_owner.items():
            nursery.start_soon(guarded, owner, keys)
    if errors:
        raise errors[0]


def _outcome(item: PutItem, reason: RejectReason | None) -> PutOutcome:
    return PutOutcome(reason or 0, item.location, NodeId(0))


def _as_bytes(record: Record | None) -> RecordBytes | None:
    return None if record is None else RecordBytes(record.signature, record.header_bytes, record.ciphertext)


def _size_of(record: RecordBytes | None) -> int:
    if record is None:
        return 1
    return len(record.signature) + len(record.header) + len(record.ciphertext) + _RECORD_FRAMING_BYTES
