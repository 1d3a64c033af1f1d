"""A line that stands still: founders take their founding arcs, others own nothing. Until bounds move (peer/line)."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

import trio

from scenefold.base.location import Arc, Location
from scenefold.peer.cluster_log import ClusterLog
from scenefold.peer.handlers import Handlers
from scenefold.peer.status import OwnStatus
from scenefold.store import Store
from scenefold.world import World


class Line:
    def __init__(self, world: World, store: Store, _peers: Any, cluster_log: ClusterLog, own: OwnStatus, *_: Any, **__: Any) -> None:
        self._store = store
        self._cluster_log = cluster_log
        self._own = own
        self.arc: Arc | None = None

    def register(self, handlers: Handlers) -> None:
        return None

    def owns(self, location: Location) -> bool:
        return self.arc is not None and location in self.arc

    @asynccontextmanager
    async def writing(self, _locations: Sequence[Location]) -> AsyncIterator[None]:
        yield

    async def load(self) -> None:
        stored = await self._store.holding()
        if stored is not None:
            self.arc = self._own.arc = stored.arc

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        task_status.started()
        while self.arc is None:
            registry = self._cluster_log.registry
            arc = registry.founding_arc(self._own.me)
            if arc is not None and registry.is_current(self._own.member):
                await self._store.put_holding(arc, b"")
                self.arc = self._own.arc = arc
                return
            await self._cluster_log.changed_after(registry.position)
