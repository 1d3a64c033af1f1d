"""Nodes that are nothing but members, in a simulated world: log, lease and enrolment, without data or gossip."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.lease import OwnerLease
from scenefold.peer.enrolment.enrolment import Enrolment, IdentityRenewed
from scenefold.peer.handlers import Handlers
from scenefold.peer.logs.links import NodePorts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.routing import Routing
from scenefold.store import open_store
from scenefold.wire import AddParticipant, LogEntry, MiniStatus
from scenefold.wire.enrol_entries import Trust
from scenefold.world import Connection, Priority, background_tasks, open_links, serve_connection
from scenefold.world.sim import SimNet
from unit.peer.logs_made import LOG_KEY, facts, key_of, node, secrets_of

FOLDER = Path("/data")


class LogNode:
    """One life of a node; `log`, `lease`, `own` and `roster` are those of this life."""

    log: ClusterLog
    lease: OwnerLease
    own: OwnStatus
    roster: Roster
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
        self.clock = world.clock
        async with (
            open_store(world, FOLDER, self.id, reserve_bytes=0) as store,
            open_links(world) as links,
            background_tasks() as nursery,
        ):
            identity = store.identity
            self.own = OwnStatus(self.id, self.address, identity.incarnation, identity.boot, secrets_of(self.number))
            roster = self.roster = Roster(self.id)
            routing = Routing(lambda: self.log.registry, roster, self.own)
            peers = Peers(world, links, self.own, roster, routing)
            self.ports = NodePorts(world.clock, self.id, peers, routing, roster, links, lambda _incarnation: False)
            self.log = ClusterLog(
                world, store, peers, cluster.facts, self.own, self.ports, LOG_KEY if self.number == 0 and cluster.has_key else None
            )
            self.lease = OwnerLease(world, store, self.log, self.own)
            self.enrolment = Enrolment(world, store, self.log, self.lease, self.own)
            handlers = Handlers(lambda: self.log.registry, self.own.mini, self._hear)
            self.log.register(handlers)
            self.ports.intake.register(handlers)
            roster.tell_position = self.log.heard_of
            await self.log.load()

            async def serve(connection: Connection) -> None:
                await serve_connection(connection, handlers.handle)

            await nursery.start(partial(world.network.listen, self.address, Priority.HIGH, serve))
            await nursery.start(self.log.run)
            nursery.start_soon(self._know_members, roster)
            nursery.start_soon(self.lease.run)
            nursery.start_soon(self.enrolment.run)
            task_status.started()
            await trio.sleep_forever()

    async def _know_members(self, roster: Roster) -> None:
        registry = self.log.registry
        while True:
            roster.set_members(registry, self._cluster.net.now)
            registry = await self.log.changed_after(registry.position)

    def _hear(self, mini: MiniStatus) -> None:
        self.roster.hear_mini(mini, self._cluster.net.now)
        self.log.heard_of(mini.node, mini.log_position)


class LogCluster:
    """Founders, spares, and the network between them."""

    def __init__(self, net: SimNet, founders: int, spares: int, nursery: trio.Nursery) -> None:
        self.net = net
        self.facts = facts(founders, spares, net.ports)
        self.nodes: dict[int, LogNode] = {}
        self.has_key = True
        """Whether the first node has the log's key still."""
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
                while not self.nodes[number].lease.holds():
                    # A life may end meanwhile, and another one begin.
                    with trio.move_on_after(1.0):
                        await self.nodes[number].lease.held()

    async def name_voters(self, *numbers: int, within_s: float = 60.0) -> None:
        """Trust these nodes, and name them as voters, the first one first."""
        first = self.nodes[numbers[0]]
        with trio.fail_after(within_s):
            for number in numbers:
                sealing = secrets_of(number).sealing.public.raw
                if not first.log.registry.is_trusted(node(number)):
                    await self.patiently(first, Trust(node(number), True, sealing, b"sealed to %d" % number))
                await self.patiently(first, self.naming(number))
            await self.ready(*numbers)

    async def ready(self, *numbers: int) -> None:
        """Wait until these voters have heard what those before them granted."""
        for number in numbers:
            await self.nodes[number].log.voting.voted.opened.wait()
            while not self.nodes[number].log.voting.is_ready:
                with trio.move_on_after(1.0):
                    await self.nodes[number].log.voting.voted.desk.looked()

    def naming(self, number: int) -> AddParticipant:
        return AddParticipant(self.nodes[number].own.member, key_of(number).public.raw)

    async def patiently(self, one: LogNode, entry: LogEntry) -> int:
        """Have something decided, as often as it is not yet to be."""
        while True:
            try:
                return await one.log.propose(entry)
            except Refused as refusal:
                if refusal.reason is not RejectReason.NOT_READY:
                    raise
            except Unreachable:
                pass
            await trio.sleep(0.5)

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
