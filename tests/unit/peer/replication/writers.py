"""A terrace on which nothing but writing goes on by itself: who holds what is said here, and true at once.

Whatever is acknowledged is looked for on all disks at that very moment.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import trio

from scenefold.base.location import Location
from scenefold.crypto import Record
from scenefold.peer.copies.configurations import Configurations, Word
from scenefold.peer.copies.telling import told_entry
from scenefold.peer.line import Line
from scenefold.store import Spot
from scenefold.store.layout import DEBTS, RECORDS, record_key, spot_of, stored_header
from scenefold.wire import CustodySet, PutItem, PutMany, PutOutcome, SetCustody
from scenefold.world import Priority, World
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import THIRDS, Home, Terrace, record_at

NEEDED = 2


class Writer(Home):
    def others(self, world: World, line: Line) -> list[Any]:
        _, data = super().others(world, line)
        return [SimpleNamespace(register=self.replication.register, run=self.replication.spreading.run), data]

    def has(self, record: Record) -> bool:
        """Whether this very record, or a newer one, lies on its disk now."""
        header = record.header
        value = self.street.net.machine(self.address).disk.peek(RECORDS).get(record_key(self.spot(header.location, header.space).place))
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

    def places(self, count: int) -> list[Location]:
        arc = self.owner.living.arc
        assert arc is not None
        return places(arc, count)

    async def hold(self, *holders: int, needed: int = NEEDED) -> None:
        """These hold copies of all that the owner has from now on, and know it."""
        await self.place(*holders, needed=needed)
        await self.tell()
        await self.change(_compared)
        await self.change(lambda found: found.activate(lambda _: ()))
        await self.tell()

    async def place(self, *holders: int, needed: int = NEEDED) -> None:
        members = tuple(self.homes[number].member for number in holders)
        await self.change(lambda found: found.place(THIRDS, [(self.owner.living.arc, members)], needed))  # type: ignore[list-item]

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
                assert self.copies_of(record) >= NEEDED, "acknowledged, and not on enough disks"
                self.acknowledged.append(record)
        return outcomes

    def copies_of(self, record: Record) -> int:
        return sum(home.has(record) for home in self.homes)

    def next_at(self, place: Location) -> Record:
        self._seq += 1
        return record_at(place, self._seq)


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


def _compared(found: Configurations) -> Configurations:
    for segment in found.segments:
        for holder in segment.holders(found.me):
            entry = segment.wanted(holder, found.me)
            assert entry is not None
            found = found.compare(holder, entry)
    return found


def _address(row: Row, word: Word) -> str:
    return next(home.address for home in row.homes if home.node == word.holder.node)
