"""A node's services, wired together and run in one nursery (docs/explanation/architecture.md, One node at run time).

ports (TCP low and high) -> Handlers -> data, scenes, members, extensions
UDP high                 -> Gossip   -> Roster
"""

from __future__ import annotations

import logging

import trio

from scenefold.base.errors import Unreachable
from scenefold.peer.context import NodeContext
from scenefold.peer.data import DataService
from scenefold.peer.gossip import Gossip
from scenefold.peer.handlers import Handlers
from scenefold.peer.members import Members
from scenefold.peer.peers import Peers
from scenefold.peer.roster import Roster
from scenefold.peer.routing import Routing
from scenefold.peer.scenes import Scenes
from scenefold.peer.settings import NodeSettings
from scenefold.peer.status import OwnStatus
from scenefold.store import Store
from scenefold.world import Connection, Links, Priority, QuietLog, World, serve_connection
from scenefold.world.profile import ClusterProfile

LOAD_S = 1.0
"""Pause between two looks at how full the disk is."""
SEED_WARNING_S_MAX = 5.0
"""A person who starts a node wants to hear soon that nobody answers."""

_log = logging.getLogger("scenefold.peer")


class PeerServices:
    """All services of one node. `context` is what extensions get."""

    def __init__(self, settings: NodeSettings, profile: ClusterProfile, world: World, store: Store, links: Links) -> None:
        member = profile.member(settings.address)
        me = member.node_id
        keys = {other.node_id: other.public_key for other in profile.members}
        routing = Routing(keys)
        roster = Roster(me, keys)
        own = OwnStatus(
            me,
            member.address,
            store.identity.incarnation,
            store.identity.boot,
            routing.arc_of(me).last,
            profile.node_signing_key(member.address),
        )
        own.update(memory_total_bytes=settings.memory_budget_bytes)
        handlers = Handlers(frozenset(keys), own.mini, lambda mini: roster.hear_mini(mini, world.clock.now()))
        peers = Peers(world, links, own, roster, routing)
        scenes = Scenes(world, store, peers, own)
        data = DataService(world, store, peers, scenes, routing, me)
        scenes.register(handlers)
        scenes.register_logs(handlers)
        data.register(handlers)
        Members(own, roster, routing, scenes, keys).register(handlers)
        seeds = settings.seeds or profile.seeds
        self._quiet = QuietLog(_log)
        self._is_seed = member.address in seeds
        self._gossip = Gossip(world, own, roster, routing, keys, seeds)
        self.context = NodeContext(
            settings=settings,
            profile=profile,
            me=me,
            address=member.address,
            world=world,
            store=store,
            links=links,
            roster=roster,
            routing=routing,
            own=own,
            peers=peers,
            handlers=handlers,
            scenes=scenes,
            data=data,
        )

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve until cancelled; started once all ports are open. LocalFault if one cannot be had."""
        context = self.context
        await context.scenes.load()
        if await context.store.holding() is None:
            await context.store.put_holding(context.routing.arc_of(context.me), b"")
        async with trio.open_nursery() as nursery:
            await nursery.start(self._gossip.run)
            for priority in Priority:
                await nursery.start(context.world.network.listen, context.address, priority, self._serve)
            nursery.start_soon(self._watch_load)
            nursery.start_soon(self._watch_seeds)
            nursery.start_soon(self._join)
            task_status.started()

    async def _serve(self, connection: Connection) -> None:
        await serve_connection(connection, self.context.handlers.handle, self._quiet)

    async def _join(self) -> None:
        await self._gossip.somebody_heard()
        await self.context.scenes.catch_up()
        await self._gossip.everybody_heard()
        self.context.joined.set()

    async def _watch_seeds(self) -> None:
        """Say once that no seed answers; give up in the end, unless this node is a seed that others look for."""
        wait_s = self.context.settings.seed_wait_s
        warning_s = min(SEED_WARNING_S_MAX, wait_s / 2)
        silent = ", ".join(self._gossip.seeds)
        with trio.move_on_after(warning_s):
            await self._gossip.a_seed_heard()
            return
        _log.warning("no seed answers yet (%s): trying on", silent)
        with trio.move_on_after(wait_s - warning_s):
            await self._gossip.a_seed_heard()
            return
        if not self._is_seed:
            raise Unreachable(
                f"no seed answered within {wait_s:g} s",
                where=silent,
                remedy="start these nodes first, or name others as seeds",
            )
        await self._gossip.a_seed_heard()

    async def _watch_load(self) -> None:
        context = self.context
        while True:
            statistics = await context.store.statistics()
            context.own.update(disk_used_bytes=statistics.disk_used_bytes, disk_total_bytes=statistics.disk_total_bytes)
            await context.world.clock.sleep(LOAD_S)
