"""Tries a call again while nodes are away or busy, with growing pauses between (the thin shell of `patience`)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from scenefold.base.errors import Refused, Unreachable
from scenefold.client.patience import Patience, as_told
from scenefold.world import World

Result = TypeVar("Result")


async def patiently(world: World, call: Callable[[], Awaitable[Result]], renew: Callable[[], Awaitable[object]] | None = None) -> Result:
    """What `call` gives as soon as it gives something; its last Unreachable or Refused when patience is over, or if that lasts.

    `renew`: awaited after each pause, for what should be newer at the next try.
    """
    patience = Patience()
    while True:
        try:
            return await call()
        except (Unreachable, Refused) as error:
            if not patience.bears(error):
                raise as_told(error) from error.__cause__
        await pause(world, patience)
        if renew is not None:
            await renew()


async def pause(world: World, patience: Patience) -> None:
    """Wait before the next try."""
    await world.clock.sleep(patience.pause_s(world.entropy.uniform()))
