"""All services of replication together, as the rest of the node sees them (specs/20-copies.md)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import trio

from scenefold.peer.handlers import Handlers
from scenefold.peer.line.gaps import Gaps
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.activating import Activating
from scenefold.peer.replication.comparing import Comparing
from scenefold.peer.replication.healing import Healing
from scenefold.peer.replication.health import Health
from scenefold.peer.replication.holding_custody import HoldingCustody
from scenefold.peer.replication.holding_reads import HoldingReads
from scenefold.peer.replication.holding_records import HoldingRecords
from scenefold.peer.replication.looking import Looking
from scenefold.peer.replication.noting import Noting
from scenefold.peer.replication.owner_versions import OwnerVersions
from scenefold.peer.replication.placing import Placing
from scenefold.peer.replication.recovering import Recovering
from scenefold.peer.replication.spreading import Spreading
from scenefold.peer.replication.teaching import Teaching
from scenefold.peer.replication.telling import Telling
from scenefold.peer.routing import Routing


class Replication:
    """Used from the Trio thread only."""

    def __init__(
        self, parts: Parts, roster: Roster, routing: Routing, gaps: Gaps, *, may_order: Callable[[str], bool] = lambda _user: True
    ) -> None:
        """`parts`: those of the line, whose keeper has what is known about copies. `gaps`: what of the line has no owner. `may_order`: whether a user may."""
        self._parts = parts
        self._roster = roster
        self._routing = routing
        self._teaching = Teaching(parts, roster)
        self.placing = Placing(parts, roster, gaps)
        self.telling = Telling(parts)
        self.spreading = Spreading(parts, roster, self.placing)
        self.comparing = Comparing(parts, roster, partial(self.spreading.merge, wait=False), self.placing.full.note)
        self._activating = Activating(parts)
        self.healing = Healing(parts, partial(self.spreading.merge, wait=False))
        self.noting = Noting(parts, may_order=may_order)
        self.recovering = Recovering(parts, self.noting.note)
        self.health = Health(
            parts, roster, self.placing, self.healing, lambda: self.comparing.left, self.noting.documents, lambda: self.recovering.crowding
        )
        self.recovering.doubt = self.spreading.doubt
        # Who holds it, and is to hold it, answers for it no more until it is placed.
        self.recovering.known = self.placing.look_soon
        reads = HoldingReads(parts, OwnerVersions(parts, self.spreading, self.recovering))
        self._looking = Looking(parts, roster, partial(self.spreading.merge, wait=False))
        self._holding = (HoldingCustody(parts, roster), HoldingRecords(parts), reads, self._looking, self.noting)

    def register(self, handlers: Handlers) -> None:
        """Answer what other nodes and users ask about copies."""
        for service in self._holding:
            service.register(handlers)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Everything that goes on by itself, until cancelled."""
        then = self._parts.arrival.then
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._teaching.run)
            nursery.start_soon(self.placing.run)
            nursery.start_soon(then, self.telling.run)
            nursery.start_soon(then, self.comparing.run)
            nursery.start_soon(self._activating.run)
            nursery.start_soon(self.healing.run)
            await nursery.start(self.spreading.run)
            nursery.start_soon(then, self.recovering.run)
            task_status.started()
            nursery.start_soon(then, self._looking.run)
            nursery.start_soon(then, self.noting.run)
