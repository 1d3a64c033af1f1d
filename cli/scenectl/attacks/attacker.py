"""Somebody who aims at a node, and what all attacks share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.world import Connection, ConnectionLost, Priority, World, real_world

if TYPE_CHECKING:
    from scenefold.world.profile import ClusterProfile

CROWD = 1_000
"""Connections that are opened and kept."""
HANDS = 16
"""Tasks that do something again and again."""
PAUSE_S = 0.01
BURST = 50
"""Datagrams between two pauses."""


@dataclass
class Attacker:
    """Somebody who aims at one node. `place`: where an honest record lies."""

    profile: ClusterProfile
    address: str
    scene: SceneId
    space: SpaceId
    place: Location
    seen: Counter[str] = field(default_factory=Counter)
    dice: Random = field(default_factory=lambda: Random(1))
    _world: World | None = None

    @property
    def world(self) -> World:
        """That of a spare: the cluster has certified it, and nobody has granted it anything."""
        if self._world is None:
            identity = self.profile.node_identity(self.profile.members[-1].address)
            self._world = real_world(identity, self.profile.authority_certificate(), ports=self.profile.ports)
        return self._world

    async def knock(self, priority: Priority = Priority.HIGH) -> trio.SocketStream:
        return await trio.open_tcp_stream(self.address, self.profile.ports.number(priority))

    async def enter(self, priority: Priority = Priority.HIGH) -> Connection:
        return await self.world.network.connect(self.address, priority)


Attack = Callable[[Attacker], Awaitable[None]]


async def by_many(count: int, hand: Callable[[], Awaitable[None]]) -> None:
    async with trio.open_nursery() as nursery:
        for _ in range(count):
            nursery.start_soon(_again_and_again, hand)


async def _again_and_again(hand: Callable[[], Awaitable[None]]) -> None:
    while True:
        with suppress(OSError, ConnectionLost, trio.BrokenResourceError, ScenefoldError):
            await hand()
        await trio.sleep(PAUSE_S)
