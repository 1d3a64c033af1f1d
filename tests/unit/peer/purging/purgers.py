"""A row of houses that also purge. `homes[0]` owns what is deleted, the next two hold copies of it, the others hold nothing of it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import SceneId
from scenefold.base.location import Location
from scenefold.crypto import PURGE_DOMAIN, Record, SigningKey, object_of, wanted_place
from scenefold.peer.copies.versions import told_version
from scenefold.peer.line import Line
from scenefold.peer.purging import Purging
from scenefold.peer.records.verification import KnownScene
from scenefold.store.layout import RECORDS, spot_of, stored_header
from scenefold.wire import PurgeItem, PurgeOrder, PurgeRecords, RecordsPurged
from scenefold.world import DiskFailed, World
from scenefold.world.sim import run_simulated
from unit.peer.replication.terrace import HEADER, Home
from unit.peer.replication.writers import Row, Writer, until
from unit.peer.scenes_made import WRITER, later_header

BEGUN = 5
"""Where the log says that purging begins."""
PURGED = later_header(HEADER, position=BEGUN, write_floor=BEGUN, purged=BEGUN)


class Purger(Writer):
    purging: Purging

    def others(self, world: World, line: Line) -> list[Any]:
        others = super().others(world, line)
        self.purging = Purging(line.parts, self.replication.spreading)
        return [*others, SimpleNamespace(register=self.purging.register)]

    def versions(self, place: Location) -> list[int]:
        """The numbers of what lies on its disk with its home there."""
        values = self.street.net.machine(self.address).disk.peek(RECORDS)
        return [stored_header(memoryview(value)).seq for key, value in values.items() if spot_of(key).home == place]


class Yard(Row):
    homes: list[Any]

    def house(self, number: int) -> Home:
        return Purger(self, number)

    def begin_purge(self) -> None:
        """Everybody hears that purging begins."""
        for home in self.homes:
            home.scenes = {HEADER.scene: KnownScene.of(PURGED)}

    async def purge(self, *records: Record, key: SigningKey = WRITER, **changes: Any) -> tuple[int, ...]:
        """Tell the owner that these are deleted; why each is still there, or 0."""
        return (await self.told(order_of(*records, key=key, **changes))).reasons

    async def told(self, order: PurgeOrder) -> RecordsPurged:
        reply: RecordsPurged = await self.owner.asked(PurgeRecords(order))
        return reply

    async def purged(self, *records: Record) -> tuple[int, ...]:
        """As soon as the owner is up; () if it says nothing."""
        await self.awake()
        try:
            return await self.purge(*records)
        except (ScenefoldError, DiskFailed) as problem:
            self.net.note("not purged", problem)
            return ()

    def everywhere(self, place: Location) -> list[list[int]]:
        """What lies on each disk with its home there."""
        return [home.versions(place) for home in self.homes]


def order_of(
    *records: Record, key: SigningKey = WRITER, scene: SceneId = HEADER.scene, position: int = BEGUN, **changes: Any
) -> PurgeOrder:
    """Signed by a writer, unless another signature is given."""
    items = tuple(map(item_of, records))
    unsigned = PurgeOrder(scene, position, key.key_id, items, bytes(64))
    signed = replace(unsigned, signature=key.sign(PURGE_DOMAIN, unsigned.signable(HEADER.genesis)))
    return replace(signed, **changes)


def item_of(record: Record) -> PurgeItem:
    header = record.header
    name = object_of(header)
    return PurgeItem(header.space, wanted_place(name) if name else header.location, name, told_version(record.header_bytes))


def in_a_yard(story: Callable[[Yard], Awaitable[None]], founders: int = 4, *, seed: int = 1, seconds: float = 900.0) -> None:
    async def main() -> None:
        yard = Yard(founders)
        async with trio.open_nursery() as nursery:
            await yard.begin(nursery)
            await story(yard)
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=seconds, wall_s_max=240.0)


async def deleted(yard: Yard, places: Sequence[Location]) -> list[Record]:
    """Records that were written over by others, which are taken for deletions, and lie with everybody that is to have them."""
    await yard.hold(1, 2)
    for place in places:
        await yard.put(yard.next_at(place))
    found = [yard.next_at(place) for place in places]
    for outcome in await yard.put(*found):
        assert outcome.reason == 0
    await until(lambda: not yard.owner.debts() and all(yard.copies_of(record) == 3 for record in found))
    return found
