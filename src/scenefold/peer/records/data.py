"""Records of a scene, as a node keeps them for everybody: writes, reads, ranges (Algorithm 6; specs/18-data.md).

The three parts share nothing but what they are given: the store, who owns what, and whether we may speak for it.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId, SceneId
from scenefold.peer.handlers import Handlers
from scenefold.peer.holdings import AllKnown, Holdings, Known, Lease, Owners
from scenefold.peer.peers import Peers
from scenefold.peer.records.copying import Copying, OneCopy
from scenefold.peer.records.fence import Fence
from scenefold.peer.records.ranges import Ranges
from scenefold.peer.records.reads import Reads, behind
from scenefold.peer.records.writes import Writes
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.store import Store
from scenefold.wire import RecordBytes, RecordKey, SceneMode
from scenefold.world import World


class DataService:
    """The owner's side of every read and write."""

    def __init__(
        self,
        world: World,
        store: Store,
        peers: Peers,
        scenes: Scenes,
        line: Holdings,
        lease: Lease,
        routing: Owners,
        me: NodeId,
        copying: Copying | None = None,
        known: Known | None = None,
    ) -> None:
        """`copying`: None where every space has one copy. `known`: None where no place is ever adopted."""
        copying, known, fence = copying or OneCopy(store), known or AllKnown(), Fence()
        self._scenes = scenes
        self.writes = Writes(world, store, scenes, line, lease, routing, me, copying, known, fence)
        self.reads = Reads(store, peers, scenes, line, lease, routing, me, copying, known, fence)
        self.ranges = Ranges(store, scenes, line, lease, copying, known)

    def register(self, handlers: Handlers) -> None:
        self.writes.register(handlers)
        self.reads.register(handlers)
        self.ranges.register(handlers)

    async def read(self, scene: SceneId, keys: Sequence[RecordKey], position: int) -> list[RecordBytes | None]:
        """All records at the keys, wherever they lie, stale ones too; for services of this node.

        Refused (16) if an owner is away, cannot say that nothing is there, or does not know yet what the mode of this position forbids.
        """
        found: list[RecordBytes | None] = []
        public = (await self._scenes.known(scene, position=position)).public
        while len(found) < len(keys):
            part = await self.reads.get(scene, keys[len(found) :], position, forward=True)
            if public.mode is SceneMode.RENDER and part.write_floor < public.write_floor:
                raise behind()
            found += part.records
        return found
