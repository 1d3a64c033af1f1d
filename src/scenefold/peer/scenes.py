"""Public scene headers: decided by one node, kept by all, fetched by whoever lacks one (specs/16-scene-log.md).

For now a scene's log has one participant: the node that its headers name as origin, for the scene's whole life. It decides
alone what the next position is, persists header and sealed log in one transaction, and pushes the header to all members. A
node that was away meets the scene's id or a newer position in a request, or in the list that it asks for at its start, and
pulls the header from others, once for all who wait. The log is opaque here: whoever holds the scene's key opens it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.headers import checked_header
from scenefold.peer.peers import Peers
from scenefold.peer.proposals import answer_of, is_decided, rejection
from scenefold.peer.scene_asking import ASK_S_MAX, listed_by, shown_by
from scenefold.peer.status import OwnStatus
from scenefold.peer.verification import KnownScene
from scenefold.store import Store
from scenefold.wire import (
    AcceptSceneProposal,
    ListScenes,
    MalformedPacket,
    Member,
    Packet,
    ProposeSceneLog,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    Want,
    hash_of_record,
    page_of,
)
from scenefold.world import Priority, World

RELAY_S_MAX = 10.0
MISS_S = 1.0
"""A scene that nobody knows is not asked for again within this time: unknown ids must not multiply requests."""

_log = logging.getLogger("scenefold.peer.scenes")


class Scenes:
    """The scenes that this node knows. Used from the Trio thread only."""

    def __init__(self, world: World, store: Store, peers: Peers, own: OwnStatus) -> None:
        self._world = world
        self._store = store
        self._peers = peers
        self._own = own
        self._known: dict[SceneId, KnownScene] = {}
        self._missed_at: dict[SceneId, float] = {}
        self._pulls: dict[SceneId, trio.Event] = {}
        self._lock = trio.Lock()

    def register(self, handlers: Handlers) -> None:
        """Packet 37. Those of logs, 5 to 7, are the cluster's too: its log hands on what is not its own."""
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
            try:
                listed = await listed_by(self._peers, member)
            except (Unreachable, Refused, PeerFault):
                continue
            silent: set[NodeId] = set()
            for public in listed:
                await self._adopt_shown(public, member, silent)
            told = {public.scene: public.position for public in listed}
            for scene in self.decided_by(self._own.me):
                # It may have died between deciding and telling.
                public = self._known[scene].public
                if told.get(scene, 0) < public.position:
                    await self._push(public)
            return

    async def known(self, scene: SceneId, *, position: int = 0, ask: bool = True) -> KnownScene:
        """The scene, at this log position or later if anybody is so far; Refused (19) if nobody knows it."""
        found = self._known.get(scene)
        if ask and (found is None or found.public.position < position):
            await self._pull(scene, position)
            found = self._known.get(scene)
        if found is None:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"scene {scene:08x} is unknown in this cluster")
        return found

    def all(self) -> list[SceneLogPublic]:
        """The headers of all known scenes, by id."""
        return [self._known[scene].public for scene in sorted(self._known)]

    def everyone(self) -> Sequence[KnownScene]:
        return list(self._known.values())

    def decided_by(self, node: NodeId) -> list[SceneId]:
        """The scenes whose log that node decides and keeps, by id."""
        return sorted(scene for scene, known in self._known.items() if known.public.origin == node)

    async def adopt(self, public: SceneLogPublic) -> KnownScene:
        """Verify a header and keep it durably; Refused if it must not be. One at a time."""
        async with self._lock:
            return await self._adopt(public, None)

    async def _adopt(self, public: SceneLogPublic, private: bytes | None) -> KnownScene:
        """Under the lock. `private`: the sealed log of this position, if this node is to keep it."""
        before = self._known.get(public.scene)
        if before is None and len(self._known) >= SCENES_LISTED_MAX:
            raise Refused(RejectReason.LIMIT_EXCEEDED, f"this cluster holds {SCENES_LISTED_MAX} scenes already")
        if before is not None and before.public == public:
            return before
        scene = await self._world.workers.run("crypto", checked_header, public, before)
        if private is None:
            if before is not None and public.position > before.public.position and await self._keeps_log(before.public):
                # An owner's header that was only proposed is as well signed. Taken here, it would leave its log behind for ever.
                raise Refused(RejectReason.NOT_AUTHORISED, "this node keeps the scene's log, and has not decided so")
            await self._store.put_header(public.scene, public.encode())
        else:
            await self._store.put_scene_log(public.scene, public.encode(), private)
        self._known[public.scene] = scene
        self._missed_at.pop(public.scene, None)
        return scene

    async def _keeps_log(self, public: SceneLogPublic) -> bool:
        return public.origin == self._own.me and await self._store.get_scene_log(public.scene) is not None

    # ------------------------------------------------------------------------------------------------- handlers

    async def on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet:
        """7: decide, if this node is the scene's origin; hand a user's proposal on to it otherwise."""
        known = self._known.get(packet.public.scene)
        origin = packet.public.origin if known is None else known.public.origin
        if origin != self._own.me:
            if node_of(peer) is not None:
                return rejection(packet, RejectReason.NOT_MY_LOCATION, origin)
            if origin not in self._peers.others():
                return rejection(packet, RejectReason.NOT_AUTHORISED, origin)
            return await self._peers.ask(origin, Priority.HIGH, packet, Packet, RELAY_S_MAX)
        try:
            scene = await self._decide(packet)
        except Refused as refusal:
            _log.info("scene proposal of %s refused: %s", peer, refusal)
            return rejection(packet, refusal.reason, self._own.me)
        await self._push(scene.public)
        return AcceptSceneProposal(
            genesis=packet.genesis,
            proposal=packet.proposal,
            record_hash=hash_of_record(packet.private),
            nodes=(Member(self._own.me, self._own.incarnation),),
            highest=None,
            mac_epoch=0,
            mac=b"",
        )

    async def _decide(self, packet: ProposeSceneLog) -> KnownScene:
        async with self._lock:
            known = self._known.get(packet.public.scene)
            private = None if known is None else await self._store.get_scene_log(packet.public.scene)
            if is_decided(packet, None if known is None else known.public, private):
                assert known is not None
                if private is None:
                    # Its first header was told here before it was proposed.
                    await self._store.put_scene_log(packet.public.scene, packet.public.encode(), packet.private)
                return known
            return await self._adopt(packet.public, packet.private)

    async def on_request(self, packet: RequestSceneLog, peer: str) -> Packet:
        """5: the newest header, and the sealed log with it if that was asked for and is kept here."""
        try:
            # Nodes that ask each other must not set off a round of asking: only users' questions do.
            scene = await self.known(packet.scene, position=packet.have, ask=node_of(peer) is None)
        except Refused:
            return RespondSceneLog(answer=None)
        if packet.genesis not in (b"", scene.public.genesis):
            return RespondSceneLog(answer=None)
        if packet.want is not Want.LOG:
            return RespondSceneLog(answer=answer_of(scene.public, packet.nonce, None))
        async with self._lock:
            # Header and log change together, so both are read between two changes.
            public = self._known[packet.scene].public
            private = await self._store.get_scene_log(packet.scene)
        return RespondSceneLog(answer=answer_of(public, packet.nonce, private))

    async def on_push(self, packet: RespondSceneLog, peer: str) -> None:
        """6 that nobody asked for: a header that was decided, by the word of the node that decides."""
        if packet.answer is None:
            return
        if node_of(peer) != packet.answer.public.origin:
            _log.warning("header of scene %08x from %s not taken: another node decides", packet.answer.public.scene, peer)
            return
        await self._try_adopt(packet.answer.public, peer)

    async def _on_list(self, packet: ListScenes, _peer: str) -> Packet:
        return page_of(self.all(), packet.after)

    # ------------------------------------------------------------------------------------------------ the others

    async def _pull(self, scene: SceneId, position: int) -> None:
        """Ask the others for a header of this position or later; one round at a time for each scene, whoever needs it."""
        while not self._is_known(scene, position):
            missed_at = self._missed_at.get(scene)
            if missed_at is not None and self._world.clock.now() - missed_at < MISS_S:
                return
            running = self._pulls.get(scene)
            if running is None:
                break
            await running.wait()
        else:
            return
        done = self._pulls[scene] = trio.Event()
        try:
            await self._ask_around(scene, position)
        finally:
            del self._pulls[scene]
            done.set()

    async def _ask_around(self, scene: SceneId, position: int) -> None:
        request = RequestSceneLog(scene=scene, genesis=b"", have=position, nonce=0, want=Want.HEADER)
        known = self._known.get(scene)
        silent: set[NodeId] = set()
        for member in self._peers.others(first=None if known is None else known.public.origin):
            public = await shown_by(self._peers, member, request)
            if public is None:
                silent.add(member)
                continue
            was_decided = await self._adopt_shown(public, member, silent)
            if self._is_known(scene, position):
                return
            if was_decided:
                break  # What the node that decides does not know, there is not.
        if len(self._missed_at) > SCENES_LISTED_MAX:
            self._missed_at.clear()
        self._missed_at[scene] = self._world.clock.now()

    async def _adopt_shown(self, public: SceneLogPublic, member: NodeId, silent: set[NodeId]) -> bool:
        """Take a header that a member shows; if it is news, what the node that decides says of it, unless that is silent.

        An owner's header that was only proposed is as well signed as one that was decided. True if the node that decides was heard.
        """
        origin = public.origin
        is_news = not self._is_known(public.scene, public.position)
        if is_news and member != origin and origin not in silent and origin in self._peers.others():
            decided = await shown_by(self._peers, origin, RequestSceneLog(public.scene, b"", 0, 0, Want.HEADER))
            if decided is None:
                silent.add(origin)
            else:
                public, member = decided, origin
        await self._try_adopt(public, address_of(member))
        return member == origin

    def _is_known(self, scene: SceneId, position: int) -> bool:
        found = self._known.get(scene)
        return found is not None and found.public.position >= position

    async def _push(self, public: SceneLogPublic) -> None:
        """Tell all others, waiting a bounded time. Whoever misses it pulls it later."""
        packet = RespondSceneLog(answer=answer_of(public, 0, None))

        async def tell(member: NodeId) -> None:
            try:
                await self._peers.tell(member, Priority.HIGH, packet, ASK_S_MAX)
            except Unreachable as problem:
                _log.info("scene %08x not told to %s: %s", public.scene, address_of(member), problem)

        async with trio.open_nursery() as nursery:
            for member in self._peers.others():
                nursery.start_soon(tell, member)

    async def _try_adopt(self, public: SceneLogPublic, source: str) -> None:
        try:
            await self.adopt(public)
        except Refused as refusal:
            # Being told of an older position is the usual course of things between nodes that push and pull.
            level = logging.DEBUG if refusal.reason is RejectReason.POSITION_BEHIND else logging.WARNING
            _log.log(level, "header of scene %08x from %s not taken: %s", public.scene, source, refusal)
