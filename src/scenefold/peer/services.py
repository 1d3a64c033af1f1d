"""A node's services, wired together and run in one nursery (docs/architecture.md, One node at run time).

    ports (TCP low and high) -> Handlers -> cluster log, line, data, scenes, members, extensions
    UDP high                 -> Gossip   -> Roster -> Routing, Probing -> removal proposals

The cluster's log says who is a member and where on the line; Line what this node owns; the lease whether it may speak for
it at this moment; the roster who seems alive. Everything else asks these four.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

import trio

from scenefold.base.ids import node_id_of
from scenefold.crypto import MemberSecrets, SigningKey
from scenefold.peer.balance import Balancer, Draining, Joining, OwnLoad, Recovering, Sharing
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.lease import OwnerLease
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.context import NodeContext
from scenefold.peer.enrolment.card_rules import is_administrator, is_scene_member, is_user_key
from scenefold.peer.enrolment.discovery import Discovery
from scenefold.peer.enrolment.door import Door
from scenefold.peer.enrolment.enrolling import Enrolling
from scenefold.peer.enrolment.enrolment import Enrolment
from scenefold.peer.enrolment.papers import NO_PAPERS, Papers
from scenefold.peer.enrolment.renewal import Renewal
from scenefold.peer.handlers import Handlers
from scenefold.peer.line import Claims, Gaps, Line
from scenefold.peer.line.parting import lies_with_all_others
from scenefold.peer.logs.links import NodePorts
from scenefold.peer.membership.blacklist import OwnBlacklist
from scenefold.peer.membership.evicting import Evicting
from scenefold.peer.membership.gossip import Gossip
from scenefold.peer.membership.members import Members
from scenefold.peer.membership.probing import Probing
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.seeds import watch_seeds
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.membership.tables import Tables
from scenefold.peer.modes.lending import Lending
from scenefold.peer.peers import Peers
from scenefold.peer.public_keys import PublicKeys
from scenefold.peer.purging import Arriving, LettingGo, Purging
from scenefold.peer.purging.showing import Showing
from scenefold.peer.purging.suspects import Suspects
from scenefold.peer.records.data import DataService
from scenefold.peer.records.range_datagrams import RangeDatagrams
from scenefold.peer.replication import Replication
from scenefold.peer.reporting import Reporting
from scenefold.peer.routing import Routing
from scenefold.peer.scene_log.makers import check_decider, relying_on
from scenefold.peer.scene_log.participation import Participation
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.peer.scrub import Pace, Scrub
from scenefold.peer.settings import NodeSettings
from scenefold.peer.upkeep import OwnUpkeep
from scenefold.store import Store
from scenefold.world import Links, Priority, World
from scenefold.world.facts import ClusterFacts

LOAD_S = 1.0
"""Pause between two looks at how full the disk is."""
JOIN_WAIT_S = 5.0
"""For members that may be alive to be heard. Who is away then is no reason to keep this node's users waiting."""

TILING_LOOK_S = 0.05
"""Until the first second look at whether all arcs are known."""


class PeerServices:
    """All services of one life of a node. `context` is what extensions get."""

    def __init__(
        self,
        settings: NodeSettings,
        facts: ClusterFacts,
        secrets: MemberSecrets,
        log_signing_key: SigningKey | None,
        world: World,
        store: Store,
        links: Links,
        *,
        joined: trio.Event,
        papers: Papers = NO_PAPERS,
    ) -> None:
        me = node_id_of(settings.address)
        identity = store.identity
        own = OwnStatus(me, settings.address, identity.incarnation, identity.boot, secrets)
        own.update(memory_total_bytes=settings.memory_budget_bytes)
        roster = Roster(me)

        def registry() -> Registry:
            return cluster_log.registry

        def may_order(user: str) -> bool:
            return is_administrator(user, registry(), facts)

        routing = Routing(registry, roster, own)
        peers = Peers(world, links, own, roster, routing)
        ports = NodePorts(world.clock, me, peers, routing, roster, links, lambda incarnation: registry().removal(incarnation) is not None)
        cluster_log = ClusterLog(world, store, peers, facts, own, ports, log_signing_key)
        cluster_log.forget_key = partial(world.workers.run, "import", papers.forget_log_key)
        lease = OwnerLease(world, store, cluster_log, own)
        check_new = partial(check_decider, voter=facts.credential(facts.voter))
        participation = Participation(world, store, peers, own, ports, lease.begun)
        scenes = Scenes(world, store, peers, own, facts.voter, lambda key: is_user_key(key, registry(), facts), check_new, participation)
        lending = Lending(world, peers, me, participation.modes_of, scenes.here)
        claims = Claims(world.clock, cluster_log, roster, me)
        gaps = Gaps(world.clock, roster)
        line = Line(
            world, store, peers, cluster_log, own, lease, scenes, routing, claims, gaps, transfer_bytes_per_s=settings.transfer_bytes_per_s
        )
        self._replication = Replication(line.parts, roster, routing, gaps, may_order=may_order)
        purging = Purging(line.parts, self._replication.spreading)
        self._letting_go = LettingGo(line.parts, participation)
        suspects = Suspects(line.parts)
        line.parts.arrival.before.append(suspects.set_aside)
        showing = Showing(line.parts, suspects, lambda user, scene: is_scene_member(user, scene.public, registry(), facts))
        self._arriving = Arriving(line.parts, scenes, lease.held)
        data = DataService(world, store, peers, scenes, line, lease, routing, me, self._replication.spreading, self._replication.recovering)
        enrolment = Enrolment(world, store, cluster_log, lease, own)
        balancer = Balancer(world, store, line, roster, cluster_log, own, line.parts.resting, gaps, is_off=not settings.balance)
        keeper = line.parts.keeper
        self._recovers = Recovering(world.clock, lambda: bool(keeper.copies.unrecovered))
        self._load = OwnLoad(
            world.clock,
            store,
            lambda: line.arc,
            lambda: keeper.copies.custody,
            settings.capacity_bytes,
            lambda: bool(line.refuses),
            self._recovers,
        )
        sharing = Sharing(store, line, cluster_log, own, roster, gaps)
        joining = Joining(world, line, roster, routing, cluster_log, peers, own, place=settings.join_place)
        draining = Draining(
            world,
            store,
            line,
            roster,
            cluster_log,
            own,
            lambda: relying_on(me, scenes.everyone()),
            has_lease=lease.holds,
            may_order=may_order,
            lies_elsewhere=partial(lies_with_all_others, line.parts),
            close=partial(setattr, line.parts.keeping, "closed"),
        )
        scrub = Scrub(world.clock, store, Pace(settings.scrub_days, settings.scrub_bytes_per_s))
        upkeep = OwnUpkeep(store, line.parts.resting, line.parts.budget, scrub, may_order=may_order)
        self._blacklist = OwnBlacklist(store, own, settings.blacklisted, may_order=may_order)
        enrolment.join = joining.join
        enrolment.leaving = lambda: draining.is_leaving
        public_keys = PublicKeys(facts, registry, scenes)
        gossip = Gossip(world, own, roster, cluster_log, facts, settings.seeds or facts.seeds)
        gossip.answering.key_answer = public_keys.answer
        claims.ask = gossip.probe
        probing = Probing(world, gossip, roster, peers, cluster_log, own, settings)
        cluster_log.veto, cluster_log.voting.elector.evidence = probing.veto, probing.objection
        handlers = Handlers(registry, own.mini, lambda mini: roster.hear_mini(mini, world.clock.now()))
        cluster_log.register(handlers, scenes)
        enrolling = Enrolling(world, facts, me, secrets, cluster_log, peers, papers)
        members = Members(own, roster, registry)
        for service in (
            ports.intake,
            lending,
            scenes,
            line,
            self._replication,
            purging,
            showing,
            data,
            probing,
            sharing,
            draining,
            self._blacklist,
            upkeep,
            enrolling,
            members,
            public_keys,
        ):
            service.register(handlers)
        renewal = Renewal(world, facts, cluster_log, peers, enrolling, papers)
        discovery = Discovery(world, facts, me, settings.address, cluster_log)
        self._door = Door(world, facts, cluster_log, handlers, links)
        self._newcomers = enrolling.serve_newcomer
        evicting = Evicting(world.clock, cluster_log, roster, me)
        self._background: tuple[Callable[[], Awaitable[None]], ...] = (
            balancer.run,
            sharing.run,
            joining.run,
            draining.run,
            self._door.run,
            enrolling.share_authority,
            renewal.run,
            discovery.run,
            scrub.run,
            suspects.run,
            self._letting_go.run,
            evicting.run,
        )
        self._tables = Tables(world, gossip, roster, peers)
        self._is_seed = settings.address in gossip.seeds
        self.context = NodeContext(
            settings=settings,
            facts=facts,
            me=me,
            address=settings.address,
            world=world,
            store=store,
            links=links,
            roster=roster,
            routing=routing,
            own=own,
            peers=peers,
            handlers=handlers,
            cluster_log=cluster_log,
            lease=lease,
            line=line,
            scenes=scenes,
            logs=ports.logs,
            participation=participation,
            replication=self._replication,
            data=data,
            enrolment=enrolment,
            balancer=balancer,
            draining=draining,
            scrub=scrub,
            upkeep=upkeep,
            suspects=suspects,
            gossip=gossip,
            range_datagrams=RangeDatagrams(world, own, facts.cluster_id, registry, data.ranges),
            discovery=discovery,
            probing=probing,
            joined=joined,
        )
        reporting = Reporting(self.context)
        reporting.register(handlers)
        self._background = (*self._background, reporting.run)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve until cancelled; started once all ports are open. LocalFault if one cannot be had."""
        context = self.context
        # Who asks must never meet a node that does not know yet what it owns, or who is a member.
        await context.cluster_log.load()
        await context.scenes.load()
        await self._letting_go.load()
        await context.line.load()
        await context.draining.load()
        await self._blacklist.load()
        await context.upkeep.load()
        await context.replication.noting.load()
        async with trio.open_nursery() as nursery:
            await nursery.start(partial(context.participation.run, context.scenes))
            await nursery.start(context.gossip.run)
            await nursery.start(context.range_datagrams.run)
            # Nor one that does not know what of that counts.
            await nursery.start(self._replication.run)
            for priority in Priority:
                newcomers = self._newcomers if priority is Priority.HIGH else None
                listen = partial(
                    context.world.network.listen, context.address, priority, partial(self._door.serve, priority), newcomers=newcomers
                )
                await nursery.start(listen)
            await nursery.start(context.cluster_log.run)
            await nursery.start(context.line.run)
            for service in (context.lease.run, context.enrolment.run, context.probing.run, self._tables.run, *self._background):
                nursery.start_soon(service)
            nursery.start_soon(self._watch_load)
            nursery.start_soon(watch_seeds, context.gossip, context.settings.seed_wait_s, self._outlasts_seeds)
            nursery.start_soon(self._join)
            task_status.started()

    def _outlasts_seeds(self) -> bool:
        """A seed, or a member that has run before; at its first start it may have been told of the wrong ones."""
        context = self.context
        return self._is_seed or (context.store.identity.boot > 1 and context.cluster_log.registry.is_current(context.own.member))

    async def _join(self) -> None:
        context = self.context
        await context.enrolment.registered()
        await self._arriving.run()
        await context.scenes.catch_up()
        with trio.move_on_after(JOIN_WAIT_S):
            await context.gossip.everybody_heard()
            await self._line_tiled()
        context.joined.set()

    async def _line_tiled(self) -> None:
        """Return once the members' arcs tile the line: a founder's first words may come before it took its seat."""
        pause_s = TILING_LOOK_S
        # Looked at ever more rarely, and not at each status: among a thousand nodes a look takes a millisecond.
        while not self.context.gossip.is_line_tiled():
            await self.context.world.clock.sleep(pause_s)
            pause_s *= 2

    async def _watch_load(self) -> None:
        context = self.context
        while True:
            recovers = self._recovers()
            used, total = await self._load.look()
            context.own.update(disk_used_bytes=used, disk_total_bytes=total)
            context.own.recovers = recovers or self._recovers()
            await context.world.clock.sleep(LOAD_S)
