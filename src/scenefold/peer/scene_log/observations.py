"""The scenes that this node observes, by their headers (specs/26-modes.md, Observers)."""

from __future__ import annotations

import logging
from typing import Protocol

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.consensus.packets import scene_of
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.observing import SceneObserver
from scenefold.peer.peers import Peers
from scenefold.wire import Packet, SceneLogPublic
from scenefold.world import World


class Pull(Protocol):
    """Have a scene's header of this position or later, if anybody has it; Refused if nobody may be asked."""

    async def __call__(self, scene: SceneId, *, position: int) -> object: ...


PULL_PAUSE_S = 0.5

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class Observations:
    """`run` it; scenes that are met before are observed from then on. Used from the Trio thread only."""

    def __init__(self, world: World, peers: Peers, own: OwnStatus) -> None:
        self._world, self._peers, self._own = world, peers, own
        self._all: dict[SceneId, SceneObserver] = {}
        self._pulling: set[SceneId] = set()
        self._nursery: trio.Nursery | None = None
        self._pull: Pull | None = None

    async def run(self, pull: Pull) -> None:
        """Until cancelled."""
        async with trio.open_nursery() as nursery:
            self._nursery, self._pull = nursery, pull
            for one in self._all.values():
                nursery.start_soon(one.run)
            try:
                await trio.sleep_forever()
            finally:
                # What is heard while the node ends begins nothing any more.
                self._nursery = None

    def meets(self, public: SceneLogPublic) -> None:
        """This is the newest header of a scene here, whose log this node does not keep."""
        scene, one = public.scene, self._all.get(public.scene)
        if not any(entry.member == self._own.member for entry in public.observers):
            self.leave(public)
        elif one is not None:
            one.learn(public)
        else:
            one = self._all[scene] = SceneObserver(self._world, self._peers, self._own, public, lambda at: self._is_behind(scene, at))
            if self._nursery is not None:
                self._nursery.start_soon(one.run)

    def leave(self, public: SceneLogPublic) -> None:
        """By this header it is observed no more: what is done there ends."""
        one = self._all.get(public.scene)
        if one is not None:
            one.learn(public)
            self.end(public.scene)

    def end(self, scene: SceneId) -> None:
        """It is observed no more, if it was."""
        one = self._all.pop(scene, None)
        if one is not None:
            one.stop()

    def of(self, scene: SceneId) -> SceneObserver | None:
        return self._all.get(scene)

    def watches(self, genesis: bytes) -> bool:
        """Whether packets about this log are of interest."""
        one = self._all.get(scene_of(genesis))
        return one is not None and one.modes.public.genesis == genesis

    def shown(self, packet: Packet, genesis: bytes) -> None:
        if self.watches(genesis):
            self._all[scene_of(genesis)].shown(packet)

    def _is_behind(self, scene: SceneId, position: int) -> None:
        if self._nursery is not None and scene not in self._pulling:
            self._pulling.add(scene)
            self._nursery.start_soon(self._catch_up, scene, position)

    async def _catch_up(self, scene: SceneId, position: int) -> None:
        assert self._pull is not None
        try:
            await self._pull(scene, position=position)
            await self._world.clock.sleep(PULL_PAUSE_S)
        except Refused as refusal:
            _log.debug("the header of scene %08x is not had: %s", scene, refusal)
        finally:
            self._pulling.discard(scene)
