"""If this fails, nodes do not agree even while nothing goes wrong."""

from __future__ import annotations

import pytest

from scenefold.consensus import Outcome
from unit.consensus.world import World


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 33])
@pytest.mark.parametrize("where", ["first", "middle", "last"])
def test_01_no_faults(n: int, where: str) -> None:
    """COMMITTED; exactly 5(n - 1) packets; the last of them is there after 4a + 1 hops, a being the longer arm."""
    rank = {"first": 0, "middle": n // 2, "last": n - 1}[where]
    world = World(1, *range(1, n + 1))
    value = world.ask(rank + 1, "it")
    world.run()
    [reply] = world.nodes[rank + 1].replies
    assert (reply.outcome, reply.position, reply.digest) == (Outcome.COMMITTED, 1, value.digest)
    assert world.agree() == ["it"]
    assert len(world.packets) == 5 * (n - 1)
    longest = max(rank, n - 1 - rank)
    if n > 1:
        assert round((max(at for at, *_ in world.packets) + 0.01) / 0.01) == 4 * longest + 1
