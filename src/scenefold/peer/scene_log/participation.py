"""The logs of scenes in which this node takes part, or did: opened, run, and what comes of them (specs/16-scene-log.md, On nodes)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.limits import DECIDED_MAX, LOG_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Learn
from scenefold.consensus.packets import decided_page, decided_value, scene_of
from scenefold.peer.handlers import node_of
from scenefold.peer.logs.links import NodePorts
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.own_use import OwnUse
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.changes import Changes
from scenefold.peer.scene_log.observations import Observations
from scenefold.peer.scene_log.scene_run import SceneRun
from scenefold.peer.scene_log.telling import Telling
from scenefold.scene.log import hash_of_log, without_log
from scenefold.store import Store
from scenefold.store.log_rows import Decided
from scenefold.wire import DecidedLog, Member, Packet, RequestSceneLog, RespondSceneLog, SceneLogPublic, Want
from scenefold.world import World


class Keeps(Protocol):
    """Who keeps all scenes that this node knows (Scenes)."""

    def everyone(self) -> Sequence[KnownScene]: ...
    def here(self, scene: SceneId) -> KnownScene | None: ...
    async def known(self, scene: SceneId, *, position: int) -> KnownScene: ...

    def take(self, scene: KnownScene, /) -> None:
        """A header that is durable here."""


class Participation:
    """`run` it before anybody is answered. Used from the Trio thread only. `lease_begun`: this process has had an owner lease."""

    def __init__(self, world: World, store: Store, peers: Peers, own: OwnStatus, ports: NodePorts, lease_begun: trio.Event) -> None:
        self._world, self._store, self._peers, self._own, self._ports = world, store, peers, own, ports
        self.intake = ports.intake
        self.intake.watch = self._on_packet
        self.observations = Observations(world, peers, own)
        """Scenes in which this node decides nothing, and holds leases."""
        self.intake.watches = self.observations.watches
        self.changes = Changes()
        """Of all scenes, by whomever they were decided."""
        self.on_end: Callable[[], object] = lambda: None
        """Told when a header is kept that says that its scene was ended."""
        self._lease_begun, self._may_speak = lease_begun, False
        self._runs: dict[SceneId, SceneRun] = {}
        self._kept: frozenset[bytes] = frozenset()
        self._nursery: trio.Nursery | None = None
        self._telling: Telling | None = None
        self._scenes: Keeps | None = None

    async def run(self, scenes: Keeps, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Started once all logs of scenes that `scenes` knows are open. An error of the disk ends it, and with that the node."""
        self._scenes = scenes
        self._kept = await self._store.logs_kept()
        async with trio.open_nursery() as nursery:
            self._telling = Telling(nursery, self._peers)
            for known in scenes.everyone():
                self.meets(known)
            nursery.start_soon(self.observations.run, scenes.known)
            nursery.start_soon(self._speak)
            async with trio.open_nursery() as opening:
                for one in self._runs.values():
                    opening.start_soon(nursery.start, one.run)
            self._nursery = nursery
            task_status.started()
            try:
                await trio.sleep_forever()
            finally:
                # What is heard while the node ends begins nothing any more.
                self._nursery = self._telling = None

    def meets(self, known: KnownScene) -> None:
        """This is the newest header of a scene here: run its log from now on, if this node takes part in it, or has."""
        public = known.public
        if known.is_ended:
            self.on_end()
        if public.scene in self._runs or self._scenes is None or self._store.has_let_go(public.scene):
            return
        is_mine = any(entry.member == self._own.member for entry in public.participants)
        if is_mine or (public.participants and public.genesis in self._kept):
            # Its log says from now on what it may do there.
            self.observations.leave(public)
            is_new = public.genesis not in self._kept
            one = SceneRun(
                self._world,
                self._store,
                self._peers,
                self._own,
                self._ports,
                known,
                self._has_decided,
                may_speak=lambda: self._may_speak,
                is_new=is_new,
            )
            self._runs[public.scene] = one
            if self._nursery is not None:
                self._nursery.start_soon(one.run)
        else:
            self.observations.meets(public)

    async def _speak(self) -> None:
        """A disk that was put back has forgotten votes, so in each process nothing is decided before the cluster's voters know this one for
        no older one. From then on it knows by itself what it has said, whatever becomes of its lease."""
        await self._lease_begun.wait()
        self._may_speak = True
        for one in self.everyone():
            one.restate()

    async def end(self, scene: SceneId) -> None:
        """Nothing is decided of a scene any more, nor told; returns once nothing more of its log is written."""
        self.observations.end(scene)
        one = self._runs.pop(scene, None)
        if one is not None:
            await one.stop()

    def of(self, scene: SceneId) -> SceneRun | None:
        """The scene's log here; None if this node never took part in it."""
        return self._runs.get(scene)

    def modes_of(self, scene: SceneId) -> SceneModes | None:
        """Who may act in which mode, where this node decides the scene's next position."""
        one = self._runs.get(scene)
        return None if one is None or not one.takes_part else one.modes

    def own_use(self, scene: SceneId) -> OwnUse | None:
        """What this node does by its own lease of a scene, if it observes that."""
        one = self._runs.get(scene) or self.observations.of(scene)
        return one.modes.own_use if one is not None and one.modes.own_use.is_observer else None

    def everyone(self) -> Sequence[SceneRun]:
        return list(self._runs.values())

    def _has_decided(self, one: SceneRun, known: KnownScene, decided: Decide | None) -> None:
        assert self._scenes is not None
        before = self._scenes.here(known.public.scene)
        self._scenes.take(known)
        if decided is None or before is None:
            return
        self.changes.count(before, known.public, self._world.clock.now())
        if decided.certificate.ballot.node == self._own.me and self._telling is not None:
            # Those who decided it, and decide on, hear of it as a decision; a node that lost its disk does not.
            deciding = _members_of(before.public) & _members_of(known.public)
            self._telling.tell(known.public, {member.node for member in deciding if self._ports.around.is_current(member)})

    # -------------------------------------------------------------------------------------------------- questions

    async def sealed_log(self, scene: SceneId) -> tuple[SceneLogPublic, bytes | None] | None:
        """Header and sealed log as they are on the disk, of one position; None if this node does not run the scene's log."""
        one = self._runs.get(scene)
        if one is None:
            return None
        kept = await self._store.scene_with_log(scene)
        if kept is None:
            return one.public, None
        public = SceneLogPublic.decode(kept[0])
        is_its_own = await self._world.workers.run("crypto", hash_of_log, kept[1]) == public.log_hash
        return public, kept[1] if is_its_own else None

    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None:
        """5 (DECIDED): one that goes one way is a node's, for the log; the others are answered."""
        if packet.request_id:
            return RespondSceneLog(None, await self._decisions(packet))
        self.intake.take(packet, peer)
        return None

    async def on_lease(self, packet: RequestSceneLog, peer: str) -> Packet:
        """5 (LEASE, CONSENT) of a node; Refused (12) where this one decides nothing of that scene, or observes nothing of it."""
        if packet.want is Want.CONSENT:
            return self._on_consent(packet, peer)
        one, asker = self._runs.get(packet.scene), node_of(peer)
        if one is None or asker is None or not one.takes_part or packet.genesis != one.public.genesis:
            raise Refused(RejectReason.NOT_AUTHORISED, "leases of a scene are granted to nodes, by its participants")
        return await one.modes.on_lease(packet, asker)

    def _on_consent(self, packet: RequestSceneLog, peer: str) -> Packet:
        use, asker = self.own_use(packet.scene), node_of(peer)
        if use is None or asker is None:
            raise Refused(RejectReason.NOT_AUTHORISED, "this node does not observe the scene")
        return use.consents(packet, asker)

    def _on_packet(self, genesis: bytes, packet: Packet) -> None:
        """Of a node that takes part in a log, or may."""
        one = self._runs.get(scene_of(genesis))
        if one is not None and one.public.genesis == genesis:
            one.modes.shown(packet)
        elif one is None:
            self.observations.shown(packet, genesis)

    async def _decisions(self, packet: RequestSceneLog) -> DecidedLog | None:
        """For people: what is kept of what was decided above a position, who voted for it, and when this node learnt it."""
        one = self._runs.get(packet.scene)
        if one is None or packet.genesis not in (b"", one.public.genesis):
            return None
        genesis, newest = one.public.genesis, one.public.position
        if packet.have >= newest:
            return DecidedLog(genesis, newest, ())
        rows = await self._store.kept_decisions(genesis, packet.have, DECIDED_MAX, LOG_BYTES_MAX)
        seen = {row.position: one.seen.get(row.position, 0) for row in rows}
        return await self._world.workers.run("crypto", _told, genesis, newest, rows, seen)


def _told(genesis: bytes, newest: int, rows: Sequence[Decided], seen: Mapping[int, int]) -> DecidedLog:
    """A page of these without their sealed logs. Takes a while: each header is opened for that."""
    values = (decided_value(Learn(genesis, row.position, without_log(row.value), row.certificate)) for row in rows)
    return decided_page(genesis, newest, (replace(value, seen=seen[value.position]) for value in values))


def _members_of(public: SceneLogPublic) -> set[Member]:
    return {entry.member for entry in public.participants}
