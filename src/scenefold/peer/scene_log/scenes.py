"""Public scene headers: decided by one node, kept by all, fetched by whoever lacks one (specs/16-scene-log.md).

For now a scene's log has one participant: the node that its headers name as origin, for the scene's whole life. It decides
alone what the next position is and signs that, persists header and sealed log in one transaction, and pushes the header to all
members. A node that was away meets the scene's id or a newer position in a request, or in the list that it asks for at its start,
and pulls the header from others, once for all who wait. A header shows that it was decided, so it counts whoever shows it. The
log is opaque here: whoever holds the scene's key opens it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.changes import Changes
from scenefold.peer.scene_log.first_look import FirstLook
from scenefold.peer.scene_log.headers import checked_header
from scenefold.peer.scene_log.makers import check_maker
from scenefold.peer.scene_log.proposals import accepted, answer_of, decide, rejection
from scenefold.peer.scene_log.pull import Pull
from scenefold.peer.scene_log.scene_asking import listed_by, tell_all
from scenefold.scene.log.decisions import hash_of_log
from scenefold.store import Store
from scenefold.wire import (
    ListScenes,
    MalformedPacket,
    Packet,
    ProposeSceneLog,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
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
    ) -> None:
        """`voter`: the one node where scenes begin. `may_make`: whether the holder of a signing key may make them. `check_new`: Refused for a
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
        self._changes = Changes()
        self._lock = trio.Lock()
        self._quiet, self._quiet_info = QuietLog(_log), QuietLog(_log, logging.INFO)

    def register(self, handlers: Handlers) -> None:
        """Packet 37. Those of logs, 5, 6 and 118, are the cluster's too: its log hands on what is not its own."""
        handlers.add(ListScenes, self._on_list)

    async def load(self) -> None:
        """Read what this node kept from before.

        A header that does not verify any more is left out: others have it, and it is pulled when the scene is met. But the
        keeper of a log must not forget how far it is: DamagedData.
        """
        for scene, header in (await self._store.headers()).items():
            try:
                self._known[scene] = checked_header(SceneLogPublic.decode(header), None)
            except (MalformedPacket, Refused) as problem:
                where = f"scene {scene:08x}: {problem}"
                if await self._store.get_scene_log(scene) is not None:
                    remedy = "restore the data folder from a backup, or start with an empty one; the scene's spaces stand still then"
                    raise DamagedData("the header of a scene whose log is kept here is damaged", where=where, remedy=remedy) from problem
                _log.error("a damaged scene header is dropped and asked for again: %s", where)

    async def catch_up(self) -> None:
        """Take the list of scenes of the first other member that answers; tell what this node decided and that list lacks."""
        for member in self._peers.others():
            listed = await self.take_list(member)
            if listed is None:
                continue
            for origin in sorted({public.origin for public in listed} - {member}):
                # What was shown was decided, and may be old: who decides knows.
                if origin in self._peers.others():
                    await self.take_list(origin)
            told = {public.scene: public.position for public in listed}
            for scene in self.decided_by(self._own.me):
                # It may have died between deciding and telling.
                public = self._known[scene].public
                if told.get(scene, 0) < public.position:
                    await tell_all(self._peers, public)
            return

    async def _try_adopt(self, public: SceneLogPublic, source: str) -> None:
        try:
            await self.adopt(public)
        except Refused as refusal:
            text = f"the header of scene {public.scene:08x} is not taken: {refusal}"
            if refusal.reason is RejectReason.POSITION_BEHIND:
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

    def decided_by(self, node: NodeId) -> list[SceneId]:
        """The scenes whose log that node decides and keeps, by id."""
        return sorted(scene for scene, known in self._known.items() if known.public.origin == node)

    async def adopt(self, public: SceneLogPublic) -> KnownScene:
        """Verify a header and keep it durably; Refused if it must not be. One at a time."""
        async with self._lock:
            before = self._known.get(public.scene)
            if before is not None and before.public == public:
                return before
            if before is None:
                self._check_new(public)
            self._check_room(before)
            scene = await self._world.workers.run("crypto", checked_header, public, before)
            if public.origin == self._own.me and before is not None and await self._log_of(before.public) is not None:
                # Only an older disk forgets what was decided. The log that is here goes with the header of before.
                _log.warning("scene %08x: this node has decided position %d and forgotten it", public.scene, public.position)
            await self._store.put_header(public.scene, public.encode())
            self._take(scene)
            return scene

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
                await self._store.put_scene_log(packet.public.scene, scene.public.encode(), packet.private)
                self._take(scene)
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
            self._check_room(known)
            if self._own.me != self._voter:
                # At several nodes at once a user would have the quota of each.
                raise Refused(RejectReason.NOT_AUTHORISED, "new scenes are decided by the cluster's first voter")
            check_maker(scene, self._decided_here(), self._may_make)
        return scene

    def _decided_here(self) -> list[KnownScene]:
        """Whose maker this node has looked at. Who decides elsewhere can name any user in its headers."""
        mine = self._own.key.public.raw
        return [known for known in self._known.values() if known.public.origin == self._own.me and known.public.origin_key == mine]

    def _check_room(self, before: KnownScene | None) -> None:
        if before is None and len(self._known) >= SCENES_LISTED_MAX:
            raise Refused(RejectReason.LIMIT_EXCEEDED, f"this cluster holds {SCENES_LISTED_MAX} scenes already")

    def _take(self, scene: KnownScene) -> None:
        self._known[scene.public.scene] = scene
        self._pull.found(scene.public.scene)

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
        origin = packet.public.origin if known is None else known.public.origin
        if origin != self._own.me:
            if node_of(peer) is not None:
                return rejection(RejectReason.NOT_MY_LOCATION, origin)
            if origin not in self._peers.others():
                return rejection(RejectReason.NOT_AUTHORISED, origin)
            return await self._peers.ask(origin, Priority.HIGH, packet, Packet, RELAY_S_MAX)
        try:
            scene = await self._decide(packet)
        except Refused as refusal:
            self._quiet_info.say(self._world.clock.now(), peer, refusal.reason.name, f"a scene proposal is refused: {refusal}")
            return rejection(refusal.reason, self._own.me)
        await tell_all(self._peers, scene.public)
        return accepted(scene.public)

    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet:
        """5: the newest header, and the sealed log with it if that was asked for and is kept here. Refused (13) if others had to be asked for it, and were not."""
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
        async with self._lock:
            # Header and log change together, so both are read between two changes.
            public = self._known[packet.scene].public
            private = await self._log_of(public)
        return RespondSceneLog(answer=answer_of(public, packet.nonce, private))

    async def on_push(self, packet: RespondSceneLog, peer: str) -> None:
        """6 that nobody asked for: a header that was decided."""
        if packet.answer is not None:
            await self._try_adopt(packet.answer.public, peer)

    async def _on_list(self, packet: ListScenes, _peer: str) -> Packet:
        return page_of(self.all(), packet.after)
