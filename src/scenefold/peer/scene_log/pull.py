"""Asking the others for a scene's header, once for all who wait, and not again at once where nobody had it (specs/16-scene-log.md)."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import trio

from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.limits import SCENES_KEPT_MAX
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.rounds import ASKED_OF_KNOWN, BEYOND_ORIGIN, Rounds
from scenefold.peer.scene_log.scene_asking import shown_by
from scenefold.scene.log.values import deciding
from scenefold.wire import RequestSceneLog, SceneLogPublic, Want
from scenefold.world import World

Take = Callable[[SceneLogPublic, str], Awaitable[None]]
"""What becomes of a header that somebody shows, and who that is."""
MISS_S = 1.0
"""A scene that nobody knows is not asked for again within this time."""
NEXT_S = 0.5
"""After so long without an answer the next node is asked as well: where most cannot be reached, whoever reads would wait for each of them."""
NEWS_S_MAX = 3.0
"""So long news of a scene that is known are waited for: without them it is answered by what is known."""


@dataclass
class _Round:
    askers: set[str]
    """Whom it is for. Of each name one, so that who asks again and again does not fill it."""
    ended: trio.Event = field(default_factory=trio.Event)
    was_cut: bool = False
    """None of them might have the others asked as well."""


class Pull:
    """One round at a time for each scene. Used from the Trio thread only."""

    def __init__(
        self,
        world: World,
        peers: Peers,
        known: Callable[[SceneId], KnownScene | None],
        take: Take,
    ) -> None:
        """`known`: what this node has of a scene; `take`: what becomes of a header that a node shows."""
        self._world = world
        self._peers = peers
        self._known = known
        self._take = take
        self._begun = Rounds()
        self._missed_at: dict[SceneId, float] = {}
        self._rounds: dict[SceneId, _Round] = {}
        self._silent: set[NodeId] = set()
        """Who showed nothing when it was asked last: of equals, it is asked last."""

    def found(self, scene: SceneId) -> None:
        """There are news of the scene: the next who lacks something of it asks at once."""
        self._missed_at.pop(scene, None)

    async def until(self, scene: SceneId, position: int, asker: str = "") -> bool:
        """Ask the others for a header of this position or later, whoever needs it; it may be that nobody has it.

        False if they are not asked, or not all that should be, because `asker`, or all askers together, have set off too many questions lately.
        """
        while not self._is_known(scene, position):
            missed_at = self._missed_at.get(scene)
            if missed_at is not None and self._world.clock.now() - missed_at < MISS_S:
                return True
            running = self._rounds.get(scene)
            if running is None:
                break
            running.askers.add(asker)
            await running.ended.wait()
            if running.was_cut:
                return False
        else:
            return True
        known = self._known(scene)
        order = self._in_order(known)
        if not self._begun.begin(asker, len(order), self._world.clock.now(), is_known=known is not None):
            return False
        begun = self._rounds[scene] = _Round({asker})
        try:
            begun.was_cut = not await self._ask_around(begun, order, scene, position)
        finally:
            del self._rounds[scene]
            begun.ended.set()
        return not begun.was_cut

    async def _ask_around(self, begun: _Round, order: list[NodeId], scene: SceneId, position: int) -> bool:
        """False if it ends before all were asked that should be."""
        request = RequestSceneLog(scene=scene, genesis=b"", have=position, nonce=0, want=Want.HEADER)
        members, was_known = len(order), self._known(scene) is not None
        clock = self._world.clock
        until = clock.now() + NEWS_S_MAX if was_known else math.inf
        tell, hear = trio.open_memory_channel[tuple[NodeId, SceneLogPublic | None]](members)

        async def ask(member: NodeId) -> None:
            self._silent.add(member)
            tell.send_nowait((member, await shown_by(self._peers, member, request)))

        asked, was_cut, waiting = 0, False, set[NodeId]()
        async with trio.open_nursery() as nursery:
            while (order or waiting) and clock.now() < until:
                # Of whom decides an answer may be on its way, with which nobody else need be asked.
                may_ask = bool(order) and not (was_known and asked >= ASKED_OF_KNOWN and self._deciders(scene) & waiting)
                if may_ask and was_known and asked == ASKED_OF_KNOWN:
                    was_cut = not self._begun.go_on(sorted(begun.askers), members, clock.now())
                    order = [] if was_cut else order
                if may_ask and order:
                    waiting.add(order[0])
                    nursery.start_soon(ask, order.pop(0))
                    asked += 1
                answer = None
                with trio.move_on_after(max(0.0, min(NEXT_S if order else math.inf, until - clock.now()))):
                    answer = await hear.receive()
                if answer is None:
                    continue
                member, public = answer
                waiting.discard(member)
                if public is not None:
                    self._silent.discard(member)
                    await self._take(public, address_of(member))
                    left = self._left_to_ask(order, waiting, member, scene, position, was_known=was_known)
                    if left is None:
                        break
                    order = left
            nursery.cancel_scope.cancel()
        if self._is_known(scene, position) or was_cut:
            # If it was cut, nothing is noted as missed: for who has questions left the others are asked at once.
            return self._is_known(scene, position)
        if len(self._missed_at) > SCENES_KEPT_MAX:
            self._missed_at.clear()
        self._missed_at[scene] = self._world.clock.now()
        return True

    def _left_to_ask(
        self, order: list[NodeId], waiting: set[NodeId], member: NodeId, scene: SceneId, position: int, *, was_known: bool
    ) -> list[NodeId] | None:
        """Who is still to be asked, once a member's header was looked at; None: nobody, it is there. `waiting`: who may still answer."""
        deciders = self._deciders(scene)
        if not deciders:
            return order
        if not was_known and member not in deciders and deciders & {*order, *waiting}:
            # It was decided, and may be old: who decides knows.
            return sorted(order, key=lambda other: other not in deciders)
        if self._is_known(scene, position):
            return None
        # Somebody claims too much, most likely. But it may have lost its disk.
        return order[:BEYOND_ORIGIN] if member in deciders else order

    def _deciders(self, scene: SceneId) -> set[NodeId]:
        """Of what is known of the scene; nobody, if that is nothing."""
        known = self._known(scene)
        return set() if known is None else set(deciding(known.public))

    def _in_order(self, known: KnownScene | None) -> list[NodeId]:
        """All others, first whoever decides the scene, and of these and of those first who answered the last time."""
        deciders, others = set() if known is None else deciding(known.public), self._peers.others()
        self._silent.intersection_update(others)
        return sorted(others, key=lambda other: (other not in deciders, other in self._silent))

    def _is_known(self, scene: SceneId, position: int) -> bool:
        found = self._known(scene)
        return found is not None and found.public.position >= position
