"""Which nodes decide the cluster's log, and how an administrator changes that (specs/15-cluster-log.md, Voters)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass

from scenefold.base.errors import ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.client.known_log import KnownLog
from scenefold.client.orders import Orders
from scenefold.client.reports import NodeReport
from scenefold.client.trusted import entry_of
from scenefold.wire import AddParticipant, RemoveParticipant
from scenefold.world import Clock

READY_S_MAX = 15.0
"""A new voter that is there hears what those before granted in a second."""
LOOK_S = 0.2

Reports = Callable[[Sequence[str]], Awaitable[Mapping[str, NodeReport | ScenefoldError]]]
"""What nodes say of themselves, by address; `Cluster.reports`."""


@dataclass(frozen=True, slots=True)
class Council:
    """Who decides the cluster's log, and what they said when they were asked."""

    voters: Sequence[NodeId]
    preparing: Sequence[NodeId] = ()
    """Those that do not grant leases yet. While there is one, none may be lost."""
    silent: Sequence[NodeId] = ()

    @property
    def has_majority(self) -> bool:
        """Whether enough of them answer to decide anything."""
        return len(self.voters) - len(self.silent) > len(self.voters) // 2

    @property
    def may_be_lost(self) -> int:
        """How many more, beside those that do not answer."""
        return 0 if self.preparing else max(0, (len(self.voters) - 1) // 2 - len(self.silent))


class Voters:
    """Of one cluster. `first`: the one that it began with."""

    def __init__(self, log: KnownLog, orders: Orders, first: NodeId, reports: Reports, clock: Clock) -> None:
        self._cluster_log, self._orders, self._first, self._reports, self._clock = log, orders, first, reports, clock

    async def known(self) -> Sequence[NodeId]:
        """Who decides the cluster's log."""
        await self._cluster_log.newest()
        return self._cluster_log.voters

    async def council(self, within_s: float = READY_S_MAX) -> Council:
        """Who decides, and which of them do not grant leases yet, or do not answer, once none of those that answer prepares, or so many
        seconds have passed (specs/26-modes.md, Voters come and go)."""
        position = (await self._cluster_log.newest()).position
        until = self._clock.now() + within_s
        while (found := await self._asked(position)).preparing and self._clock.now() < until:
            await self._clock.sleep(LOOK_S)
        return found

    async def preparing(self, within_s: float = READY_S_MAX) -> Sequence[NodeId]:
        """Which of them do not grant leases yet, as `council` says."""
        return (await self.council(within_s)).preparing

    async def _asked(self, position: int) -> Council:
        voters = self._cluster_log.voters
        if len(voters) == 1:
            return Council(voters)
        reports = await self._reports([address_of(node) for node in voters])
        told = [(node, reports[address_of(node)]) for node in voters]
        late = [node for node, one in told if isinstance(one, NodeReport) and not (one.grants_leases and one.log_position >= position)]
        return Council(voters, late, [node for node, one in told if isinstance(one, Unreachable)])

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
