"""Scenes that were ended go from the disks of all nodes, once all of them know it (specs/16-scene-log.md, The end).

Who answers that nothing lies somewhere must not do so to somebody who does not know yet that the scene was ended, and what is dropped here
must not come back from somebody who does not. So each node first sees the last header at every other registered node, and then lets go for
itself: from that moment on it takes and shows nothing of the scene, whoever brings or asks for it.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Protocol

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.peer.line.parts import Parts
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.proposals import answer_of
from scenefold.wire import AskPlaces, Member, PlacesAsked, RequestSceneLog, RespondSceneLog, SceneLogPublic, Want
from scenefold.world import Priority, first_of

ASK_S_MAX = 5.0
ASKED_AT_A_TIME = 16
"""Nodes: each of them asks all others as well."""
PAUSE_S_MIN = 1.0
PAUSE_S_MAX = 60.0
"""A node that is away holds up nothing but this."""

_log = logging.getLogger("scenefold.peer.purging")


class Logs(Protocol):
    """Those of scenes that this node runs (scene_log/participation.py). `on_end` is told of each header that says that its scene was ended."""

    on_end: Callable[[], object]

    async def end(self, scene: SceneId, /) -> None:
        """Run the scene's log no more; nothing of it is written once this returns."""
        ...


class LettingGo:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, logs: Logs) -> None:
        self._parts, self._logs = parts, logs
        self._news = trio.Event()
        self._finished: set[SceneId] = set()
        self._knowing: dict[SceneId, set[Member]] = {}
        """Who has shown the last header of a scene: it is on that node's disk."""
        logs.on_end = self._on_end

    def _on_end(self) -> None:
        self._news.set()

    async def load(self) -> None:
        """Recall what this node has let go of before. To be called before anything is taken or shown."""
        for known in self._ended():
            await self._parts.store.recall_let_go(known.public.scene)

    def _ended(self) -> list[KnownScene]:
        """Those of which there may be something left to do."""
        return [one for one in self._parts.scenes.everyone() if one.is_ended and one.public.scene not in self._finished]

    async def run(self) -> None:
        """Until cancelled."""
        parts = self._parts
        await parts.arrival.done()
        pause_s = PAUSE_S_MIN
        while True:
            self._news = trio.Event()
            waiting = False
            for known in self._ended():
                waiting |= not await self._is_finished(known)
            if not waiting:
                pause_s = PAUSE_S_MIN
                await self._news.wait()
                continue
            with trio.move_on_after(pause_s):
                await first_of(self._news.wait, self._members_changed)
                pause_s = PAUSE_S_MIN
            pause_s = min(PAUSE_S_MAX, 2 * pause_s)

    async def _members_changed(self) -> None:
        log = self._parts.cluster_log
        await log.changed_after(log.registry.position)

    async def _is_finished(self, known: KnownScene) -> bool:
        scene = known.public.scene
        try:
            if not self._parts.store.has_let_go(scene):
                if not await self._do_all_know(known.public):
                    return False
                await self._parts.store.let_go(scene)
            await self._drop(known.public)
        except Refused as problem:
            # The disk is full, to its last byte.
            _log.debug("scene %08x, which was ended, stays for now: %s", scene, problem)
            return False
        self._knowing.pop(scene, None)
        self._finished.add(scene)
        return True

    async def _drop(self, public: SceneLogPublic) -> None:
        store = self._parts.store
        await self._logs.end(public.scene)
        if not await store.keeps_of(public.scene, public.genesis):
            return
        # What was given to the store before is on the disk when this returns, and goes with the rest.
        await store.flush()
        while gone := await store.drop_scene(public.scene):
            self._parts.events["let go"] += gone
        await store.drop_scene_log(public.scene, public.genesis)
        _log.info("scene %08x was ended at position %d of its log: nothing of it is kept here any more", public.scene, public.position)

    # ----------------------------------------------------------------------------------------------------- asking

    async def _do_all_know(self, public: SceneLogPublic) -> bool:
        """Whether everybody who is registered has the header on its disk, and whoever registers from now on learns it from one of them."""
        registry = self._parts.cluster_log.registry
        if len(registry.members) != len(registry.order):
            # A founder has not come yet.
            return False
        position, me = registry.position, self._parts.own.member
        members = [known.member for node in registry.members if (known := registry.current(node)) is not None and known.member != me]
        knowing = self._knowing.setdefault(public.scene, set())
        await self._each([member for member in members if member not in knowing], lambda member: self._tell(public, member))
        if not knowing.issuperset(members):
            return False
        said: set[Member] = set()
        await self._each(members, lambda member: self._ask(position, member, said))
        return said.issuperset(members) and self._parts.cluster_log.registry.position == position

    async def _each(self, members: Sequence[Member], ask: Callable[[Member], Awaitable[None]]) -> None:
        slots = trio.CapacityLimiter(ASKED_AT_A_TIME)

        async def one(member: Member) -> None:
            async with slots:
                try:
                    await ask(member)
                except (Refused, Unreachable, PeerFault) as problem:
                    _log.debug("%s does not say that it knows of the end of a scene: %s", address_of(member.node), problem)

        async with trio.open_nursery() as nursery:
            for member in members:
                nursery.start_soon(one, member)

    async def _tell(self, public: SceneLogPublic, member: Member) -> None:
        """Note whether it has the header; if not, show it, so that it has when it is asked again."""
        peers = self._parts.peers
        request = RequestSceneLog(public.scene, public.genesis, public.position, 0, Want.HEADER)
        answer = (await peers.ask(member.node, Priority.HIGH, request, RespondSceneLog, ASK_S_MAX)).answer
        if answer is not None and answer.public.proposed() == public.proposed():
            # Another incarnation that answers here is found by the second question.
            self._knowing[public.scene].add(member)
        else:
            await peers.tell(member.node, Priority.HIGH, RespondSceneLog(answer_of(public, 0, None)), ASK_S_MAX)

    async def _ask(self, position: int, member: Member, said: set[Member]) -> None:
        """Whether it has arrived, as this incarnation, and knows the cluster's log exactly so far."""
        question = AskPlaces(self._parts.own.member, member, position, None)
        reply = await self._parts.peers.ask(member.node, Priority.LOW, question, PlacesAsked, ASK_S_MAX)
        if reply.reason == 0:
            said.add(member)
