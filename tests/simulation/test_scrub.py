"""If this failed, what rots on the disk of a node that runs would be found by whoever needs it, once nobody has it any more."""

from __future__ import annotations

from random import Random

import pytest
import trio

from scenefold.peer.scrub.pace import REST_S
from scenefold.peer.scrub.scrub import START_S
from scenefold.store import Spot
from scenefold.store.layout import RECORDS, record_key
from scenefold.world.sim import SimNet, run_simulated
from simulation.studio import Studio
from unit.store.samples import place, put


@pytest.mark.expect_log("changed on the disk")
def test_a_node_finds_what_has_rotted_tells_of_it_and_goes_on_after_a_restart() -> None:
    async def main(net: SimNet) -> None:
        async with trio.open_nursery() as nursery:
            studio = Studio(net, 1, nursery)
            await studio.start(0)
            await studio.joined()
            heard: list[Spot] = []
            studio.of(0).scrub.on_rotten = heard.extend
            await studio.of(0).store.put([put(number << 140, size=6_000) for number in range(100)])
            rotten = place(70 << 140)
            assert studio.nodes[0].disk.corrupt(RECORDS, Random(1), record_key(rotten)) is not None
            await trio.sleep(START_S / 2)
            assert studio.of(0).store.damaged == 0
            await trio.sleep(START_S / 2 + REST_S)
            assert heard == [Spot(rotten)]
            assert studio.of(0).store.damaged == 1
            told = studio.of(0).scrub.progress(600_000).document()
            assert (told["round"], told["rotten_before"]) == (2, 1)
            studio.stop(0)
            await studio.start(0)
            await trio.sleep(START_S + 1)
            assert studio.of(0).scrub.progress(600_000).round >= 2, "the note says so"
            nursery.cancel_scope.cancel()

    async def play() -> None:
        await main(SimNet(3))

    run_simulated(3, play)
