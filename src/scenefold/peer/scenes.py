"""Public scene headers: decided by one node, kept by all, fetched by whoever lacks one (specs/11-peers.md).

For now a scene's log has one voter: the owner of the place that the scene id hashes to. It decides alone whether a
first header is the scene's, persists it, and pushes it to all members. A node that was away meets the scene's id in a
request, or in the list that it asks for at its start, and pulls the header from others. The private part of a log is
opaque here; the decider keeps it for those who can open it.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_LISTED_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.headers import FIRST_POSITION, checked_header, decider_location
from scenefold.peer.peers import Peers
from scenefold.peer.routing import Routing
from scenefold.peer.status import OwnStatus
from scenefold.peer.verification import KnownScene
from scenefold.store import Store
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    ListScenes,
    MalformedPacket,
    Member,
    Packet,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    ScenesListed,
    Want,
)
from scenefold.world import Priority, World

ASK_S_MAX = 2.0
"""For one node to answer about a scene; the next one is asked then."""
RELAY_S_MAX = 10.0
MISS_S = 1.0
"""A scene that nobody knows is not asked for again within this time: unknown ids must not multiply requests."""
COMMIT_FLAG = 2

_log = logging.getLogger("scenefold.peer.scenes")


class Scenes:
    """The scenes that this node knows. Used from the Trio thread only."""

    def __init__(self, world: World, store: Store, peers: Peers, own: OwnStatus, routing: Routing) -> None:
        self._world = world
        self._store = store
        self._peers = peers
        self._own = own
        self._routing = routing
        self._known: dict[SceneId, KnownScene] = {}
        self._missed_at: dict[SceneId, float] = {}
        self._lock = trio.Lock()

    def register(self, handlers: Handlers) -> None:
        handlers.add(ProposeSceneLog, self._on_propose)
        handlers.add(RequestSceneLog, self._on_request)
        handlers.add(RespondSceneLog, self._on_push, senders=Senders.NODES)
        handlers.add(ListScenes, self._on_list)

    async def load(self) -> None:
        """Read what this node kept from before. DamagedData if a header does not verify any more."""
        for header in (await self._store.headers()).values():
            try:
                scene = checked_header(SceneLogPublic.decode(header), None)
            except (MalformedPacket, Refused) as problem:
                raise DamagedData("a stored scene header does not verify", where=str(problem)) from problem
            self._known[scene.public.scene] = scene

    async def catch_up(self) -> None:
        """Take the list of scenes of the first other member that answers."""
        for member in self._peers.others():
            try:
                answer = await self._peers.ask(member, Priority.HIGH, ListScenes(), ScenesListed, ASK_S_MAX)
            except (Unreachable, Refused, PeerFault):
                continue
            for public in answer.scenes:
                await self._try_adopt(public, address_of(member))
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

    async def adopt(self, public: SceneLogPublic) -> KnownScene:
        """Verify a header and keep it durably; Refused if it must not be. One at a time."""
        async with self._lock:
            before = self._known.get(public.scene)
            if before is None and len(self._known) >= SCENES_LISTED_MAX:
                raise Refused(RejectReason.LIMIT_EXCEEDED, f"this cluster holds {SCENES_LISTED_MAX} scenes already")
            if before is not None and before.public == public:
                return before
            scene = await self._world.workers.run("crypto", checked_header, public, before)
            await self._store.put_header(public.scene, public.encode())
            self._known[public.scene] = scene
            self._missed_at.pop(public.scene, None)
            return scene

    # ------------------------------------------------------------------------------------------------- handlers

    async def _on_propose(self, packet: ProposeSceneLog, peer: str) -> Packet:
        decider = self._routing.owner_of(decider_location(packet.public.scene))
        if decider != self._own.me:
            if node_of(peer) is not None:
                return self._rejection(packet, RejectReason.NOT_MY_LOCATION, decider)
            return await self._peers.ask(decider, Priority.HIGH, packet, Packet, RELAY_S_MAX)
        try:
            if packet.genesis != packet.public.genesis:
                raise Refused(RejectReason.ILL_FORMED, "the proposal is for another genesis than its header's")
            if packet.public.position > FIRST_POSITION and packet.public.scene not in self._known:
                raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "a scene begins with its first header")
            scene = await self.adopt(packet.public)
            if await self._store.get_note(_note(packet.public.scene)) is None:
                await self._store.put_note(_note(packet.public.scene), packet.private)
        except Refused as refusal:
            _log.info("scene proposal of %s refused: %s", peer, refusal)
            return self._rejection(packet, refusal.reason, self._own.me)
        await self._push(scene.public)
        return AcceptSceneProposal(
            genesis=packet.genesis,
            proposal=packet.proposal,
            record_hash=hashlib.new("sha512_256", packet.private).digest(),
            nodes=(Member(self._own.me, self._own.incarnation),),
            highest=None,
            mac_epoch=0,
            mac=b"",
        )

    async def _on_request(self, packet: RequestSceneLog, peer: str) -> Packet:
        try:
            # Nodes that ask each other must not set off a round of asking: only users' questions do.
            scene = await self.known(packet.scene, position=packet.have, ask=node_of(peer) is None)
        except Refused:
            return RespondSceneLog(answer=None)
        if packet.genesis not in (b"", scene.public.genesis):
            return RespondSceneLog(answer=None)
        private = await self._store.get_note(_note(packet.scene)) if packet.want is Want.LOG else None
        return RespondSceneLog(answer=_answer(scene.public, packet.nonce, private))

    async def _on_push(self, packet: RespondSceneLog, peer: str) -> None:
        if packet.answer is not None:
            await self._try_adopt(packet.answer.public, peer)

    async def _on_list(self, _packet: ListScenes, _peer: str) -> Packet:
        return ScenesListed(scenes=tuple(self.all()))

    # ------------------------------------------------------------------------------------------------ the others

    async def _pull(self, scene: SceneId, position: int) -> None:
        now = self._world.clock.now()
        if now - self._missed_at.get(scene, now - MISS_S) < MISS_S:
            return
        request = RequestSceneLog(scene=scene, genesis=b"", have=position, nonce=0, want=Want.HEADER)
        for member in self._peers.others(first=self._routing.owner_of(decider_location(scene))):
            try:
                answer = (await self._peers.ask(member, Priority.HIGH, request, RespondSceneLog, ASK_S_MAX)).answer
            except (Unreachable, Refused, PeerFault):
                continue
            if answer is not None and answer.public.scene == scene:
                await self._try_adopt(answer.public, address_of(member))
                found = self._known.get(scene)
                if found is not None and found.public.position >= position:
                    return
        if len(self._missed_at) > SCENES_LISTED_MAX:
            self._missed_at.clear()
        self._missed_at[scene] = now

    async def _push(self, public: SceneLogPublic) -> None:
        """Tell all others, waiting a bounded time. Whoever misses it pulls it later."""
        packet = RespondSceneLog(answer=_answer(public, 0, None))

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

    def _rejection(self, packet: ProposeSceneLog, reason: RejectReason, node: NodeId) -> Packet:
        return RejectSceneProposal(
            genesis=packet.genesis,
            proposal=packet.proposal,
            reason=reason,
            nodes=(),
            hint=Ballot(0, NodeId(0)),
            node=node,
            mac_epoch=0,
            mac=b"",
        )


def _answer(public: SceneLogPublic, nonce: int, private: bytes | None) -> SceneLogAnswer:
    return SceneLogAnswer(
        nonce=nonce,
        flags=COMMIT_FLAG,
        position=public.position,
        ballot=Ballot(0, NodeId(0)),
        nodes=(),
        public=public,
        private=private,
        mac_epoch=0,
        mac=b"",
    )


def _note(scene: SceneId) -> str:
    return f"scene-log/{scene:08x}"
