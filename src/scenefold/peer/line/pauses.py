"""Pauses between tries that double up to a bound, with some chance in them so that nodes do not try in step."""

from __future__ import annotations

from scenefold.world import World

PAUSE_S_MIN = 0.25
PAUSE_S_MAX = 8.0


class Pauses:
    """`count`: pauses since the last success."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.count = 0

    def reset(self) -> None:
        self.count = 0

    async def wait(self) -> None:
        """Between one half and the whole of the next pause."""
        pause_s = min(PAUSE_S_MAX, PAUSE_S_MIN * 2.0 ** min(self.count, 16))
        self.count += 1
        await self._world.clock.sleep(pause_s * (0.5 + self._world.entropy.uniform() / 2))
