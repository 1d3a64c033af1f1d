"""A scene's leases at a node that observes it: it holds the scene's key, renders, and decides nothing (specs/26-modes.md, Observers).

It keeps no log, and goes by the headers that were decided: each is durable here before this learns it, so a switch that was learnt once is known
ever after, and the word that nothing of before is used stays true.
"""

from __future__ import annotations

from collections.abc import Callable

import trio

from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.peers import Peers
from scenefold.wire import Packet, RespondSceneLog, SceneLogPublic
from scenefold.world import World


class SceneObserver:
    """Used from the Trio thread only. `behind` is called with a position that others know, or may."""

    def __init__(self, world: World, peers: Peers, own: OwnStatus, public: SceneLogPublic, behind: Callable[[int], object]) -> None:
        self._behind = behind
        self.modes = SceneModes(world, peers, own, public, self._is_behind, is_new=True)
        self._scope = trio.CancelScope()

    async def run(self) -> None:
        """Until cancelled, or stopped: hold a lease while somebody acts by one, and say of a switch what may be said."""
        with self._scope:
            await self.modes.run()

    def stop(self) -> None:
        """This node observes the scene no more."""
        self._scope.cancel()

    def learn(self, public: SceneLogPublic) -> None:
        """A header that was decided, and is durable here."""
        if public.position > self.modes.public.position:
            self.modes.learnt(public)

    def shown(self, packet: Packet) -> None:
        """A packet of a node about this scene."""
        if isinstance(packet, RespondSceneLog) and packet.decided is not None:
            told = max((value.position for value in packet.decided.decided), default=0)
            if told > self.modes.public.position:
                self._behind(told)
        self.modes.shown(packet)

    def _is_behind(self) -> None:
        self._behind(self.modes.public.position + 1)
