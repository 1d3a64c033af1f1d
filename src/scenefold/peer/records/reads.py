"""Records out: packets 13 and 34 (specs/18-data.md, Reads).

A read at the wrong node is forwarded to the owner, once: what one node asks another is never forwarded again, so
tables that disagree cannot send a request in circles. A node without a lease may have been replaced without knowing: what
it has it gives, marked stale, and what it lacks it does not call absent. A record that has rotted on the disk is said to
be damaged, in its place, and keeps nobody from the others. An answer says how far whoever gave it knows the scene's log: for an image
only those count that what is forbidden by now cannot change any more (fence.py).
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import NamedTuple

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import BULK_BYTES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordPlace, wanted_place
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.holdings import LOOKS_MAX, Holdings, Known, Lease, Owners, no_lease, not_recovered, other_candidates, silent_owner
from scenefold.peer.peers import Peers
from scenefold.peer.records.copying import TOLD_S_MAX, Copying
from scenefold.peer.records.fence import Fence
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.store import Spot, Store
from scenefold.wire import DAMAGED_RECORD, EmptyData, GetData, GetMany, GetManyReply, Packet, RecordBytes, RecordKey, ReturnData
from scenefold.world import Priority

READ_BATCH = 128
"""Records read at a time; a reply that is full stops the reading."""
FORWARD_S_MAX = 10.0
FORWARD_OTHER_S = 3.0
"""For one that is not the last who may have it: a node that hangs must not hold up what the next one can answer."""
_NO_HEADER = 2**64 - 1
"""What nobody was asked about is as new as can be."""
_RECORD_FRAMING_BYTES = 16
"""MessagePack heads of one record in a reply."""


class Found(NamedTuple):
    """Records in the order of their keys, None where nothing is, DAMAGED_RECORD where one has rotted. `stale`: newer versions may be elsewhere.

    `position`, `write_floor`: of the oldest header that some answerer goes by.
    """

    records: list[RecordBytes | None]
    stale: bool
    position: int
    write_floor: int


class Reads:
    """The owner's side of every read, and the way to it for all others."""

    def __init__(
        self,
        store: Store,
        peers: Peers,
        scenes: Scenes,
        line: Holdings,
        lease: Lease,
        owners: Owners,
        me: NodeId,
        copying: Copying,
        known: Known,
        fence: Fence,
    ) -> None:
        self._store = store
        self._peers = peers
        self._scenes = scenes
        self._line = line
        self._lease = lease
        self._owners = owners
        self._me = me
        self._copying = copying
        self._known = known
        self._fence = fence

    def register(self, handlers: Handlers) -> None:
        handlers.add(GetData, self._on_get)
        handlers.add(GetMany, self._on_get_many)

    async def get(self, scene: SceneId, keys: Sequence[RecordKey], position: int, *, forward: bool) -> Found:
        """Records of the first keys, as many as fit a reply and at least one; others' are fetched if `forward`."""
        found: list[RecordBytes | None] = []
        stale = False
        room = BULK_BYTES_MAX
        position_said, floor = await self._fenced(scene, position)
        # However many batches there are: what is unsettled is waited for once.
        until = trio.current_time() + TOLD_S_MAX
        for start in range(0, len(keys), READ_BATCH):
            batch = await self._read_batch(scene, keys[start : start + READ_BATCH], position, until, forward=forward)
            stale = stale or batch.stale
            position_said, floor = min(position_said, batch.position), min(floor, batch.write_floor)
            for record in batch.records:
                room -= _size_of(record)
                if room < 0 and found:
                    self._store.check_kept(scene)
                    return Found(found, stale, position_said, floor)
                found.append(record)
        # What was there when the first look began may have been let go of since.
        self._store.check_kept(scene)
        return Found(found, stale, position_said, floor)

    async def _fenced(self, scene: SceneId, position: int) -> tuple[int, int]:
        """Position and write floor of the header that is here, durably; what it forbids comes in no more from now on."""
        known = self._scenes.here(scene) or await self._scenes.known(scene, position=position)
        self._store.check_kept(scene)
        await self._fence.passed(scene, known.public.write_floor)
        return known.public.position, known.public.write_floor

    async def _read_batch(self, scene: SceneId, keys: Sequence[RecordKey], position: int, until: float, *, forward: bool) -> Found:
        found: dict[RecordKey, RecordBytes | None] = {}
        by_candidates: dict[tuple[NodeId, ...], list[RecordKey]] = {}
        own = [key for key in keys if self._line.owns(_home_of(key))]
        for key in keys:
            if not self._line.owns(_home_of(key)):
                by_candidates.setdefault(other_candidates(self._owners, _home_of(key), self._me), []).append(key)
        if by_candidates and not forward:
            raise Refused(RejectReason.NOT_MY_LOCATION, "the location belongs to another node")
        stale = await self._read_own(scene, own, found, until)
        position_said, floor = _NO_HEADER, _NO_HEADER

        async def fetch(candidates: tuple[NodeId, ...], theirs: Sequence[RecordKey]) -> None:
            nonlocal stale, position_said, floor
            while theirs:
                reply = await self._ask_in_turn(candidates, GetMany(scene=scene, position=position, keys=tuple(theirs)))
                stale = stale or reply.stale
                position_said, floor = min(position_said, reply.position), min(floor, reply.write_floor)
                found.update(zip(theirs, reply.records, strict=False))
                theirs = theirs[len(reply.records) :]

        await _all_at_once([partial(fetch, candidates, theirs) for candidates, theirs in by_candidates.items()])
        return Found([found[key] for key in keys], stale, position_said, floor)

    async def _read_own(self, scene: SceneId, keys: Sequence[RecordKey], found: dict[RecordKey, RecordBytes | None], until: float) -> bool:
        """Read what is ours into `found`; True if it may be stale."""
        if not keys:
            return False
        spots = [Spot(RecordPlace(scene, key.space, key.location), key.object) for key in keys]
        homes = [_home_of(key) for key in keys]
        if not self._known.is_quiet:
            await self._known.look_up(homes, until)
        for _ in range(LOOKS_MAX):
            arc = self._line.arc
            known = [True] * len(homes) if self._known.is_quiet else [self._known.is_known(home) for home in homes]
            records = await self._store.read(spots)
            is_settled = await self._copying.records_settled(spots, records, until)
            if self._line.arc is arc:
                break
            if not all(self._line.owns(_home_of(key)) for key in keys):
                # Given away while we looked: the records may have been deleted behind the new owner's back.
                raise Refused(RejectReason.NOT_READY, "the place is changing hands")
            # Ours again or ours still: only another look can tell.
        else:
            raise Refused(RejectReason.NOT_READY, "the arc is changing all the time")
        leased = self._lease.holds()
        for key, record, is_known in zip(keys, records, known, strict=True):
            if record is None and not leased:
                raise no_lease()
            if record is None and not is_known:
                raise not_recovered()
            found[key] = _as_bytes(record)
        return not (leased and is_settled and all(known))

    async def _ask_in_turn(self, candidates: tuple[NodeId, ...], request: GetMany) -> GetManyReply:
        """The answer of the first that has one; the first refusal if none has, rather than nonsense."""
        problems: list[Refused] = []
        for owner in candidates:
            is_last = owner == candidates[-1]
            try:
                return await self._ask(owner, request, FORWARD_S_MAX if is_last else FORWARD_OTHER_S)
            except Refused as refusal:
                problems.append(refusal)
        # Nonsense of one must not be the word on what another one may have in a moment.
        raise next((found for found in problems if found.reason is not RejectReason.ILL_FORMED), problems[0])

    async def _ask(self, owner: NodeId, request: GetMany, timeout_s: float) -> GetManyReply:
        try:
            reply = await self._peers.ask(owner, Priority.LOW, request, GetManyReply, timeout_s)
        except Unreachable as problem:
            raise silent_owner(owner) from problem
        except PeerFault as problem:
            raise Refused(RejectReason.ILL_FORMED, "an owner answered with another packet") from problem
        except Refused as refusal:
            if refusal.reason is not RejectReason.NOT_MY_LOCATION:
                raise
            raise Refused(RejectReason.NOT_READY, "the place is changing hands") from refusal
        if not 1 <= len(reply.records) <= len(request.keys):
            raise Refused(RejectReason.ILL_FORMED, "an owner answered with another number of records")
        return reply

    async def _on_get_many(self, packet: GetMany, peer: str) -> Packet:
        known = await self._scenes.known(packet.scene, position=packet.position, asker=peer)
        for space in sorted({key.space for key in packet.keys}):
            known.check_no_shadow(space, "read")
        found = await self.get(packet.scene, packet.keys, packet.position, forward=node_of(peer) is None)
        return GetManyReply(tuple(found.records), found.stale, found.position, found.write_floor)

    async def _on_get(self, packet: GetData, peer: str) -> Packet:
        known = await self._scenes.known(packet.scene, position=packet.position, asker=peer)
        known.check_no_shadow(packet.space, "read")
        key = RecordKey(packet.space, packet.location, packet.object)
        found = await self.get(packet.scene, [key], packet.position, forward=node_of(peer) is None)
        record = found.records[0]
        if record == DAMAGED_RECORD:
            raise Refused(RejectReason.NOT_READY, "the record is damaged", remedy="write it anew, or restore it from a copy")
        if record is None:
            return EmptyData(
                scene=packet.scene,
                space=packet.space,
                location=packet.location,
                position=found.position,
                write_floor=found.write_floor,
            )
        return ReturnData(
            scene=packet.scene,
            space=packet.space,
            location=packet.location,
            signature=record.signature,
            header=record.header,
            ciphertext=record.ciphertext,
            position=found.position,
            write_floor=found.write_floor,
            stale=found.stale,
        )


def behind() -> Refused:
    """For an answer that is none for an image: whoever gave it may still take what the scene's mode forbids."""
    return Refused(RejectReason.NOT_READY, "an owner does not know the scene's mode yet", remedy="ask again in a while")


async def _all_at_once(fetches: Sequence[Callable[[], Awaitable[None]]]) -> None:
    """Run all; the first error, if any, once all have ended."""
    errors: list[ScenefoldError] = []

    async def guarded(fetch: Callable[[], Awaitable[None]]) -> None:
        try:
            await fetch()
        except ScenefoldError as error:
            errors.append(error)

    async with trio.open_nursery() as nursery:
        for fetch in fetches:
            nursery.start_soon(guarded, fetch)
    if errors:
        raise errors[0]


def _home_of(key: RecordKey) -> Location:
    """The place whose owner answers: an object is looked for by its id, wherever the reader believes it to lie."""
    return wanted_place(key.object) if key.object else key.location


def _as_bytes(record: Record | DamagedData | None) -> RecordBytes | None:
    if isinstance(record, DamagedData):
        return DAMAGED_RECORD
    return None if record is None else RecordBytes(record.signature, record.header_bytes, record.ciphertext)


def _size_of(record: RecordBytes | None) -> int:
    if record is None:
        return 1
    return len(record.signature) + len(record.header) + len(record.ciphertext) + _RECORD_FRAMING_BYTES
