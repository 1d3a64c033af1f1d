"""Public scene headers: decided, kept by all, fetched by whoever lacks one (specs/16-scene-log.md).

As long as a scene's header names no participants, the node that it names as origin decides alone what the next position is and signs that,
persists header and sealed log in one transaction, and pushes the header to all; then its participants do (participation.py). Who was away pulls
the header from others, once for all who wait. It shows that it was decided, so it counts whoever shows it. The log is opaque here.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import trio

from scenefold.base.errors import NotReached, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.beginning import catch_up, load_headers
from scenefold.peer.scene_log.changes import Changes
from scenefold.peer.scene_log.first_look import FirstLook
from scenefold.peer.scene_log.headers import FIRST_POSITION, checked_header
from scenefold.peer.scene_log.makers import begun_by, check_maker, check_room
from scenefold.peer.scene_log.participation import Participation
from scenefold.peer.scene_log.proposals import accepted, answer_of, decide, rejection, said_of_ended
from scenefold.peer.scene_log.proposing import Proposing
from scenefold.peer.scene_log.pull import Pull
from scenefold.peer.scene_log.scene_asking import listed_by, tell_all
from scenefold.peer.scene_log.scene_run import CATCH_UP_S, SceneRun
from scenefold.scene.log.decisions import hash_of_log
from scenefold.scene.log.values import deciding
from scenefold.store import Store
from scenefold.wire import (
    ListScenes,
    Packet,
    ProposeSceneLog,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    SceneMode,
    Want,
    page_of,
)
from scenefold.world import Priority, QuietLog, World

RELAY_S_MAX = 10.0

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class Scenes:
    """The scenes that this node knows. Used from the Trio thread only."""

    def __init__(
        self,
        world: World,
        store: Store,
        peers: Peers,
        own: OwnStatus,
        voter: NodeId,
        may_make: Callable[[PublicKey], bool],
        check_new: Callable[[SceneLogPublic], None],
        participation: Participation | None = None,
    ) -> None:
        """`participation`: runs the logs in which this node takes part; None: it takes part in none. `voter`: the one node where scenes begin. `may_make`: whether the holder of a signing key may make them. `check_new`: Refused for a
        header of a scene that is unknown here, and that did not begin there."""
        self._voter = voter
        self._check_new = check_new
        self._may_make = may_make
        self._world = world
        self._store = store
        self._peers = peers
        self._own = own
        self._known: dict[SceneId, KnownScene] = {}
        self._pull = Pull(world, peers, self._known.get, self._try_adopt)
        self._first_look = FirstLook(world, peers, self._try_adopt)
        self._participation = participation
        self._proposing = None if participation is None else Proposing(world, peers, own.me, participation)
        self._changes = Changes() if participation is None else participation.changes
        self._lock = trio.Lock()
        self._quiet, self._quiet_info = QuietLog(_log), QuietLog(_log, logging.INFO)

    def register(self, handlers: Handlers) -> None:
        """Packet 37. Those of logs, 5, 6 and 118, are the cluster's too: its log hands on what is not its own."""
        handlers.add(ListScenes, self._on_list)

    async def load(self) -> None:
        """Read what this node kept from before. The keeper of a log must not forget how far it is: DamagedData."""
        self._known.update(await load_headers(self._store))

    async def catch_up(self) -> None:
        """Take the list of scenes of the first other member that answers; tell what this node decided and that list lacks."""
        await catch_up(self._peers, self._own.me, self.take_list, self._known)

    async def _try_adopt(self, public: SceneLogPublic, source: str) -> None:
        try:
            await self.adopt(public, within_s=0.0)
        except Refused as refusal:
            text = f"the header of scene {public.scene:08x} is not taken: {refusal}"
            if refusal.reason in (RejectReason.POSITION_BEHIND, RejectReason.NOT_READY):
                # The usual course of things between nodes that push and pull.
                _log.debug("%s: %s", source, text)
            else:
                self._quiet.say(self._world.clock.now(), source, refusal.reason.name, text)

    async def take_list(self, member: NodeId) -> Sequence[SceneLogPublic] | None:
        """Take what a member lists; None if it does not say."""
        try:
            listed = await listed_by(self._peers, member)
        except (Unreachable, Refused, PeerFault):
            return None
        for public in listed:
            await self._try_adopt(public, address_of(member))
        return listed

    async def known(self, scene: SceneId, *, position: int = 0, ask: bool = True, asker: str = "") -> KnownScene:
        """The scene, at this log position or later if anybody is so far; Refused (19) if nobody knows it.

        `asker`: the peer for which others would be asked; Refused (13) if it is unknown here and he has had them asked too often.
        """
        found, was_looked_for = self._known.get(scene), True
        if ask and (found is None or found.public.position < position):
            was_looked_for = await self._pull.until(scene, position, asker)
            one = self._run_of(scene)
            if one is not None and one.public.position < position <= one.shown_position:
                await one.come_to(position, CATCH_UP_S)
            found = self._known.get(scene)
        if found is None and not was_looked_for:
            what = f"scene {scene:08x} is unknown here, and the other nodes were asked for too many lately"
            raise Refused(RejectReason.BUSY, what, remedy="see that the scene is one of this cluster, or try again in a while")
        if found is None:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"scene {scene:08x} is unknown in this cluster")
        return found

    def all(self) -> list[SceneLogPublic]:
        """The headers of all known scenes, by id."""
        return [self._known[scene].public for scene in sorted(self._known)]

    def everyone(self) -> Sequence[KnownScene]:
        return list(self._known.values())

    def here(self, scene: SceneId) -> KnownScene | None:
        """What this node itself has of it, at this moment."""
        return self._known.get(scene)

    async def adopt(self, public: SceneLogPublic, *, within_s: float = CATCH_UP_S) -> KnownScene:
        """Verify a header and keep it durably; Refused if it must not be. One at a time.

        Where this node runs the scene's log, that has to come so far within the time; Refused (16) if it does not.
        """
        await self._keep(public)
        one = self._run_of(public.scene)
        if one is not None:
            await one.insist(public.position, within_s)
        return self._known[public.scene]

    async def _keep(self, public: SceneLogPublic) -> None:
        """Verified and durable, or shown to the log that it is to come by."""
        async with self._lock:
            before = self._known.get(public.scene)
            if before is not None and before.public == public:
                return
            if before is None:
                self._check_new(public)
                check_room(self._known.values(), is_ended=public.mode is SceneMode.ENDED)
            scene = await self._world.workers.run("crypto", checked_header, public, before)
            one = self._run_of(public.scene)
            if one is not None:
                one.shown(scene)
                return
            alone = before is not None and deciding(before.public) == {self._own.me} and not before.public.participants
            if before is not None and alone and await self._log_of(before.public) is not None:
                # Only an older disk forgets what was decided. The log that is here goes with the header of before.
                _log.warning("scene %08x: this node has decided position %d and forgotten it", public.scene, public.position)
            with trio.CancelScope(shield=True):
                # It may be durable though this is cancelled: then an older one would be kept after it, or another one be decided beside it.
                await self._store.put_header(public.scene, public.encode())
                self.take(scene)

    async def _decide(self, packet: ProposeSceneLog) -> KnownScene:
        self._check_changes(packet)
        if not self._first_look.was_taken(packet.public.scene):
            # What is refused anyway need not trouble the others.
            before = self._known.get(packet.public.scene)
            if await self._judged(packet, before) is not before:
                await self._first_look.take(packet.public.scene)
        async with self._lock:
            self._check_changes(packet)
            known = self._known.get(packet.public.scene)
            scene = await self._judged(packet, known)
            if scene is not known:
                with trio.CancelScope(shield=True):
                    await self._store.put_scene_log(packet.public.scene, scene.public.encode(), packet.private)
                    self.take(scene)
                if known is not None:
                    self._changes.count(known, scene.public, self._world.clock.now())
            return scene

    def _check_changes(self, packet: ProposeSceneLog) -> None:
        """Before anything is looked at that takes time."""
        known = self._known.get(packet.public.scene)
        if known is not None:
            self._changes.check(known, packet.public, self._world.clock.now())

    async def _judged(self, packet: ProposeSceneLog, known: KnownScene | None) -> KnownScene:
        """What is to be kept if this is decided; `known` if it was decided before. Refused if it must not be."""
        has_log = known is not None and await self._log_of(known.public) is not None
        judging = partial(decide, packet, known, self._own.key, has_log=has_log)
        scene: KnownScene = await self._world.workers.run("crypto", judging)
        if known is None:
            check_room(self._known.values())
            if self._own.me != self._voter:
                # At several nodes at once a user would have the quota of each.
                raise Refused(RejectReason.NOT_AUTHORISED, "new scenes are decided by the cluster's first voter")
            check_maker(scene, begun_by(self._own.me, self._own.key.public, self._known.values()), self._may_make)
        return scene

    def take(self, scene: KnownScene) -> None:
        """A header that is durable here is the newest."""
        self._known[scene.public.scene] = scene
        self._pull.found(scene.public.scene)
        if self._participation is not None:
            self._participation.meets(scene)

    def _run_of(self, scene: SceneId) -> SceneRun | None:
        return None if self._participation is None else self._participation.of(scene)

    async def _log_of(self, public: SceneLogPublic) -> bytes | None:
        """The sealed log of this header, if this node keeps it: a disk that was lost has none, or that of a header before."""
        private = await self._store.get_scene_log(public.scene)
        if private is None or await self._world.workers.run("crypto", hash_of_log, private) != public.log_hash:
            return None
        return private

    # ------------------------------------------------------------------------------------------------- handlers

    async def on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet:
        """118: decide, if this node is the scene's origin; hand a user's proposal on to it otherwise."""
        known = self._known.get(packet.public.scene)
        if known is None and node_of(peer) is None and packet.public.position > FIRST_POSITION:
            with suppress(Refused):
                known = await self.known(packet.public.scene, asker=peer)
        if known is not None and known.is_ended:
            return said_of_ended(packet, known.public, self._own.me)
        if known is not None and known.public.participants and self._proposing is not None:
            return await self._proposing.answer(packet, known, peer)
        origin = packet.public.origin if known is None else known.public.origin
        if origin != self._own.me:
            if node_of(peer) is not None:
                return rejection(RejectReason.NOT_MY_LOCATION, origin)
            if origin not in self._peers.others():
                return rejection(RejectReason.NOT_AUTHORISED, origin)
            try:
                return await self._peers.ask(origin, Priority.HIGH, packet, Packet, RELAY_S_MAX)
            except NotReached:
                # Nothing of it has left, so nobody need doubt whether it was decided.
                return rejection(RejectReason.PEER_MISSED, origin)
        try:
            scene = await self._decide(packet)
        except Refused as refusal:
            self._quiet_info.say(self._world.clock.now(), peer, refusal.reason.name, f"a scene proposal is refused: {refusal}")
            return rejection(refusal.reason, self._own.me)
        await tell_all(self._peers, scene.public)
        return accepted(scene.public)

    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet | None:
        """5: the newest header, and the sealed log with it if that was asked for and is kept here. Refused (13) if others had to be asked for it, and were not."""
        if packet.want is Want.DECIDED:
            return None if self._participation is None else await self._participation.on_request(packet, peer)
        if packet.want in (Want.LEASE, Want.CONSENT) and self._participation is not None:
            return await self._participation.on_lease(packet, peer)
        try:
            # Nodes that ask each other must not set off a round of asking: only users' questions do.
            scene = await self.known(packet.scene, position=packet.have, ask=node_of(peer) is None, asker=peer)
        except Refused as refusal:
            if refusal.reason is RejectReason.BUSY:
                # Nil says that nobody knows the scene, and nobody was asked.
                raise
            return RespondSceneLog(answer=None)
        if packet.genesis not in (b"", scene.public.genesis):
            return RespondSceneLog(answer=None)
        if packet.want is not Want.LOG:
            return RespondSceneLog(answer=answer_of(scene.public, packet.nonce, None))
        if self._participation is not None and (kept := await self._participation.sealed_log(packet.scene)) is not None:
            return RespondSceneLog(answer=answer_of(kept[0], packet.nonce, kept[1]))
        async with self._lock:
            # Header and log change together, so both are read between two changes.
            public = self._known[packet.scene].public
            private = await self._log_of(public)
        return RespondSceneLog(answer=answer_of(public, packet.nonce, private))

    async def on_push(self, packet: RespondSceneLog, peer: str) -> None:
        """6 that nobody asked for: a header that was decided, or what was decided of some log."""
        if packet.decided is not None and self._participation is not None:
            self._participation.intake.take(packet, peer)
        if packet.answer is not None:
            await self._try_adopt(packet.answer.public, peer)

    async def _on_list(self, packet: ListScenes, _peer: str) -> Packet:
        return page_of(self.all(), packet.after)
