"""`Watch`: a cluster looked at again and again, at a steady pace, whoever is silent.

All nodes are asked at once, and one look waits for nobody longer than ANSWER_S: who has not answered by then is shown with
what it said last, and how long ago that was. A table that does not come in time is that of the look before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.limits import CLIENT_ASKED_MAX, CLIENT_STATUS_S
from scenefold.client.calls import no_answer
from scenefold.client.cluster import Cluster
from scenefold.client.health import ClusterStatus, NodeState, judged
from scenefold.client.hedging import first_answer
from scenefold.client.reports import NodeReport
from scenefold.wire import RequestTable, RespondTable
from scenefold.world import Priority

ANSWER_S = 0.8
"""For which one look waits for an answer: a second passes between two looks."""
_NEXT_S = 0.2
"""Silence after which another node is asked for the table as well."""


class Watch:
    """Made for one cluster; `look` as often as wanted, one after the other."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._calls = cluster.calls
        self._table: RespondTable | None = None
        self._last: dict[str, tuple[NodeReport, float]] = {}
        self._silent: set[str] = set()

    async def look(self) -> ClusterStatus:
        """One look. Unreachable at the first one, if no node gives a table."""
        table = self._table
        if table is None:
            table = self._table = await self._ask_table(CLIENT_STATUS_S)
        line = self._cluster.line_of(table)
        reports: dict[str, NodeReport | ScenefoldError] = {}

        async def ask_all() -> None:
            reports.update(await self._cluster.reports([address for _, address in line], timeout_s=ANSWER_S))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(ask_all)
            nursery.start_soon(self._renew_table)
        now = self._calls.world.clock.now()
        on_line = {address for _, address in line}
        self._last = {address: known for address, known in self._last.items() if address in on_line}
        self._last |= {address: (report, now) for address, report in reports.items() if isinstance(report, NodeReport)}
        self._silent = {address for address, report in reports.items() if not isinstance(report, NodeReport)}
        asked, nodes = self._cluster.states(table, reports)
        return judged(self._cluster.name, asked, [self._with_last(node, now) for node in nodes])

    def _with_last(self, node: NodeState, now: float) -> NodeState:
        if node.alive or node.address not in self._last:
            return node
        report, said_at = self._last[node.address]
        return replace(node, last=report, last_s=now - said_at)

    async def _renew_table(self) -> None:
        """For the next look: this one knows already whom it asks."""
        with trio.move_on_after(ANSWER_S):
            try:
                self._table = await self._ask_table(ANSWER_S)
            except (Unreachable, Refused, PeerFault):
                return  # the reports say who is silent

    async def _ask_table(self, timeout_s: float) -> RespondTable:
        addresses = self._in_order()
        tries = [
            partial(self._calls.ask, address, RequestTable(), RespondTable, priority=Priority.HIGH, timeout_s=timeout_s)
            for address in addresses
        ]
        try:
            return await first_answer(tries, next_after_s=_NEXT_S, at_a_time=CLIENT_ASKED_MAX, refusal_counts=False)
        except Unreachable as error:
            raise no_answer(addresses, error) from error

    def _in_order(self) -> Sequence[str]:
        """Who answered last time before who did not; at first, whoever owns something before spares."""
        if self._table is None:
            owners = sorted(self._calls.table.owners, key=lambda owner: owner.right_bound is None)
            return [owner.address for owner in owners]
        return sorted((address for _, address in self._cluster.line_of(self._table)), key=lambda address: address in self._silent)
