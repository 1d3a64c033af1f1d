"""This node's place on the line, as the rest of the node sees it (specs/12-line.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass

import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Arc, Location
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.handlers import Handlers
from scenefold.peer.holdings import Lease, Owners
from scenefold.peer.line.adoption import Adoption
from scenefold.peer.line.budget import Budget
from scenefold.peer.line.claims import Claims
from scenefold.peer.line.ends import Side
from scenefold.peer.line.gaps import Gaps
from scenefold.peer.line.gate import Gate
from scenefold.peer.line.giving import Giving
from scenefold.peer.line.holding import Handover
from scenefold.peer.line.keeper import Keeper
from scenefold.peer.line.parts import Keeping, KnownScenes, Parts
from scenefold.peer.line.receiving import Receiving
from scenefold.peer.line.settling import Settling
from scenefold.peer.line.strays import Strays
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.store import Store
from scenefold.world import World

TRANSFER_BYTES_PER_S = 64 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Remaining:
    """What a node that leaves still has: records and bytes in its arc, handovers, strays at the last look."""

    records: int
    bytes: int
    handovers: int
    strays: int

    @property
    def is_nothing(self) -> bool:
        return not (self.records or self.handovers or self.strays)


class Line:
    """Used from the Trio thread only."""

    def __init__(
        self,
        world: World,
        store: Store,
        peers: Peers,
        cluster_log: ClusterLog,
        own: OwnStatus,
        lease: Lease,
        scenes: KnownScenes,
        routing: Owners,
        claims: Claims,
        gaps: Gaps | None = None,
        *,
        transfer_bytes_per_s: float = TRANSFER_BYTES_PER_S,
    ) -> None:
        self._parts = Parts(
            world,
            store,
            peers,
            cluster_log,
            own,
            lease,
            scenes,
            routing,
            claims,
            Keeper(store, cluster_log, own),
            Gate(),
            Settling(world.clock),
            Budget(world.clock, transfer_bytes_per_s),
            Keeping(store.merge),
        )
        self._giving = Giving(self._parts)
        self._receiving = Receiving(self._parts)
        self._adoption = Adoption(self._parts, gaps, self._giving.give)
        self._strays = Strays(self._parts, lambda: bool(self._receiving.refuses))

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def parts(self) -> Parts:
        """What the services of the line share; those of replication share it too."""
        return self._parts

    @property
    def arc(self) -> Arc | None:
        """What this node owns, as it is durable."""
        return self._parts.keeper.holding.arc

    def owns(self, location: Location) -> bool:
        return self._parts.keeper.holding.owns(location)

    def busy(self, side: Side) -> bool:
        """Whether a handover with that neighbour is under way, and no other can begin."""
        return self._parts.keeper.holding.on(side) is not None

    def settled(self, arc: Arc) -> bool:
        """Whether everything in the arc may move on: nothing was received within the settling time, no giver may still take it back,
        and all that was acknowledged there is known."""
        keeper = self._parts.keeper
        unsettled = self._parts.settling.settles_in_s(arc) or keeper.holding.may_be_taken_back(arc)
        return not unsettled and keeper.copies.is_recovered(arc)

    def open_handovers(self) -> list[tuple[Side, Handover]]:
        """All handovers that have not ended, for reports."""
        return self._parts.keeper.holding.handovers

    def gap_left(self) -> Arc | None:
        """A gap beside the arc that this node has found and not adopted yet."""
        return self._adoption.gap

    @property
    def events(self) -> Counter[str]:
        """How often what happened since the start."""
        return self._parts.events

    @property
    def refuses(self) -> str:
        """Why this node takes nothing at present (it drains); "" if it does."""
        return self._receiving.refuses

    @refuses.setter
    def refuses(self, reason: str) -> None:
        self._receiving.refuses = reason

    async def remaining(self) -> Remaining:
        """What this node would leave behind if it were switched off now."""
        arc = self.arc
        totals = None if arc is None else await self._parts.store.arc_totals(arc)
        records, stored_bytes = (0, 0) if totals is None else (totals.records, totals.bytes)
        return Remaining(records, stored_bytes, len(self.open_handovers()), self._strays.left)

    # ---------------------------------------------------------------------------------------------------- doing

    def writing(self, locations: Sequence[Location], *, anywhere: bool = False) -> AbstractAsyncContextManager[None]:
        """Around every write to these places, or `anywhere` else in the arc: waits while one of them is about to be let go.

        Set a time limit.
        """
        return self._parts.writing(locations, anywhere=anywhere)

    async def give(self, side: Side, arc: Arc, *, why: str) -> None:
        """Hand an end of our arc (or all of it) to the neighbour on that side; returns once that owns it durably.

        Refused, Unreachable or PeerFault if it did not come to that; `run` must be running.
        """
        await self._giving.give(side, arc, why)

    def register(self, handlers: Handlers) -> None:
        self._receiving.register(handlers)
        self._adoption.register(handlers)
        self._strays.register(handlers)

    async def load(self) -> None:
        """Take what this node kept from before. DamagedData if that cannot be trusted."""
        await self._parts.keeper.load()

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Everything that goes on by itself, until cancelled."""
        async with trio.open_nursery() as nursery:
            for side in Side:
                nursery.start_soon(self._giving.tend, side)
                nursery.start_soon(self._receiving.tend, side)
            nursery.start_soon(self._follow_log)
            nursery.start_soon(self._adoption.run)
            nursery.start_soon(self._strays.run)
            task_status.started()

    async def _follow_log(self) -> None:
        """Begin the first holding once this node is registered; drop handovers with nodes that were removed, where they are dropped."""
        while True:
            registry = self._parts.cluster_log.registry
            if registry.is_current(self._parts.own.member):
                try:
                    await self._parts.keeper.change(lambda holding: holding)
                except Refused:
                    # The disk is full: tried again with the next news, and before every change. Or this life is ending.
                    self._parts.events["not kept"] += 1
            await self._parts.cluster_log.changed_after(registry.position)
