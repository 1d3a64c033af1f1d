"""A process of a node arrives before it acts on what its disk says of others' places (specs/22-purge.md, Arrival).

Its disk may be an older one than the cluster knows, as when a backup was put back: that says the voter, when it is asked for a lease.
An incarnation that was registered a moment ago was asked about nothing that is purged before; so it learns from somebody who was
asked, or has learnt it so, what was purged. Founders with their founding arcs were there before anything was.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Protocol

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.records.verification import KnownScene
from scenefold.wire import AskPlaces, Member, PlacesAsked, SceneLogPublic
from scenefold.world import Priority

ASK_S_MAX = 5.0

_log = logging.getLogger("scenefold.peer.purging")


class Lists(Protocol):
    """Of scenes' headers (scene_log/scenes.py)."""

    async def take_list(self, member: NodeId, /) -> Sequence[SceneLogPublic] | None:
        """Take all headers that a member lists; None if it does not say."""
        ...

    async def known(self, scene: SceneId, *, ask: bool) -> KnownScene: ...


class Arriving:
    """One process's. Used from the Trio thread only."""

    def __init__(self, parts: Parts, scenes: Lists, lease_held: Callable[[], Awaitable[None]]) -> None:
        """From now on it has to be waited for. `lease_held`: returns once this process has held a lease."""
        self._parts = parts
        self._scenes = scenes
        self._lease_held = lease_held
        parts.arrival.begin()
        parts.keeper.require_arrival = parts.arrival.require

    async def run(self) -> None:
        """Return once this process has arrived."""
        parts = self._parts
        await self._lease_held()
        pauses = Pauses(parts.world)
        while not await self._knows_all():
            await pauses.wait()
        for prepare in parts.arrival.before:
            await self._insist(prepare)
        parts.arrival.end()

    async def _knows_all(self) -> bool:
        """Whether this node has the headers of all scenes that something was purged of before it could be asked."""
        parts = self._parts
        registry = parts.cluster_log.registry
        if await parts.store.holding() is not None or registry.founding_arc(parts.own.me) is not None:
            return True
        others = [known.member for node in registry.members if (known := registry.current(node)) is not None and node != parts.own.me]
        for member in others:
            if await self._tells(member, registry.position):
                return True
        # Alone it has nobody who could tell, nor anybody who was asked.
        return not others

    async def _tells(self, member: Member, position: int) -> bool:
        """Whether a member that has arrived, and knows the cluster's log as far, has told of all scenes."""
        question = AskPlaces(self._parts.own.member, member, position, None)
        try:
            reply = await self._parts.peers.ask(member.node, Priority.LOW, question, PlacesAsked, ASK_S_MAX)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("%s does not say whether it has arrived: %s", address_of(member.node), problem)
            return False
        listed = None if reply.reason else await self._scenes.take_list(member.node)
        return listed is not None and all([await self._has(public) for public in listed])

    async def _has(self, public: SceneLogPublic) -> bool:
        try:
            return (await self._scenes.known(public.scene, ask=False)).public.position >= public.position
        except Refused:
            return False

    async def _insist(self, prepare: Callable[[], Awaitable[None]]) -> None:
        pauses = Pauses(self._parts.world)
        while True:
            try:
                await prepare()
                return
            except Refused as problem:
                # The disk is full, or this life is ending.
                level = logging.DEBUG if pauses.count else logging.WARNING
                _log.log(level, "this node takes and shows nothing until it is ready: %s", problem)
            await pauses.wait()
