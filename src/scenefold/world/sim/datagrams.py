"""UDP of a simulated network (port `Datagrams`)."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import trio

from scenefold.world.ports import Endpoint
from scenefold.world.sim.machines import Point, Process

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet

EVERYWHERE = "255.255.255.255"
"""What is sent there comes to every machine with a socket that hears broadcasts."""
DATAGRAM_SIZE_MAX = 65_507
BUFFER_BYTES_MAX = 208 * 1024
"""What a socket keeps for a process that does not read; Linux's default. What comes on top is lost."""


class SimDatagrams:
    """One bound socket."""

    def __init__(self, net: SimNet, process: Process, here: Endpoint, port_of_nodes: int) -> None:
        self.here = here
        self._net = net
        self._process = process
        self._port_of_nodes = port_of_nodes
        self._buffer: deque[tuple[bytes, Endpoint]] = deque()
        self._buffer_bytes = 0
        self._readers = trio.lowlevel.ParkingLot()
        self._is_open = True

    async def send(self, data: bytes, target: Endpoint | str) -> None:
        assert len(data) <= DATAGRAM_SIZE_MAX, f"a datagram of {len(data)} bytes"
        await trio.lowlevel.checkpoint()
        if not self._is_open and self._process.is_alive:
            raise trio.ClosedResourceError
        endpoint = Endpoint(target, self._port_of_nodes) if isinstance(target, str) else target
        if self._process.passes(Point.BEFORE_SEND):
            self._net.carry(self._process.machine, self.here, bytes(data), endpoint)
            self._process.passes(Point.AFTER_SEND)

    async def receive(self) -> tuple[bytes, Endpoint]:
        if self._buffer or not self._is_open:
            await trio.lowlevel.checkpoint()  # Else there is a wait.
        while not self._buffer:
            if not self._is_open:
                raise trio.ClosedResourceError
            await self._readers.park()
        data, source = self._buffer.popleft()
        self._buffer_bytes -= len(data)
        return data, source

    def arrive(self, data: bytes, source: Endpoint) -> bool:
        """False if there is no room for it."""
        if self._buffer_bytes + len(data) > BUFFER_BYTES_MAX:
            return False
        self._buffer.append((data, source))
        self._buffer_bytes += len(data)
        self._readers.unpark()
        return True

    async def aclose(self) -> None:
        self.close()
        await trio.lowlevel.checkpoint()

    def bury(self) -> None:
        """Let go whoever still waits here although its process died."""
        self._readers.unpark_all()

    def close(self) -> None:
        self._is_open = False
        if self._process.is_alive:
            self._process.sockets.pop(self, None)
        machine = self._process.machine
        for sockets in (machine.sockets, machine.hearing):
            if sockets.get(self.here.port) is self:
                del sockets[self.here.port]
        if self._process.is_alive:
            self._readers.unpark_all()
