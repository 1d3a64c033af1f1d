"""Newest headers of scenes to whoever is no participant: pushed to each by itself, the newest alone (specs/16-scene-log.md, Headers spread)."""

from __future__ import annotations

import logging
from collections.abc import Collection

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.proposals import answer_of
from scenefold.peer.scene_log.scene_asking import ASK_S_MAX
from scenefold.wire import RespondSceneLog, SceneLogPublic
from scenefold.world import Priority

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class Telling:
    """Who is away holds up nobody else, and pulls later. Its tasks are `nursery`'s."""

    def __init__(self, nursery: trio.Nursery, peers: Peers) -> None:
        self._nursery, self._peers = nursery, peers
        self._waiting: dict[NodeId, dict[SceneId, SceneLogPublic]] = {}

    def tell(self, public: SceneLogPublic, knowing: Collection[NodeId]) -> None:
        """Tell all members but those who know it. Returns at once."""
        for member in self._peers.others():
            if member in knowing:
                continue
            waiting = self._waiting.get(member)
            if waiting is None:
                self._waiting[member] = {public.scene: public}
                self._nursery.start_soon(self._tell, member)
            else:
                waiting[public.scene] = public

    async def _tell(self, member: NodeId) -> None:
        waiting = self._waiting[member]
        try:
            while waiting:
                public = waiting.pop(next(iter(waiting)))
                await self._peers.tell(member, Priority.HIGH, RespondSceneLog(answer=answer_of(public, 0, None)), ASK_S_MAX)
        except Unreachable as problem:
            _log.info("scene %08x not told to %s: %s", public.scene, address_of(member), problem)
        finally:
            del self._waiting[member]
