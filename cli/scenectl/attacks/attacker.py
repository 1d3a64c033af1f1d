"""Somebody who aims at a node, and what all attacks share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import SceneId, SpaceId, address_of
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
    """Somebody who aims at one node. `place`: where an honest record lies that is written again and again.

    `far`: a place of the last founder, which lies while the file `lie` says so.
    """

    profile: ClusterProfile
    address: str
    scene: SceneId
    scene_name: str
    space: SpaceId
    place: Location
    far: Location
    lie: Path
    is_member: bool = False
    seen: Counter[str] = field(default_factory=Counter)
    dice: Random = field(default_factory=lambda: Random(1))
    _world: World | None = None

    @property
    def as_member(self) -> Attacker:
        """The same with the keys of a node that the cluster's log has as a member."""
        return replace(self, is_member=True, _world=None)

    @property
    def world(self) -> World:
        """That of a spare, which the cluster has certified and nobody has granted anything; or of the last founder."""
        if self._world is None:
            address = address_of(self.profile.founders[-1]) if self.is_member else self.profile.members[-1].address
            identity = self.profile.node_identity(address)
            self._world = real_world(identity, self.profile.authority_certificate(), ports=self.profile.ports)
        return self._world

    async def knock(self, priority: Priority = Priority.HIGH) -> trio.SocketStream:
        return await trio.open_tcp_stream(self.address, self.profile.ports.number(priority))

    async def enter(self, priority: Priority = Priority.HIGH) -> Connection:
        try:
            return await self.world.network.connect(self.address, priority)
        except (OSError, ScenefoldError):
            self.seen["refused"] += 1
            raise


Attack = Callable[[Attacker], Awaitable[None]]
_MISHAPS = (OSError, ConnectionLost, trio.BrokenResourceError, ScenefoldError)
"""What a node, or a machine that is slow, may do to an attack."""


async def by_one(me: Attacker, hand: Callable[[], Awaitable[None]]) -> None:
    """Again and again. What goes wrong, such as an answer that is late on a slow machine, is counted and ends nothing."""
    while True:
        try:
            await hand()
        except _MISHAPS as mishap:
            me.seen[f"failed: {type(mishap).__name__}"] += 1
            await trio.sleep(PAUSE_S)


async def by_many(count: int, hand: Callable[[], Awaitable[None]]) -> None:
    async with trio.open_nursery() as nursery:
        for _ in range(count):
            nursery.start_soon(_again_and_again, hand)


async def _again_and_again(hand: Callable[[], Awaitable[None]]) -> None:
    while True:
        with suppress(*_MISHAPS):
            await hand()
        await trio.sleep(PAUSE_S)
