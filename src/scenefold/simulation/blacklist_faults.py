"""An administrator changes a node's blacklist in the midst of a storm, and takes that back (specs/17-simulation.md, Faults).

A node that is asked may not answer, or not run at all; then it is asked again until the storm is over. What is not taken back by then stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, forbids
from scenefold.simulation.blacklists import blacklist_of
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.faults import Fault
from scenefold.wire import BlacklistChanged, ChangeBlacklist
from scenefold.world import Priority
from scenefold.world.sim import dice

ONE, BLOCK = 0.4, 0.7
"""Of a smaller amount one founder is forbidden, or the block of addresses that it stands in; of a greater one all nodes are."""
BLOCK_BITS = 30
ASK_S_MAX = 5.0
AGAIN_S = 2.0


class BlacklistFaults:
    """Those of a storm. `begins` and `ends` are told of a fault once it takes effect; `is_over` says whether the storm is."""

    def __init__(
        self,
        cluster: Cluster,
        begins: Callable[[Fault], None],
        ends: Callable[[Fault], None],
        is_over: Callable[[], bool],
        clients: Sequence[Client],
    ) -> None:
        self._cluster = cluster
        self._begins = begins
        self._ends = ends
        self._is_over = is_over
        self._clients = clients
        self._dice = dice(cluster.net.seed, "blacklists")

    async def befall(self, fault: Fault) -> None:
        """Make it happen now, and take it back when its time is over."""
        node = self._cluster.nodes[fault.slots[0]]
        prefix = self._prefix(node, fault.amount)
        if not await self._order(node, ChangeBlacklist((prefix,), (), None), until_s=fault.end_s):
            return
        self._begins(fault)
        self._cluster.watch.tell(node.slot, "forbids {}", prefix)
        await trio.sleep_until(fault.end_s)
        if await self._order(node, ChangeBlacklist((), (prefix,), None)):
            self._cluster.watch.tell(node.slot, "does not forbid {} any more", prefix)
            self._ends(fault)

    def _prefix(self, node: Node, amount: float) -> AddressPrefix:
        others = [one for one in self._cluster.founding if one is not node]
        listed = blacklist_of(node.disk)
        other = self._dice.choice([one for one in others if not forbids(listed, one.node_id, owner=node.node_id)] or others)
        bits = ADDRESS_BITS if amount < ONE else BLOCK_BITS if amount < BLOCK else 0
        behind = ADDRESS_BITS - bits
        return AddressPrefix(other.node_id >> behind << behind, bits)

    async def _order(self, node: Node, order: ChangeBlacklist, until_s: float = float("inf")) -> bool:
        """Whether the node has said within this time that it is so. One that does not answer may have done it, too."""
        while not self._is_over() and self._cluster.net.now < until_s:
            try:
                with trio.move_on_after(ASK_S_MAX):
                    await self._clients[0].calls.ask(node.address, order, BlacklistChanged, priority=Priority.HIGH, timeout_s=ASK_S_MAX)
                    return True
            except (Unreachable, PeerFault):
                pass
            except Refused:
                # It was done already, by an order without an answer, or somebody else's.
                listed = blacklist_of(node.disk)
                if not set(order.remove) & set(listed) and set(order.add) <= set(listed):
                    return True
            await trio.sleep(AGAIN_S)
        return False
