"""If it fails, readers of an adopted place wait longer than they must (specs/20-copies.md, Recovery)."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.peer.line import Line
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.replication.heirs import Estate, Heir, spread
from unit.peer.replication.terrace import Home

pytestmark = pytest.mark.usefixtures("only_errors")


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
