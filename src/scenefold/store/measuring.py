"""What the store does a second on this disk, for `scenectl bench store` and docs/benchmarks.md.

Writers put records of full size one after another, each waiting until its record is durable; readers fetch them in a
shuffled order. All goes through the store's own calls, so the figures are what a node can offer, without network
and signatures.
"""

from __future__ import annotations

import hashlib
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import trio

from scenefold.base.ids import KeyId, SceneId, SpaceId, node_id_of
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import LOCATION_BYTES, WHOLE_LINE, Location
from scenefold.crypto import EXPECTS_ANYTHING, Record, RecordHeader, RecordPlace
from scenefold.store.judging import Outcome, Put
from scenefold.store.store import Store, open_store
from scenefold.world.ports import Clock, World

_NODE = node_id_of("127.0.0.2")
_MIX = 0x9E3779B97F4A7C15
"""An odd number, so that multiples of it spread the records over the line without meeting again."""


Step = Callable[[], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class Rate:
    """`operations` records a second with `concurrency` callers; `commits` of them a second (0 for reads)."""

    concurrency: int
    operations: float
    commits: float


@dataclass(frozen=True, slots=True)
class StoreRates:
    """Of records with `record_bytes` of ciphertext."""

    record_bytes: int
    writes: tuple[Rate, ...]
    reads: tuple[Rate, ...]


async def measure_store(
    world: World,
    folder: Path,
    *,
    step_s: float = 2.0,
    concurrencies: Sequence[int] = (1, 8, 64),
    record_bytes: int = PAYLOAD_BYTES_MAX,
) -> StoreRates:
    """Measure in an empty folder, which is full of records afterwards: `step_s` seconds for each rate."""
    async with open_store(world, folder, _NODE) as store:
        await store.put_holding(WHOLE_LINE, b"")
        work = _Work(store, world.clock, record_bytes)
        writes = [await work.rate(count, step_s, work.write) for count in concurrencies]
        reads = [await work.rate(count, step_s, work.read) for count in concurrencies]
    return StoreRates(record_bytes, tuple(writes), tuple(reads))


class _Work:
    """Writers and readers that count what they did."""

    def __init__(self, store: Store, clock: Clock, record_bytes: int) -> None:
        self._store = store
        self._clock = clock
        self._ciphertext = bytes(record_bytes)
        self._header = _header(self._ciphertext)
        self._written = 0
        self._done = 0

    async def rate(self, concurrency: int, step_s: float, work: Step) -> Rate:
        commits, self._done, begin = self._store.commits, 0, self._clock.now()
        async with trio.open_nursery() as nursery:
            for _ in range(concurrency):
                nursery.start_soon(self._repeat, work, begin + step_s)
        seconds = self._clock.now() - begin
        return Rate(concurrency, self._done / seconds, (self._store.commits - commits) / seconds)

    async def _repeat(self, work: Step, end: float) -> None:
        while self._clock.now() < end:
            await work()
            self._done += 1

    async def write(self) -> None:
        self._written += 1
        header = self._header._replace(location=_location(self._written))
        [result] = await self._store.put([Put(Record(header.encode(), bytes(64), self._ciphertext))])
        assert result.outcome is Outcome.STORED, "the disk is full"

    async def read(self) -> None:
        number = 1 + self._done * 7919 % self._written
        [record] = await self._store.get_many([RecordPlace(self._header.scene, self._header.space, _location(number))])
        assert record is not None


def _location(number: int) -> Location:
    return Location((number * _MIX % (1 << 64)).to_bytes(8, "big").ljust(LOCATION_BYTES, b"\0"))


def _header(ciphertext: bytes) -> RecordHeader:
    return RecordHeader(
        scene=SceneId(1),
        genesis=bytes(32),
        space=SpaceId(1),
        location=_location(0),
        epoch=0,
        seq=0,
        writer=KeyId(1),
        session=0,
        expects=EXPECTS_ANYTHING,
        content_position=0,
        key_epoch=0,
        nonce=bytes(12),
        length=len(ciphertext),
        digest=hashlib.sha256(ciphertext).digest(),
    )
