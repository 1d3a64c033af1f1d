"""If this fails, a node that says it owns what is another's keeps people from what that one holds.

Whole nodes at rest, of which the second begins to tell that its arc goes to the end of the line, which is the third's.
"""

from __future__ import annotations

import pytest
import trio

from scenefold.base.location import LAST, Arc
from scenefold.scene.layout import META
from scenefold.simulation.asking import ANSWER_S, Asker
from scenefold.simulation.disks import arc_of
from scenefold.world import open_links
from simulation.quiet import Rest, at_rest

LIAR, VICTIM, THIRD = 1, 2, 0
SOON_S = 6.0


def tell_lies(rest: Rest, positions_ahead: int) -> None:
    node = rest.cluster.nodes[LIAR]
    arc = arc_of(node.disk)
    assert arc is not None and node.context is not None
    node.context.own.arc = Arc(arc.first, LAST)
    node.context.own.log_position += positions_ahead


@pytest.mark.parametrize("positions_ahead", [0, 1, 1000])
def test_a_false_claim_costs_a_round_trip(positions_ahead: int) -> None:
    async def look(rest: Rest) -> None:
        tell_lies(rest, positions_ahead)
        mine = list(rest.places[2 * VICTIM :])
        space = rest.scene.space(META)
        victim, third = (rest.cluster.nodes[slot] for slot in (VICTIM, THIRD))
        assert third.context is not None
        async with open_links(rest.cluster.net.world("user:asker")) as links, trio.open_nursery() as nursery:
            nursery.start_soon(Asker(rest.cluster, links, rest.scene, META, mine).run)
            for _ in range(int(2 * ANSWER_S)):
                await trio.sleep(1.0)
                with trio.fail_after(SOON_S):
                    assert await space.get_many(mine) == [b"quiet"] * len(mine)
                    assert [place async for place in space.query(mine[0], LAST)] == mine
                    await space.put(mine[0], b"quiet")
                candidates = third.context.routing.candidates(mine[0])
                assert victim.node_id in candidates
                assert not positions_ahead or list(candidates) == [victim.node_id], "by a log that nobody has shown"
            nursery.cancel_scope.cancel()
        # The liar itself believes that the places are its own.
        wrong = [violation for violation in rest.cluster.watch.violations if violation.slots[0] != LIAR]
        assert not wrong, wrong

    at_rest(look)
