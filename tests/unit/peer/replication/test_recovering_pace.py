"""If one fails, readers of an adopted place wait longer than they must, or recovery keeps nodes from all else (specs/20-copies.md, Recovery)."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.peer.line import Line
from scenefold.peer.replication import recovering_hearing
from scenefold.wire import FetchHeld, Packet
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.replication.heirs import Estate, Heir, inherit, places_of, spread, until
from unit.peer.replication.holders import arc_of
from unit.peer.replication.terrace import Home
from unit.peer.scenes_made import SPACE

pytestmark = pytest.mark.usefixtures("only_errors")


def test_records_flow_in_parts_of_what_may_be_moved_in_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame full of them at a time keeps two nodes from all else for as long as it takes to send and to verify it."""
    monkeypatch.setattr(recovering_hearing, "FETCH_BYTES_MIN", 2_000)

    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, teller = estate.homes[2], estate.homes[3]
        records = spread(arc, 40, space=SPACE)
        await teller.keep(*records)
        heir.living.parts.budget.bytes_per_s = 8_000
        asked = list[int]()
        fetch, senders = teller.handlers._table[FetchHeld]

        async def fetched(packet: FetchHeld, peer: str) -> Packet:
            asked.append(len(packet.entries))
            answer: Packet = await fetch(packet, peer)
            return answer

        teller.handlers._table[FetchHeld] = fetched, senders
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps, 200.0)
        assert heir.places(SPACE) >= places_of(records)
        # How large they are is not known at first: one may be as large as any.
        size = sum(len(record.ciphertext) + len(record.header_bytes) + len(record.signature) for record in records) / len(records)
        assert asked[0] == 1 and sum(asked) == len(records)
        assert max(asked) * size <= 2_000 < (max(asked) + 1) * size

    inherit(story)


class Busy(Heir):
    """One that also places, tells, compares and judges, as nodes do."""

    def others(self, world: World, line: Line) -> list[Any]:
        _, *others = super().others(world, line)
        return [self.replication, *others]


class Whole(Estate):
    def house(self, number: int) -> Home:
        return Busy(self, number)


@pytest.mark.parametrize("seed", range(4))
def test_soon_after_it_is_recovered_a_place_is_told_without_doubt(seed: int) -> None:
    """Its former holders answer for it no more from then on: whoever reads it waits for its owner."""

    async def main() -> None:
        estate = Whole(5)
        async with trio.open_nursery() as nursery:
            await estate.begin(nursery)
            arc = await estate.entrust(2, 3)
            records = spread(arc, 60)
            for number in (2, 3):
                await estate.homes[number].keep(*records)
            await estate.bury(1)
            heir = await estate.adopted(arc)
            while heir.gaps:  # noqa: ASYNC110 - the disk tells nobody when it changes
                await trio.sleep(0.01)
            begin = trio.current_time()
            assert await heir.read(records[0].header.location) == (1, False)
            assert trio.current_time() - begin < 0.3
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=500.0, wall_s_max=120.0)
