"""A terrace on which nothing but writing goes on by itself: who holds what is said here, and true at once.

Whatever is acknowledged is looked for on all disks at that very moment.
"""

from __future__ import annotations

import hashlib
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import Any

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record, RecordHeader, object_of
from scenefold.peer.copies.configurations import Configurations, Word
from scenefold.peer.copies.telling import told_entry
from scenefold.peer.line import Line
from scenefold.peer.line.ends import Side
from scenefold.store import Spot
from scenefold.store.layout import DEBTS, RECORDS, record_key, spot_of, stored_header
from scenefold.wire import (
    CustodySet,
    GetMany,
    GetManyReply,
    PutItem,
    PutMany,
    PutOutcome,
    QueryRange,
    RecordBytes,
    RecordKey,
    ReturnRange,
    SetCustody,
)
from scenefold.world import DiskFailed, Priority, World
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, SCENE, THIRDS, THRICE, Home, Terrace, record_at


class Writer(Home):
    def others(self, world: World, line: Line) -> list[Any]:
        _, *others = super().others(world, line)
        return [SimpleNamespace(register=self.replication.register, run=self.replication.spreading.run), *others]

    def has(self, record: Record) -> bool:
        """Whether this very record, or a newer one, lies on its disk now."""
        header, values = record.header, self.street.net.machine(self.address).disk.peek(RECORDS)
        spot = next((spot for spot in self.spots(header.space) if spot.object == object_of(header)), None)
        if not object_of(header):
            spot = self.spot(header.location, header.space)
        value = None if spot is None else values.get(record_key(*spot))
        return value is not None and stored_header(memoryview(value)).seq >= header.seq

    def debts(self) -> set[Spot]:
        return {spot_of(key) for key in self.street.net.machine(self.address).disk.peek(DEBTS)}


class Row(Terrace):
    """`homes[0]` owns a third of the line, and the others hold copies of it."""

    homes: list[Any]

    def __init__(self, founders: int = 3, **more: Any) -> None:
        super().__init__(founders, **more)
        self.acknowledged: list[Record] = []
        self._seq = 0

    def house(self, number: int) -> Home:
        return Writer(self, number)

    @property
    def owner(self) -> Writer:
        found: Writer = self.homes[0]
        return found

    @property
    def arc(self) -> Arc:
        arc = self.owner.living.arc
        assert arc is not None
        return arc

    def places(self, count: int) -> list[Location]:
        return places(self.arc, count)

    async def hold(self, *holders: int, needed: int = 2) -> None:
        """These hold copies of all that the owner has from now on, and know it."""
        await self.place(*holders, needed=needed)
        await self.tell()
        await self.change(compared)
        await self.change(lambda found: found.activate(lambda _: ()))
        await self.tell()

    async def place(self, *holders: int, needed: int = 2) -> None:
        members = tuple(self.homes[number].member for number in holders)
        await self.change(lambda found: found.place(THIRDS, [(self.arc, members)], needed))

    async def change(self, change: Callable[[Configurations], Configurations]) -> None:
        keeper = self.owner.living.parts.keeper
        await keeper.change_copies(lambda copies, _: replace(copies, configurations=change(copies.configurations)))

    async def tell(self) -> None:
        """Whoever is there hears of its custody."""
        for word in self.owner.copies.configurations.untold():
            if self.net.reaches((self.owner.address, _address(self, word))):
                request = SetCustody(
                    self.owner.member, word.holder, word.number, word.scope.first, word.scope.last, tuple(map(told_entry, word.entries))
                )
                reply = await self.owner.peers.ask(word.holder.node, Priority.LOW, request, CustodySet, 5.0)
                assert reply.reason == 0, reply.text
                await self.change(lambda found, word=word: found.confirm(word))  # type: ignore[misc]

    async def put(self, *records: Record, by: str = "user:maker") -> list[PutOutcome]:
        """Offer records to the owner; whatever it says is done lies on enough disks at this moment."""
        reply = await self.owner.asked(PutMany(tuple(map(offered, records))), by)
        outcomes = list(reply.outcomes)
        for record, outcome in zip(records, outcomes, strict=True):
            if outcome.reason == 0:
                assert self.copies_of(record) >= SCENE.needed[record.header.space], "acknowledged, and not on enough disks"
                self.acknowledged.append(record)
        return outcomes

    async def tried(self, record: Record) -> None:
        """Offer a record to the owner, once it is up; whatever comes of it."""
        await self.awake()
        try:
            await self.put(record)
        except (ScenefoldError, DiskFailed) as problem:
            self.net.note("not put", problem)

    async def awake(self) -> None:
        """Return once all houses are up: one may crash while it starts."""
        await until(lambda: all(home.up.is_set() for home in self.homes))

    @property
    def is_settled(self) -> bool:
        """Whether all houses are up, and the owner may tell of all that it has."""
        return all(home.up.is_set() for home in self.homes) and self.owner.living.parts.unsettled.is_quiet

    async def given(self, side: Side, piece: Arc) -> None:
        """Have the owner give a piece away."""
        await self.owner.living.give(side, piece, why="a test")

    async def read(self, *places: Location) -> GetManyReply:
        keys = tuple(RecordKey(THRICE, place, b"") for place in places)
        reply: GetManyReply = await self.owner.asked(GetMany(HEADER.scene, HEADER.position, keys))
        return reply

    async def listed(self) -> ReturnRange:
        reply: ReturnRange = await self.owner.asked(QueryRange(HEADER.scene, THRICE, self.arc.first, self.arc.last))
        return reply

    def cut_off(self, *holders: int) -> None:
        for number in holders:
            self.net.cut(self.owner.address, self.homes[number].address)

    def mend(self, *holders: int) -> None:
        for number in holders:
            self.net.mend(self.owner.address, self.homes[number].address)

    def copies_of(self, record: Record) -> int:
        return sum(home.has(record) for home in self.homes)

    def next_at(self, place: Location) -> Record:
        self._seq += 1
        return record_at(place, self._seq)


def seq_of(found: RecordBytes | None) -> int:
    return 0 if found is None else RecordHeader.decode(found.header).seq


def as_bytes(record: Record) -> RecordBytes:
    return RecordBytes(record.signature, record.header_bytes, record.ciphertext)


def names() -> Iterator[bytes]:
    """Objects, all over the line."""
    return (hashlib.sha256(b"%d" % number).digest()[:16] for number in count())


def offered(record: Record) -> PutItem:
    header = record.header
    return PutItem(header.scene, header.space, header.location, record.signature, record.header_bytes, record.ciphertext)


def in_a_row(story: Callable[[Row], Awaitable[None]], founders: int = 3, *, seed: int = 1, seconds: float = 500.0, **more: Any) -> None:
    async def main() -> None:
        row = Row(founders, **more)
        async with trio.open_nursery() as nursery:
            await row.begin(nursery)
            await story(row)
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=seconds, wall_s_max=120.0)


async def until(is_so: Callable[[], bool], seconds: float = 60.0) -> None:
    with trio.fail_after(seconds):
        while not is_so():  # noqa: ASYNC110 - disks tell nobody when they change
            await trio.sleep(0.05)


def compared(found: Configurations) -> Configurations:
    for segment in found.segments:
        for holder in segment.holders(found.me):
            entry = segment.wanted(holder, found.me)
            assert entry is not None
            found = found.compare(holder, entry)
    return found


def _address(row: Row, word: Word) -> str:
    return next(home.address for home in row.homes if home.node == word.holder.node)
