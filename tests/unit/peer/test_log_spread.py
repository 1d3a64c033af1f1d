"""If one fails, a node that ends while it decides something calls that a bug."""

from __future__ import annotations

from typing import Any

import trio

from scenefold.base.ids import NodeId
from scenefold.peer.cluster_log.log_spread import LogPusher
from scenefold.world.sim import run_simulated


class Nobody:
    async def tell(self, *_arguments: Any) -> None:
        raise AssertionError("nothing is told once the node has ended")


def test_what_is_decided_as_a_node_ends_is_told_to_nobody() -> None:
    async def main() -> None:
        clock: Any = None
        peers: Any = Nobody()
        part: Any = None
        pusher = LogPusher(clock, peers, lambda: 1, part)
        async with trio.open_nursery() as nursery:
            await nursery.start(pusher.run)
            nursery.cancel_scope.cancel()
        pusher.wake([NodeId(1)])

    run_simulated(1, main)
