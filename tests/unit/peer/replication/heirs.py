"""A terrace on which nothing about copies goes on by itself but recovery. What is acknowledged is said here, and where it lies."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from types import SimpleNamespace
from typing import Any

import trio

from scenefold.base.ids import SpaceId
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record, object_of, wanted_place
from scenefold.peer.copies.versions import told_version
from scenefold.peer.handlers import Senders
from scenefold.peer.line import Line
from scenefold.store import Outcome, Put
from scenefold.wire import (
    FetchHeld,
    HandItem,
    HeldFetched,
    HeldListed,
    HeldRecord,
    ListHeld,
    Packet,
    PutItem,
    QueryRange,
    RecordKey,
    RejectRange,
    ReturnRange,
)
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.holders import arc_of, entry, tell
from unit.peer.replication.terrace import HEADER, THRICE, Home, Terrace, record_at

ADOPTED_S = 60.0
"""More than a dead node's leases last, and for what follows."""


class Heir(Home):
    def others(self, world: World, line: Line) -> list[Any]:
        _, *others = super().others(world, line)
        return [SimpleNamespace(register=self.replication.register, run=self.replication.recovering.run), *others]

    @property
    def noted(self) -> list[dict[str, Any]]:
        """What it says may be lost."""
        return self.replication.noting.documents()

    @property
    def gaps(self) -> tuple[Arc, ...]:
        return self.durable_copies().unrecovered

    async def keep(self, *records: Record) -> None:
        """Have these on the disk, by whatever right."""
        results = await self.store.merge([Put(record) for record in records])
        assert all(result.outcome is Outcome.STORED for result in results)

    async def keep_objects(self, *records: Record) -> None:
        results = await self.store.merge([Put(record, at=wanted_place(object_of(record.header))) for record in records])
        assert all(result.outcome is Outcome.STORED for result in results)

    async def write(self, record: Record) -> int:
        """Why a client's record is not taken; 0 if it is."""
        header = record.header
        item = PutItem(header.scene, header.space, header.location, record.signature, record.header_bytes, record.ciphertext)
        (outcome,) = await self.data.writes.put([item])
        return int(outcome.reason)

    async def listed(self, arc: Arc, space: SpaceId) -> ReturnRange | RejectRange:
        return await self.data.ranges.answer(QueryRange(HEADER.scene, space, arc.first, arc.last))

    async def read(self, location: Location, space: SpaceId = THRICE) -> tuple[int | None, bool]:
        """The sequence number of what it tells of a place, and whether that may be stale. Refused if it tells nothing."""
        found = await self.data.reads.get(HEADER.scene, [RecordKey(space, location, b"")], 0, forward=False)
        (record,) = found.records
        return None if record is None else Record(record.header, record.signature, record.ciphertext).header.seq, found.stale


class Lies:
    """What a node says instead of what it has. Each page names the same, and `follows`, if anything does."""

    def __init__(self, home: Home) -> None:
        self.names: list[HeldRecord] = []
        self.hands: list[HandItem] = []
        self.follows: bytes | None = None
        home.handlers._table[ListHeld] = self._list, Senders.NODES
        home.handlers._table[FetchHeld] = self._fetch, Senders.NODES

    async def _list(self, packet: ListHeld, _peer: str) -> Packet:
        inside = [held for held in self.names if held.location in Arc(packet.first, packet.last)]
        return HeldListed(0, tuple(inside), (), self.follows)

    async def _fetch(self, packet: FetchHeld, _peer: str) -> Packet:
        handed = self.hands[: len(packet.entries)]
        return HeldFetched(tuple(handed), tuple(range(len(handed), len(packet.entries))))


def held_of(record: Record) -> HeldRecord:
    header = record.header
    return HeldRecord(header.scene, header.space, header.location, b"", told_version(record.header_bytes))


class Estate(Terrace):
    """`homes[0]` is the voter, `homes[1]` is about to die, and `homes[2]` is its heir."""

    homes: list[Any]

    def house(self, number: int) -> Home:
        return Heir(self, number)

    @property
    def owner(self) -> Heir:
        found: Heir = self.homes[1]
        return found

    async def entrust(self, *holders: int, needed: int = 2) -> Arc:
        """These hold copies of all that the owner has, and know it."""
        arc = arc_of(self.owner)
        members = [self.owner.member, *(self.homes[number].member for number in holders)]
        for number in holders:
            assert (await tell(self.owner, self.homes[number], 5, entry(5, arc, members, needed=needed))).reason == 0
        return arc

    async def bury(self, *numbers: int) -> None:
        """They are gone for ever, and the log says so."""
        for number in numbers:
            self.homes[number].stays_down = True
            self.homes[number].crash()
        for number in numbers:
            self.remove(number)
        await trio.sleep(1.0)

    async def adopted(self, arc: Arc) -> Heir:
        """Who owns the arc now."""

        def heir() -> Heir | None:
            own = [home for home in self.homes if home.is_registered() and home.durable() is not None]
            return next((home for home in own if home.durable().owns(arc.first) and home.durable().owns(arc.last)), None)

        await until(lambda: heir() is not None)
        found = heir()
        assert found is not None
        await found.up.wait()
        return found


def spread(arc: Arc, count: int, *, seq: int = 1, space: SpaceId = THRICE) -> list[Record]:
    return [record_at(place, seq, space) for place in places(arc, count)]


def places_of(records: Iterable[Record]) -> set[Location]:
    return {record.header.location for record in records}


async def until(condition: Callable[[], object], seconds: float = ADOPTED_S) -> None:
    with trio.move_on_after(seconds):
        while not condition():  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
            await trio.sleep(0.1)
        return
    raise AssertionError("it did not come to that")


def inherit(story: Callable[[Estate], Awaitable[None]], founders: int = 5, *, seed: int = 1) -> None:
    """Tell a story on an estate."""

    async def main() -> None:
        estate = Estate(founders)
        async with trio.open_nursery() as nursery:
            await estate.begin(nursery)
            await story(estate)
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=500.0, wall_s_max=120.0)
