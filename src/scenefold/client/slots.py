"""How many requests of one client are under way at a time, of those that move records.

Large ones are bounded in number, all together and for each node: so many bytes may be on their way. Small ones have places of their own,
so that who wants one record need not wait for who wants thousands.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import trio

from scenefold.base.limits import (
    CLIENT_FRAMES_IN_FLIGHT,
    CLIENT_FRAMES_PER_NODE,
    CLIENT_GET_KEYS,
    CLIENT_SMALL_PER_NODE,
    CLIENT_SMALL_RECORDS,
)


class Slots:
    """Of one client."""

    def __init__(self) -> None:
        self._all = trio.CapacityLimiter(CLIENT_FRAMES_IN_FLIGHT)
        self._of_node: dict[str, trio.CapacityLimiter] = {}
        self._small_of_node: dict[str, trio.CapacityLimiter] = {}

    @asynccontextmanager
    async def turn(self, address: str, records: int = CLIENT_GET_KEYS) -> AsyncIterator[None]:
        """Around a request to a node that moves so many records."""
        if records <= CLIENT_SMALL_RECORDS:
            async with self._small_of_node.setdefault(address, trio.CapacityLimiter(CLIENT_SMALL_PER_NODE)):
                yield
        else:
            async with self._of_node.setdefault(address, trio.CapacityLimiter(CLIENT_FRAMES_PER_NODE)), self._all:
                yield
