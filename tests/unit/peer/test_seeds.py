"""If this fails, a node gives up although others of its cluster have spoken to it, or tries on for ever where nobody does and nobody hears of it."""

from __future__ import annotations

from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.peer.membership.seeds import watch_seeds
from unit.peer.logs_made import node

WAIT_S = 30.0


class Silence:
    """Gossip in which no seed speaks."""

    seeds = ("127.0.0.9",)

    def __init__(self, *met: NodeId) -> None:
        self._met = list(met)

    def met(self) -> list[NodeId]:
        return self._met

    async def a_seed_heard(self) -> None:
        await trio.sleep_forever()


async def watched(*met: NodeId, goes_on: bool = False) -> bool:
    """Whether it still tries on long after the time."""
    gossip: Any = Silence(*met)
    with trio.move_on_after(3 * WAIT_S) as scope:
        await watch_seeds(gossip, WAIT_S, lambda: goes_on)
    return scope.cancelled_caught


async def test_whom_others_have_found_neither_warns_nor_gives_up(autojump_clock: MockClock) -> None:
    """A warning would fail this test."""
    assert await watched(node(1))


@pytest.mark.expect_log("no seed answers yet")
async def test_whom_nobody_speaks_to_says_so_and_gives_up(autojump_clock: MockClock) -> None:
    with pytest.raises(Unreachable, match="no seed answered within 30 s"):
        await watched()
    assert trio.current_time() == pytest.approx(WAIT_S)


@pytest.mark.expect_log("no seed answers yet")
async def test_a_seed_that_is_looked_for_goes_on_and_so_does_a_member(autojump_clock: MockClock) -> None:
    assert await watched(goes_on=True)
