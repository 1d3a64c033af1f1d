"""The node's store: records on the line, durable before they are acknowledged (specs/10-store.md).

Writes go through the group writer; reads run in threads of their own on LMDB's unchanging views, and never wait for a
write. Records must have been verified before they come here.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import STORE_READ_BATCH_MAX, STORE_RESERVE_BYTES
from scenefold.base.location import Arc
from scenefold.crypto import Record, RecordHeader, RecordPlace
from scenefold.store import reading, walking
from scenefold.store.building import keep_building
from scenefold.store.bygone import Bygone
from scenefold.store.changes import PutValue, PutValues
from scenefold.store.comparing import ComparingStore
from scenefold.store.debts import read_owed
from scenefold.store.digest_changes import has_unbuilt
from scenefold.store.dropping import DroppingStore
from scenefold.store.ending import EndingStore
from scenefold.store.holding import PutHolding, RenewIdentity, StoredHolding, read_holding
from scenefold.store.husks import HuskStore
from scenefold.store.identity import INCARNATION_BYTES, StoreIdentity, claim
from scenefold.store.judging import Outcome, Put, PutResult
from scenefold.store.layout import HEADERS, NOTES, TABLES, Spot, log_note, scene_key
from scenefold.store.logs import LogStore
from scenefold.store.noticing import Noticed
from scenefold.store.opened import in_view
from scenefold.store.owing import OwingStore
from scenefold.store.reading import RangeAnswer
from scenefold.store.record_changes import DiscardDamaged, HoldRecords, MergeRecords, PutRecords, RemoveRecords, SlideObjects
from scenefold.store.sealing import SealedEnvironment
from scenefold.store.statistics import Counts, StoreStatistics, read_counts, room_beside
from scenefold.store.suspects import SuspectStore
from scenefold.store.walking import Entry, Manifest, Rightful, Weighed
from scenefold.store.writer import GroupWriter
from scenefold.world.ports import Environment, World
from scenefold.world.tasks import background_tasks

SLIDE_BATCH = 256
"""Node-managed records that one commit puts elsewhere: each is copied, and a full one has 60 KiB."""


class Store(ComparingStore, HuskStore, OwingStore, DroppingStore, EndingStore, SuspectStore, LogStore):
    """An open store; made by `open_store`."""

    def __init__(self, world: World, environment: Environment, identity: StoreIdentity, writer: GroupWriter) -> None:
        super().__init__(world.workers, environment, writer)
        self._entropy = world.entropy
        self.identity = identity
        self.opened_as = identity.incarnation
        self.noticed = Noticed(world.clock)
        self.bygone = Bygone(trio.current_time)

    @property
    def damaged(self) -> int:
        """Records that were met since the start, and had changed on the disk: each once."""
        return self.noticed.count

    def tell_of_rot(self, hear: Callable[[Spot], None]) -> None:
        """Have each record told that cannot be read any more, whoever reads it. `hear` must return at once."""
        self.noticed.hear = hear

    @property
    def commits(self) -> int:
        """Synced transactions since the store was opened; fewer than puts where they shared one."""
        return self._writer.commits

    # -------------------------------------------------------------------------------------------------- records

    async def put(self, puts: Sequence[Put], debtors: Sequence[Sequence[NodeId]] = ()) -> list[PutResult]:
        """Store verified records in this node's arc; results in their order. What is STORED is durable on return.

        `debtors`: for each put the nodes that are still to get it. What is there already, so that nothing is written, owes what it owed.
        """
        return await self._keep(PutRecords, _owed(puts, debtors))

    async def merge(self, puts: Sequence[Put], debtors: Sequence[Sequence[NodeId]] = ()) -> list[PutResult]:
        """Take verified copies from other nodes, wherever they lie: the highest version stays, whatever it expects.

        A node-managed record needs its `at`. FULL once it would take of the reserve what those need who make room, unless it is no larger than
        what lies there. STALE is no failure: something newer is here.
        """
        return await self._keep(MergeRecords, _owed(puts, debtors))

    async def hold(self, puts: Sequence[Put]) -> list[PutResult]:
        """As `merge`, for copies that this node holds for another: FULL before those are."""
        return await self._keep(HoldRecords, puts)

    async def _keep(self, change: type[PutRecords | MergeRecords], puts: Sequence[Put]) -> list[PutResult]:
        late = self.bygone.late(puts)
        if not late:
            return self._looked_over(puts, await self._writer.submit(change(_with_headers(puts))))
        rest = [put for index, put in enumerate(puts) if index not in late]
        kept = iter(self._looked_over(rest, await self._writer.submit(change(_with_headers(rest)))) if rest else ())
        return [PutResult(Outcome.STALE, late[index]) if index in late else next(kept) for index in range(len(puts))]

    def _looked_over(self, puts: Sequence[Put], results: list[PutResult]) -> list[PutResult]:
        for put, result in zip(puts, results, strict=True):
            self.noticed.judged(put, result)
        return results

    async def remove(self, versions: Sequence[tuple[Spot, bytes]]) -> int:
        """Delete exactly the versions with these digests, and say how many were there. Durable on return."""
        return await self._writer.submit(RemoveRecords(list(versions)))

    async def discard(self, spots: Sequence[Spot]) -> int:
        """Delete the records there that have changed on the disk; sound ones stay. For what nobody can be given."""
        discarded = await self._writer.submit(DiscardDamaged(list(spots)))
        self.noticed.gone(spots)
        return discarded

    async def slide(self, parts: Sequence[Arc], limit: int = SLIDE_BATCH) -> int:
        """Put up to `limit` node-managed records into the part that their home is in; 0 once all are in theirs."""
        return await self._writer.submit(SlideObjects(tuple(parts), limit))

    async def parted(self, piece: Arc) -> int:
        """How many node-managed records of this node's arc lie in the piece and have their home elsewhere in it, or the other way about."""
        return await self._view(walking.parted, piece)

    async def beside(self, rightful: Rightful) -> int:
        """How many node-managed records lie in this node's arc, have their homes elsewhere, and are by right on this node all the same."""
        return await self._view(walking.beside, rightful)

    async def misplaced(self, rightful: Rightful, limit: int) -> list[Entry]:
        """Node-managed records that lie where records lie by right, though their homes do not, at most `limit`."""
        return await self._view(walking.misplaced, rightful, limit)

    async def get_many(self, places: Sequence[RecordPlace]) -> list[Record | None]:
        """The records at these places, None where there is none. DamagedData if one is not what was stored."""
        records: list[Record | None] = []
        for found in await self.read([Spot(place) for place in places]):
            if isinstance(found, DamagedData):
                raise found
            records.append(found)
        return records

    async def read(self, spots: Sequence[Spot]) -> list[Record | DamagedData | None]:
        """Like `get_many`, of node-managed records too; each damaged one is an error in its place."""
        records: list[Record | DamagedData | None] = []
        for start in range(0, len(spots), STORE_READ_BATCH_MAX):
            records += await self._view(reading.read_records, spots[start : start + STORE_READ_BATCH_MAX])
        for spot, found in zip(spots, records, strict=True):
            if isinstance(found, DamagedData):
                self.noticed.read(spot, found.what)
        return records

    async def digests(self, spots: Sequence[Spot]) -> list[bytes | None]:
        """Which versions lie here, without their bytes; None for nothing, or nothing sound."""
        found: list[bytes | None] = []
        for start in range(0, len(spots), STORE_READ_BATCH_MAX):
            found += await self._view(reading.read_digests, spots[start : start + STORE_READ_BATCH_MAX])
        return found

    async def record_headers(self, spots: Sequence[Spot]) -> list[bytes | None]:
        """Which versions there are, of objects wherever they lie: some 5 us each. None for nothing, or a header that has rotted."""
        found: list[bytes | None] = []
        for start in range(0, len(spots), STORE_READ_BATCH_MAX):
            found += await self._view(reading.read_record_headers, spots[start : start + STORE_READ_BATCH_MAX])
        return found

    async def range(self, scene: SceneId, space: SpaceId, arc: Arc, limit: int) -> RangeAnswer:
        """At most `limit` >= 1 locations of records in the arc, from its first on."""
        assert limit >= 1
        return await self._view(reading.read_range, scene, space, arc, limit)

    # ---------------------------------------------------------------------------------------- pieces of the line

    async def manifest(self, where: Arc | Sequence[Arc], after: bytes | None, limit: int) -> Manifest:
        """The first `limit` records there behind the cursor `after`, over all spaces, without their bytes.

        Several arcs are ascending, and apart from each other. Some 6 us a record.
        """
        return await self._view(walking.manifest, [where] if isinstance(where, Arc) else where, after, limit)

    async def strays(self, rightful: Rightful, after: bytes | None, limit: int) -> Manifest:
        """Likewise the records that lie elsewhere than by right."""
        return await self._view(walking.strays, rightful, after, limit)

    async def weigh(self, arc: Arc, bytes_wanted: int, *, from_right: bool) -> Weighed:
        """How far from one side of the arc `bytes_wanted` reach, at least."""
        return await self._view(walking.weigh, arc, bytes_wanted, from_right=from_right)

    async def arc_totals(self, arc: Arc) -> Counts:
        """Records and bytes in the arc, counted: some 2 us a record."""
        return await self._view(walking.totals, arc)

    async def holding(self) -> StoredHolding | None:
        """What the line kept last; None if it never did."""
        return await self._view(read_holding)

    async def put_holding(self, arc: Arc | None, note: bytes, copies: bytes | None = None) -> None:
        """Keep the arc that puts are checked against, the line's note and that about copies, in one transaction. Durable on return.

        `copies`: None leaves it as it is. Refused once the identity was renewed: whoever holds this store is of the life before, and a new one opens it anew.
        """
        await self._writer.submit(PutHolding(self.opened_as, arc, note, copies))

    async def renew_identity(self) -> StoreIdentity:
        """Become a newcomer: a new incarnation that holds nothing until the store is opened anew.

        Records stay, as those of a former life; the boot counter goes on.
        """
        incarnation = self._entropy.token(INCARNATION_BYTES)
        await self._writer.submit(RenewIdentity(incarnation))
        self.identity = replace(self.identity, incarnation=incarnation)
        return self.identity

    # ------------------------------------------------------------------------------------------ headers and notes

    async def put_header(self, scene: SceneId, header: bytes) -> None:
        """Keep a scene's public header, already verified. Refused if the disk is full."""
        await self._writer.submit(PutValue(HEADERS, scene_key(scene), header))

    async def put_scene_log(self, scene: SceneId, header: bytes, private: bytes) -> None:
        """Keep a scene's public header and its sealed log in one transaction: they are of the same position, always."""
        values = PutValue(HEADERS, scene_key(scene), header), PutValue(NOTES, log_note(scene), private)
        await self._writer.submit(PutValues(values))

    async def get_scene_log(self, scene: SceneId) -> bytes | None:
        """The sealed log, if this node keeps it."""
        return await self._view(reading.read_value, NOTES, log_note(scene))

    async def get_header(self, scene: SceneId) -> bytes | None:
        return await self._view(reading.read_value, HEADERS, scene_key(scene))

    async def headers(self) -> dict[SceneId, bytes]:
        return await self._view(reading.read_headers)

    async def put_note(self, name: str, value: bytes) -> None:
        """Keep a small value of a service (a bound, a counter) durably under a name. Refused if the disk is full."""
        await self._writer.submit(PutValue(NOTES, name.encode(), value))

    async def put_notes(self, notes: Mapping[str, bytes]) -> None:
        """Likewise several that belong together: all of them, or none."""
        await self._writer.submit(PutValues(tuple(PutValue(NOTES, name.encode(), value) for name, value in notes.items())))

    async def get_note(self, name: str) -> bytes | None:
        return await self._view(reading.read_value, NOTES, name.encode())

    # ------------------------------------------------------------------------------------------------- statistics

    @property
    def record_count(self) -> int:
        """Records as of the last commit, without a look at the disk."""
        return sum(counts.records for counts in self._writer.counts.values())

    async def statistics(self) -> StoreStatistics:
        """Counts as of the last commit, and the disk's fill."""
        space = await self._workers.run("store-read", self._environment.space)
        spaces = {address: counts for address, counts in self._writer.counts.items() if counts.records}
        total = sum(spaces.values(), Counts())
        disk_bytes = space.used + max(0, room_beside(space, self._writer.reserve_bytes))
        return StoreStatistics(total.records, total.bytes, spaces, space.used, disk_bytes)


def _with_headers(puts: Sequence[Put]) -> list[tuple[RecordHeader, Put]]:
    """A header that does not parse is its caller's trouble, and must not reach a batch that others share."""
    return [(put.record.header, put) for put in puts]


def _owed(puts: Sequence[Put], debtors: Sequence[Sequence[NodeId]]) -> Sequence[Put]:
    return [replace(put, debtors=tuple(nodes)) for put, nodes in zip(puts, debtors, strict=True)] if debtors else puts


@asynccontextmanager
async def open_store(world: World, folder: Path, node_id: NodeId, *, reserve_bytes: int = STORE_RESERVE_BYTES) -> AsyncIterator[Store]:
    """Open (or begin) the store of a node in a folder that no other process has open. LocalFault if it cannot be."""
    workers = world.workers
    environment = SealedEnvironment(await workers.run("store", world.disk.open, folder, TABLES), str(folder))
    try:
        await workers.run("store", environment.seal_older)
        incarnation = world.entropy.token(INCARNATION_BYTES)
        identity = await workers.run("store", claim, environment, str(folder), node_id, incarnation)
        writer = GroupWriter(workers, environment, reserve_bytes)
        writer.counts = await workers.run("store", in_view, environment, read_counts)
        writer.owed = await workers.run("store", in_view, environment, read_owed)
        if await workers.run("store", in_view, environment, has_unbuilt):
            writer.unbuilt.set()
        try:
            async with background_tasks() as nursery:
                nursery.start_soon(writer.run)
                nursery.start_soon(keep_building, writer)
                yield Store(world, environment, identity, writer)
        except BaseExceptionGroup:
            # Who read the damage and who hears that the store is closing end with it: that is one error, not many.
            if writer.damage is None:
                raise
            raise writer.damage from None
    finally:
        with trio.CancelScope(shield=True):
            await workers.run("store", environment.close)
