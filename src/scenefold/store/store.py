"""The node's store: records on the line, durable before they are acknowledged (specs/10-store.md).

Writes go through the group writer; reads run in threads of their own on LMDB's unchanging views, and never wait for a
write. Records must have been verified before they come here.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import trio

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import STORE_READ_BATCH_MAX, STORE_RESERVE_BYTES
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record, RecordPlace
from scenefold.store.changes import PutRecords, PutValue
from scenefold.store.identity import INCARNATION_BYTES, StoreIdentity, claim
from scenefold.store.judging import Put, PutResult
from scenefold.store.layout import (
    HEADERS,
    NOTES,
    RECORDS,
    TABLES,
    location_of,
    record_key,
    scene_key,
    scene_of,
    unpack_record,
)
from scenefold.store.statistics import Counts, StoreStatistics, read_counts
from scenefold.store.writer import GroupWriter
from scenefold.world.ports import Environment, World
from scenefold.world.tasks import background_tasks


@dataclass(frozen=True, slots=True)
class RangeAnswer:
    """Locations in order. `covered` is the part of the arc that they are all of; all of it if `complete`."""

    locations: list[Location]
    covered: Arc
    complete: bool


class Store:
    """An open store; made by `open_store`."""

    def __init__(self, world: World, environment: Environment, identity: StoreIdentity, writer: GroupWriter) -> None:
        self._workers = world.workers
        self._environment = environment
        self._writer = writer
        self.identity = identity

    @property
    def commits(self) -> int:
        """Synced transactions since the store was opened; fewer than puts where they shared one."""
        return self._writer.commits

    async def put(self, puts: Sequence[Put]) -> list[PutResult]:
        """Store verified records; results in their order. Returns once what is STORED is durable."""
        # A header that does not parse is its caller's trouble, and must not reach a batch that others share.
        return await self._writer.submit(PutRecords([(put.record.header, put) for put in puts]))

    async def get_many(self, places: Sequence[RecordPlace]) -> list[Record | None]:
        """The records at these places, None where there is none. DamagedData if one cannot be read."""
        records: list[Record | None] = []
        for start in range(0, len(places), STORE_READ_BATCH_MAX):
            batch = places[start : start + STORE_READ_BATCH_MAX]
            records += await self._workers.run("store-read", _read_records, self._environment, batch)
        return records

    async def range(self, scene: SceneId, space: SpaceId, arc: Arc, limit: int) -> RangeAnswer:
        """At most `limit` >= 1 locations of records in the arc, from its first on."""
        assert limit >= 1
        return await self._workers.run("store-read", _read_range, self._environment, scene, space, arc, limit)

    async def put_header(self, scene: SceneId, header: bytes) -> None:
        """Keep a scene's public header, already verified. Refused if the disk is full."""
        await self._writer.submit(PutValue(HEADERS, scene_key(scene), header))

    async def get_header(self, scene: SceneId) -> bytes | None:
        return await self._workers.run("store-read", _read_value, self._environment, HEADERS, scene_key(scene))

    async def headers(self) -> dict[SceneId, bytes]:
        return await self._workers.run("store-read", _read_headers, self._environment)

    async def put_note(self, name: str, value: bytes) -> None:
        """Keep a small value of a service (a bound, a counter) durably under a name. Refused if the disk is full."""
        await self._writer.submit(PutValue(NOTES, name.encode(), value))

    async def get_note(self, name: str) -> bytes | None:
        return await self._workers.run("store-read", _read_value, self._environment, NOTES, name.encode())

    @property
    def record_count(self) -> int:
        """Records as of the last commit, without a look at the disk."""
        return sum(counts.records for counts in self._writer.counts.values())

    async def statistics(self) -> StoreStatistics:
        """Counts as of the last commit, and the disk's fill."""
        space = await self._workers.run("store-read", self._environment.space)
        spaces = {address: counts for address, counts in self._writer.counts.items() if counts.records}
        total = sum(spaces.values(), Counts())
        # What the store could take: what it has, plus what is free. The rest of the disk is others'.
        disk_bytes = space.used + space.reusable + space.free
        return StoreStatistics(total.records, total.bytes, spaces, space.used, disk_bytes)


@asynccontextmanager
async def open_store(world: World, folder: Path, node_id: NodeId, *, reserve_bytes: int = STORE_RESERVE_BYTES) -> AsyncIterator[Store]:
    """Open (or begin) the store of a node in a folder that no other process has open. LocalFault if it cannot be."""
    workers = world.workers
    environment = await workers.run("store", world.disk.open, folder, TABLES)
    try:
        incarnation = world.entropy.token(INCARNATION_BYTES)
        identity = await workers.run("store", claim, environment, str(folder), node_id, incarnation)
        writer = GroupWriter(workers, environment, reserve_bytes)
        writer.counts = await workers.run("store", _read_counts, environment)
        async with background_tasks() as nursery:
            nursery.start_soon(writer.run)
            yield Store(world, environment, identity, writer)
    finally:
        with trio.CancelScope(shield=True):
            await workers.run("store", environment.close)


def _read_records(environment: Environment, places: Sequence[RecordPlace]) -> list[Record | None]:
    with environment.read() as transaction:
        values = (transaction.get(RECORDS, record_key(place)) for place in places)
        return [unpack_record(value) if value is not None else None for value in values]


def _read_range(environment: Environment, scene: SceneId, space: SpaceId, arc: Arc, limit: int) -> RangeAnswer:
    first, last = (record_key(RecordPlace(scene, space, place)) for place in (arc.first, arc.last))
    locations: list[Location] = []
    with environment.read() as transaction:
        for key in transaction.keys(RECORDS, first, last):
            if len(locations) == limit:
                return RangeAnswer(locations, Arc(arc.first, locations[-1]), complete=False)
            locations.append(location_of(key))
    return RangeAnswer(locations, arc, complete=True)


def _read_value(environment: Environment, table: str, key: bytes) -> bytes | None:
    with environment.read() as transaction:
        value = transaction.get(table, key)
        return bytes(value) if value is not None else None


def _read_headers(environment: Environment) -> dict[SceneId, bytes]:
    with environment.read() as transaction:
        rows = transaction.scan(HEADERS, b"", b"\xff" * 4)
        return {scene_of(key): bytes(value) for key, value in rows}


def _read_counts(environment: Environment) -> dict[tuple[SceneId, SpaceId], Counts]:
    with environment.read() as transaction:
        return read_counts(transaction)
