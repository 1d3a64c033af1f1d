"""If one fails, the arc of a founder that never came belongs to nobody for ever."""

from __future__ import annotations

import pytest
import trio

from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.wire import Member, RemoveNode
from scenefold.world.sim import run_simulated
from unit.peer.line.street import Street


@pytest.mark.expect_log("had no owner any more")
@pytest.mark.parametrize("absent", [1, 2])
def test_a_founder_that_never_registered_is_removed_and_its_neighbour_takes_its_arc(absent: int) -> None:
    async def main() -> None:
        street = Street(3)
        missing = street.houses.pop(absent)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            # The others have looked for gaps, and found none, long before.
            await trio.sleep(60.0)
            street.log.say(RemoveNode(Member(missing.node, NO_INCARNATION), "it never came"))
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
