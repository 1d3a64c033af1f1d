"""Nodes that are nothing but members, in a simulated world: log, lease and enrolment, without data or gossip."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import trio

from scenefold.base.ids import address_of
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.lease import OwnerLease
from scenefold.peer.enrolment.enrolment import Enrolment, IdentityRenewed
from scenefold.peer.handlers import Handlers
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.routing import Routing
from scenefold.store import open_store
from scenefold.wire import MiniStatus
from scenefold.world import Connection, Priority, background_tasks, open_links, serve_connection
from scenefold.world.sim import SimNet
from unit.peer.logs_made import LOG_KEY, facts, node, secrets_of

FOLDER = Path("/data")


class LogNode:
    """One life of a node; `log`, `lease` and `own` are those of this life."""

    log: ClusterLog
    lease: OwnerLease
    own: OwnStatus
    enrolment: Enrolment

    def __init__(self, cluster: LogCluster, number: int) -> None:
        self.number, self.id, self.address = number, node(number), address_of(node(number))
        self._cluster = cluster
        self.scope = trio.CancelScope()
        self.ended = trio.Event()
        self.renewed = 0
        self.failure: Exception | None = None

    async def run(self, *, task_status: trio.TaskStatus[None]) -> None:
        """Lives, one after the other where the identity is renewed, until the scope is cancelled."""
        with self.scope:
            first = True
            while True:
                try:
                    await self._live(task_status if first else trio.TASK_STATUS_IGNORED)
                except IdentityRenewed:
                    self.renewed += 1
                except Exception as failure:  # noqa: BLE001  what a node ends with is looked at by the test
                    self.failure = failure
                    break
                first = False
        self.ended.set()

    async def _live(self, task_status: trio.TaskStatus[None]) -> None:
        cluster = self._cluster
        world = cluster.net.world(f"node:{self.id}", self.address)
        async with (
            open_store(world, FOLDER, self.id, reserve_bytes=0) as store,
            open_links(world) as links,
            background_tasks() as nursery,
        ):
            identity = store.identity
            self.own = OwnStatus(self.id, self.address, identity.incarnation, identity.boot, secrets_of(self.number))
            roster = Roster(self.id)
            routing = Routing(lambda: self.log.registry, roster, self.own)
            peers = Peers(world, links, self.own, roster, routing)
            self.log = ClusterLog(world, store, peers, cluster.facts, self.own, LOG_KEY if self.number == 0 else None)
            self.lease = OwnerLease(world, store, self.log, self.own)
            self.enrolment = Enrolment(world, store, self.log, self.lease, self.own)
            handlers = Handlers(lambda: self.log.registry, self.own.mini, self._hear)
            self.log.register(handlers)
            roster.tell_position = self.log.heard_of
            await self.log.load()

            async def serve(connection: Connection) -> None:
                await serve_connection(connection, handlers.handle)

            await nursery.start(partial(world.network.listen, self.address, Priority.HIGH, serve))
            await nursery.start(self.log.run)
            nursery.start_soon(self.lease.run)
            nursery.start_soon(self.enrolment.run)
            task_status.started()
            await trio.sleep_forever()

    def _hear(self, mini: MiniStatus) -> None:
        self.log.heard_of(mini.node, mini.log_position)


class LogCluster:
    """Founders, spares, and the network between them."""

    def __init__(self, net: SimNet, founders: int, spares: int, nursery: trio.Nursery) -> None:
        self.net = net
        self.facts = facts(founders, spares, net.ports)
        self.nodes: dict[int, LogNode] = {}
        self._nursery = nursery

    async def start(self, *numbers: int) -> None:
        for number in numbers:
            self.nodes[number] = LogNode(self, number)
            await self._nursery.start(self.nodes[number].run)

    async def crash(self, number: int) -> None:
        """The power of a machine goes."""
        one = self.nodes.pop(number)
        self.net.crash(one.address)
        one.scope.cancel()
        await one.ended.wait()

    async def members(self, *numbers: int, within_s: float = 60.0) -> None:
        """Wait until these nodes are members and hold a lease."""
        with trio.fail_after(within_s):
            for number in numbers:
                await self.nodes[number].enrolment.registered()
                await self.nodes[number].lease.held()

    async def equal(self, within_s: float = 60.0) -> None:
        """Wait until all logs that run are equal."""
        with trio.fail_after(within_s):
            while len({one.log.registry.head for one in self.nodes.values()}) > 1:
                behind = min(self.nodes.values(), key=lambda one: one.log.registry.position)
                await behind.log.changed_after(behind.log.registry.position)


@asynccontextmanager
async def log_cluster(seed: int, founders: int = 3, spares: int = 0, **net: Any) -> AsyncIterator[LogCluster]:
    async with background_tasks() as nursery:
        yield LogCluster(SimNet(seed, **net), founders, spares, nursery)
