"""A newcomer's table at once: RequestTable (39) of a node that has one (specs/11-peers.md, Gossip).

Among a thousand nodes, gossip alone fills a table in some ten minutes, and knocking at each takes two. So whoever
lacks many statuses asks a node that has spoken to it for all of them, another one each time. Every status in the answer
is signed by its author, so it does not matter whom we ask.
"""

from __future__ import annotations

import logging

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.peer.membership.gossip import Gossip
from scenefold.peer.membership.roster import Roster
from scenefold.peer.peers import Peers
from scenefold.wire import RequestTable, RespondTable
from scenefold.world import Priority, World

FEW = 8
"""Statuses that may be lacking before a whole table is asked for: knocking finds so few in a round or two."""
ASK_S_MAX = 10.0
"""For a table of a thousand statuses to arrive."""
AGAIN_S_MIN = 1.0
AGAIN_S_MAX = 300.0
"""Pauses between two tables, each twice the one before: what is lacking for long is dead, and in nobody's table."""

_log = logging.getLogger("scenefold.peer.membership.tables")


class Tables:
    """Fetches tables as long as much of ours is lacking."""

    def __init__(self, world: World, gossip: Gossip, roster: Roster, peers: Peers) -> None:
        self._world = world
        self._gossip = gossip
        self._roster = roster
        self._peers = peers

    async def run(self) -> None:
        """Run until cancelled. Gossip must run."""
        pause_s = AGAIN_S_MIN
        while True:
            await self._gossip.many_unheard(FEW)
            lacking, count = self._roster.unheard_count, self._roster.count
            await self._fetch()
            # While a whole cluster starts, tables are small, and grow by a half and more with each that is taken.
            brought = lacking - self._roster.unheard_count
            has_helped = 2 * brought >= min(lacking, count - lacking)
            pause_s = AGAIN_S_MIN if has_helped else min(pause_s * 2, AGAIN_S_MAX)
            await self._world.clock.sleep(pause_s)

    async def _fetch(self) -> None:
        source = self._choose()
        if source is None:
            return
        try:
            table = await self._peers.ask(source, Priority.HIGH, RequestTable(), RespondTable, ASK_S_MAX)
        except (Unreachable, Refused, PeerFault) as problem:
            _log.info("no table from %s: %s", address_of(source), problem)
            return
        await self._gossip.take_table(table.statuses, source)

    def _choose(self) -> NodeId | None:
        """A member that has spoken to us, by chance: at a cluster's start nobody is to be asked by all."""
        candidates = [node for node in self._gossip.met() if self._roster.is_peer(node)]
        return candidates[int(self._world.entropy.uniform() * len(candidates))] if candidates else None
