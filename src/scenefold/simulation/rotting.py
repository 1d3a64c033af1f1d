"""A bit of what a store keeps beside its records turns over: rarely, on one node a storm, and never on the voter, whose disk has the
only copy of the cluster's log (specs/17-simulation.md, Faults).

The node must notice, at the latest when it starts again, and stop; its supervisor then wipes the disk (cluster.py).
"""

from __future__ import annotations

import trio

from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.senate import is_voter
from scenefold.store.sealing import SEALED
from scenefold.world.sim import dice

ODDS = 0.25
"""Of a corrupted page to be one of these, too, if none was before."""
UNNOTICED_S = 6.0
"""A node that has not met the damage by then is started again."""


class TableRot:
    """At most once in a run."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._dice = dice(cluster.net.seed, "rot of tables")
        self._has_struck = False

    def strike(self, node: Node) -> bool:
        """Turn a bit over, if the dice say so; whether it did."""
        if self._dice.random() >= ODDS or self._has_struck or is_voter(self._cluster, node):
            return False
        filled = [table for table in SEALED if node.disk.peek(table)]
        if not filled:
            return False
        table = self._dice.choice(filled)
        key = node.disk.corrupt(table, self._dice)
        assert key is not None
        self._has_struck = node.has_rotted = True
        self._cluster.watch.tell(node.slot, "has a bit turned over in the table {}, {}", table, key)
        self._cluster.watch.counts["tables damaged"] += 1
        return True

    async def until_noticed(self, node: Node) -> None:
        """Start the node again if it goes on as if nothing was."""
        await trio.sleep(UNNOTICED_S)
        if is_rotten(node) and self._cluster.crash(node.slot):
            await self._cluster.restart(node.slot, 0.5)


def is_rotten(node: Node) -> bool:
    """Whether the damage is still there."""
    return any(node.disk.rotten(table) for table in SEALED)
