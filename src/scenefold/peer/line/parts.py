"""What the services of the line share: one holding, one gate, one budget, and the node around them."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.holdings import Lease, Owners
from scenefold.peer.line.arrival import Arrival
from scenefold.peer.line.budget import Budget
from scenefold.peer.line.carrying import Carrying
from scenefold.peer.line.claims import Claims
from scenefold.peer.line.gate import Gate
from scenefold.peer.line.keeper import Keeper
from scenefold.peer.line.knowing import Knowing
from scenefold.peer.line.resting import Resting
from scenefold.peer.line.settling import Settling
from scenefold.peer.line.unsettled import Unsettled
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.records.copying import NotKept
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.timing import T_WAIT_S
from scenefold.store import Put, PutResult, Spot, Store
from scenefold.wire import HandoverReply, SceneLogPublic
from scenefold.world import World, first_of


class KnownScenes(Protocol):
    async def known(self, scene: SceneId, *, position: int = 0, ask: bool = True, asker: str = "") -> KnownScene: ...
    def everyone(self) -> Sequence[KnownScene]: ...
    def here(self, scene: SceneId) -> KnownScene | None:
        """What this node itself has of a scene, at this moment."""
        ...

    async def adopt(self, public: SceneLogPublic, /) -> KnownScene:
        """Keep a header durably; Refused if it must not be, or is no news."""
        ...


class Merge(Protocol):
    async def __call__(self, puts: Sequence[Put], /) -> Sequence[PutResult | NotKept]: ...


async def _of_nobody(_spot: Spot) -> bool:
    return False


async def _nowhere(_scene: SceneId, _space: SpaceId, _arcs: Sequence[Arc]) -> bool:
    return False


@dataclass(slots=True)
class Keeping:
    """What replication does for the line, which sets it.

    `merge`: how verified copies are taken into this node's own arc, so that those who hold copies get them, too. `awaits`: whether others may
    still give what has rotted here so that its version is not known any more; `awaits_within`: likewise of what is known to have rotted in these arcs.
    """

    merge: Merge
    awaits: Callable[[Spot], Awaitable[bool]] = _of_nobody
    closed: bool = False
    """Whether this node is about to leave, and takes no copies any more: nobody may count on what comes after its last look at its disk."""
    awaits_within: Callable[[SceneId, SpaceId, Sequence[Arc]], Awaitable[bool]] = _nowhere


@dataclass(frozen=True, slots=True)
class Parts:
    """Everything that giving, receiving, adopting and bringing home need."""

    world: World
    store: Store
    peers: Peers
    cluster_log: ClusterLog
    own: OwnStatus
    lease: Lease
    scenes: KnownScenes
    owners: Owners
    claims: Claims
    keeper: Keeper
    gate: Gate
    settling: Settling
    budget: Budget
    keeping: Keeping
    unsettled: Unsettled = field(default_factory=Unsettled)
    knowing: Knowing = field(default_factory=Knowing)
    carrying: Carrying = field(default_factory=Carrying)
    arrival: Arrival = field(default_factory=Arrival)
    resting: Resting = field(default_factory=Resting)
    events: Counter[str] = field(default_factory=Counter)

    def require_lease(self) -> None:
        """Refused (16) without a lease: who may not speak for its arc moves no bound either."""
        if not self.lease.holds():
            raise Refused(RejectReason.NOT_READY, "this node holds no owner lease at the moment")

    def leases_end_in_s(self, position: int) -> float:
        """Seconds until nobody holds a lease any more who was removed at this position of the log; a start counts as learning of it."""
        return max(0.0, self.cluster_log.learnt_at(position) + T_WAIT_S - self.world.clock.now())

    async def something_new(self, revision: int, position: int) -> None:
        """Return once the holding, or the cluster's log, is no longer what it was."""
        await first_of(partial(self.keeper.changed_after, revision), partial(self.cluster_log.changed_after, position))

    @asynccontextmanager
    async def writing(self, locations: Sequence[Location], *, anywhere: bool) -> AsyncIterator[None]:
        """Be a writer of these places, and `anywhere` also of any other in the arc: the store merges a node-managed object
        where it has it. What is given away always has an end of the arc in it, so that waits for both."""
        while True:
            arc = self.keeper.holding.arc
            ends = (arc.first, arc.last) if anywhere and arc is not None else ()
            async with self.gate.writing((*locations, *ends)):
                # Those ends stand for "anywhere" only as long as they are the arc's.
                if not anywhere or self.keeper.holding.arc == arc:
                    yield
                    return


def check_reply(reply: HandoverReply) -> None:
    """Refused with what the other node says, unless it says yes."""
    if reply.reason:
        raise Refused(RejectReason(reply.reason), reply.text or "the other node refused")
