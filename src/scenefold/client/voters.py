"""Which nodes decide the cluster's log, and how an administrator changes that (specs/15-cluster-log.md, Voters)."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.client.known_log import KnownLog
from scenefold.client.orders import Orders
from scenefold.client.trusted import entry_of
from scenefold.wire import AddParticipant, RemoveParticipant


class Voters:
    """Of one cluster. `first`: the one that it began with."""

    def __init__(self, log: KnownLog, orders: Orders, first: NodeId) -> None:
        self._cluster_log, self._orders, self._first = log, orders, first

    async def known(self) -> Sequence[NodeId]:
        """Who decides the cluster's log."""
        await self._cluster_log.newest()
        return self._cluster_log.voters

    async def add(self, node: NodeId) -> bool:
        """Have a trusted node decide the cluster's log, too; False if it does already. LocalFault, Refused if it cannot."""
        view, first = await self._cluster_log.newest(), self._first
        if view.voters is not None and view.voters.member_of(node) is not None:
            return False
        entry = entry_of(view, node)
        if view.voters is None:
            # From this record on votes decide; if what follows fails, the cluster has one voter as before.
            begun = entry_of(view, first)
            await self._orders.give(AddParticipant(begun.member, begun.key))
            if node == first:
                return True
        await self._orders.give(AddParticipant(entry.member, entry.key))
        return True

    async def remove(self, node: NodeId) -> bool:
        """Have a node decide the cluster's log no more; False if it does not. Refused if it is the last, or too few are there to decide that."""
        view = await self._cluster_log.newest()
        member = view.on_line(node) if view.voters is None else view.voters.member_of(node)
        if member is None or node not in self._cluster_log.voters:
            return False
        await self._orders.give(RemoveParticipant(member))
        return True
