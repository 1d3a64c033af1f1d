"""What a node that observes a scene does by its own lease: it reads for an image (specs/26-modes.md, Observers).

While it does, a change of the mode does not suit it, and it says so to whoever proposes one. What is forced, or decided while it was cut off, ends
what it does: it looks at its lease all the while.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import LEASE_LOOK_S
from scenefold.base.reasons import RejectReason
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogAnswer, SceneMode
from scenefold.world import World, background_tasks

if TYPE_CHECKING:
    from scenefold.peer.modes.scene_modes import SceneModes

CONSENTS = 1
"""The flag of a 6 that says so: GRANT."""
ACT_S_MAX = 20.0
"""So long somebody waits to act in a mode: longer than a change of it takes to become active."""


class OwnUse:
    """Of one scene, at one node. Used from the Trio thread only."""

    def __init__(self, modes: SceneModes, world: World) -> None:
        self.modes = modes
        """By whose lease it acts."""
        self._world = world
        self._uses = 0

    @property
    def is_observer(self) -> bool:
        """Whether this node is one, by what it knows."""
        standing = self.modes.standing
        return standing.me in standing.scene.observers

    @asynccontextmanager
    async def hold(self, mode: SceneMode) -> AsyncIterator[None]:
        """Around what is done in this mode: it stays until the end.

        Refused (9) if this node has no lease, or another mode is active, or if either comes to be so; the body is cancelled then.
        """
        if not await self.modes.may_act(mode, ACT_S_MAX):
            raise self._refused("holds no lease for it, as it hears too few of those who decide the scene, or the mode is about to change")
        self._uses += 1
        try:
            with trio.CancelScope() as body:
                async with background_tasks() as nursery:

                    async def watch() -> None:
                        await self._lost(mode)
                        body.cancel()

                    nursery.start_soon(watch)
                    yield
            # Whoever slept may not have noticed yet: what was done since counts for nothing.
            has_ended = body.cancelled_caught or self.modes.acts_in is not mode
        finally:
            self._uses -= 1
        if has_ended:
            raise self._refused("lost its lease, or the scene's mode was changed by force")

    async def _lost(self, mode: SceneMode) -> None:
        """Return once this node may act in the mode no more."""
        modes, clock = self.modes, self._world.clock
        while modes.acts_in is mode:
            lease = modes.standing.holder.lease(clock.now())
            left_s = LEASE_LOOK_S if lease is None else lease.until - clock.now()
            modes.want()
            with trio.move_on_after(min(left_s, LEASE_LOOK_S)):
                await modes.news.until(lambda: modes.acts_in is not mode)

    def consents(self, packet: RequestSceneLog, asker: NodeId) -> RespondSceneLog:
        """5 (CONSENT): nothing is begun for a while. Refused (12) if nobody who decides asks, or this node observes nothing; 13 while it acts by its
        lease."""
        modes = self.modes
        if not self.is_observer or asker not in modes.standing.scene.deciders:
            raise Refused(RejectReason.NOT_AUTHORISED, "the participants of a scene ask its observers")
        modes.ask_back()
        if self._uses:
            raise Refused(RejectReason.BUSY, "this node is reading the scene for an image")
        public = modes.public
        return RespondSceneLog(SceneLogAnswer(packet.nonce, CONSENTS, public.position, public, None))

    def _refused(self, why: str) -> Refused:
        what = f"this node observes the scene, and reads it under a lease of its own; it {why}"
        return Refused(RejectReason.MODE_FORBIDS, what, where=f"scene {self.modes.public.scene:08x}", remedy="render again")
