"""Before the first decision about a scene in this life of the node: what do others know of it? (specs/16-scene-log.md, Deciding.)

This node's disk may be an older one, or empty, and what it decided before be known elsewhere. One member may hide that, and a few may
be away; so more than half of those that seem alive must have said what they have. A scene that is new is known to nobody, and a node
that is alone asks nobody.
"""

from __future__ import annotations

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_KEPT_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.pull import Take
from scenefold.peer.scene_log.scene_asking import said_by
from scenefold.wire import SceneLogPublic
from scenefold.world import World

LOOK_S_MAX = 6.0
"""Longer than a member is waited for that was never heard (Peers.witnesses), and shorter than a relay waits for the answer."""
PAUSE_S = 0.25
"""Between two rounds, while too few answer."""


class FirstLook:
    """Which scenes were looked at, in this life of the node. Used from the Trio thread only."""

    def __init__(self, world: World, peers: Peers, take: Take) -> None:
        """`take`: what becomes of a header that a node shows."""
        self._world = world
        self._peers = peers
        self._take = take
        self._looked: set[SceneId] = set()
        self._looking: dict[SceneId, trio.Lock] = {}

    def was_taken(self, scene: SceneId) -> bool:
        return scene in self._looked

    async def take(self, scene: SceneId) -> None:
        """Return once enough others have said what they know of the scene, and that is taken; Refused (16) if they do not in time."""
        lock = self._looking.setdefault(scene, trio.Lock())
        with trio.move_on_after(LOOK_S_MAX) as patience:
            async with lock:
                try:
                    while scene not in self._looked:
                        if await self._enough_say(scene):
                            self._note(scene)
                        else:
                            await self._world.clock.sleep(PAUSE_S)
                finally:
                    if not lock.statistics().tasks_waiting:
                        self._looking.pop(scene, None)
        if patience.cancelled_caught and scene not in self._looked:
            what = "too few of the other members say how far the scene is"
            raise Refused(RejectReason.NOT_READY, what, where=f"scene {scene:08x}", remedy="try again in a while")

    async def _enough_say(self, scene: SceneId) -> bool:
        """One round: whether more than half of those that seem alive said something; it is taken then."""
        try:
            witnesses = self._peers.witnesses()
        except Refused:
            return False
        lacking = len(witnesses) // 2 + 1 if witnesses else 0
        shown: list[tuple[NodeId, SceneLogPublic]] = []

        async def ask(member: NodeId) -> None:
            nonlocal lacking
            try:
                public = await said_by(self._peers, member, scene)
            except (Unreachable, Refused, PeerFault):
                return
            if public is not None:
                shown.append((member, public))
            lacking -= 1
            if lacking <= 0:
                nursery.cancel_scope.cancel()

        async with trio.open_nursery() as nursery:
            for member in witnesses:
                nursery.start_soon(ask, member)
        # The newest first: the others are behind it then.
        for member, public in sorted(shown, key=lambda entry: (-entry[1].position, entry[0])):
            await self._take(public, address_of(member))
        return lacking <= 0

    def _note(self, scene: SceneId) -> None:
        if len(self._looked) >= SCENES_KEPT_MAX:
            # Of scenes that were never decided; the others are looked at once more.
            self._looked.clear()
        self._looked.add(scene)
