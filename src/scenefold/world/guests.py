"""What all connections of one peer at one port may bind together (specs/03-wire.md, Limits).

A member may open as many connections as it likes, so a bound for each connection is none for the peer. Connections beyond the
number that a peer may have push out its own oldest, which may be one that its machine has forgotten; nobody else's. Beside
others it begins only a few requests at a time, and takes only a share of the time (turns.py), of which it pays what each costs.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

import trio

from scenefold.base.limits import (
    CONNECTIONS_PER_PEER_MAX,
    PEER_ANSWER_BYTES_MAX,
    PEER_REQUEST_BYTES_HANDLED_MAX,
    PEER_REQUESTS_HANDLED_MAX,
)
from scenefold.world.metering import Bill, Stopwatch
from scenefold.world.turns import BESIDE_S, Guest, Turns

REQUEST_S = 0.0004
BYTE_S = 5e-6 / 1024
"""What a request costs at least, and each byte of it and of its answer. What it really costs is measured."""


class Budget:
    """A number of requests and of bytes that may be under way. Any task takes; any gives back."""

    def __init__(self, count_max: int, bytes_max: int) -> None:
        self._count_left = count_max
        self._bytes_left = bytes_max
        self._changed = trio.lowlevel.ParkingLot()

    async def take(self, size_bytes: int) -> None:
        """Wait until there is room. `size_bytes` must not exceed the whole budget."""
        while self._count_left < 1 or self._bytes_left < size_bytes:
            await self._changed.park()
        self._count_left -= 1
        self._bytes_left -= size_bytes

    def give_back(self, size_bytes: int) -> None:
        self._count_left += 1
        self._bytes_left += size_bytes
        self._changed.unpark_all()


class Room:
    """Bytes that answers may take before they have left. Who asks first is served first: else what is large would never be."""

    def __init__(self, bytes_max: int) -> None:
        self._left = bytes_max
        self._line = trio.Lock()
        self._changed = trio.lowlevel.ParkingLot()

    @asynccontextmanager
    async def taken(self, size_bytes: int) -> AsyncIterator[None]:
        """So much is taken within this. `size_bytes` must not exceed the whole room."""
        async with self._line:
            while self._left < size_bytes:
                await self._changed.park()
            self._left -= size_bytes
        try:
            yield
        finally:
            self._left += size_bytes
            self._changed.unpark()


class Share:
    """One peer's."""

    def __init__(self, guest: Guest, turns: Turns, stopwatch: Stopwatch | None) -> None:
        self._guest = guest
        self._turns = turns
        self._stopwatch = stopwatch
        self._line = trio.Lock()
        self._turn_ended = trio.lowlevel.ParkingLot()
        self.budget = Budget(PEER_REQUESTS_HANDLED_MAX, PEER_REQUEST_BYTES_HANDLED_MAX)
        self.room = Room(PEER_ANSWER_BYTES_MAX)
        self.connections: dict[trio.CancelScope, None] = {}
        """Those that are served, oldest first."""

    async def take_turn(self) -> int:
        """Wait until a request may be taken up; the number is for `end_turn`."""
        if self._line.locked() or self._turns.wait_s(self._guest, trio.current_time()):
            # Only the first in line looks again and again: a hundred that did would take the time that is to be left to others.
            async with self._line:
                while wait_s := self._turns.wait_s(self._guest, trio.current_time()):
                    # Whoever is beside it may be gone by then, and then it need not wait for what it has used up.
                    with trio.move_on_after(min(wait_s, BESIDE_S)):
                        await self._turn_ended.park()
        return self._turns.begin(self._guest, trio.current_time())

    def end_turn(self, number: int) -> None:
        self._turns.end(self._guest, number)
        self._turn_ended.unpark()

    def bill(self, estimate_s: float = 0.0) -> Bill:
        """For something that is done for this peer."""
        return Bill(self._pay, self._stopwatch, estimate_s, self._accuse)

    def _accuse(self) -> None:
        self._turns.accuse(self._guest[0], trio.current_time())

    def _pay(self, work_s: float) -> None:
        self._turns.pay(self._guest, work_s, trio.current_time())


class Guests:
    """The peers that are connected to one port. `turns`: those of all ports of a node, whose numbers tell them apart.
    `stopwatch`: the clock that measures what they cost, if there is one.
    """

    def __init__(self, turns: Turns | None = None, port: int = 0, stopwatch: Stopwatch | None = None) -> None:
        self._shares: dict[str, Share] = {}
        self._turns = turns or Turns()
        self._port = port
        self._stopwatch = stopwatch

    @contextmanager
    def admitted(self, peer: str) -> Iterator[tuple[Share, trio.CancelScope]]:
        """Serve a connection of a peer within this; the scope is cancelled when the peer opens too many after it."""
        share = self._shares.setdefault(peer, Share((peer, self._port), self._turns, self._stopwatch))
        if len(share.connections) >= CONNECTIONS_PER_PEER_MAX:
            oldest = next(iter(share.connections))
            del share.connections[oldest]
            oldest.cancel()
        with trio.CancelScope() as scope:
            share.connections[scope] = None
            try:
                yield share, scope
            finally:
                share.connections.pop(scope, None)
                if not share.connections and self._shares.get(peer) is share:
                    del self._shares[peer]
