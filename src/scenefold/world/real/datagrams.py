"""UDP sockets (port `Datagrams`).

What has come is taken from the system in lumps: a round of all tasks for each datagram of a flood costs more than most of them.
"""

from __future__ import annotations

import logging
import socket as plain
from collections import deque

import trio

from scenefold.world.ports import Endpoint, Ports, Priority
from scenefold.world.real.binding import bind_fault

DATAGRAM_SIZE_MAX = 65_507
"""What IPv4 can carry in one UDP datagram."""
AT_ONCE_MAX = 16
"""Datagrams that are received before other tasks have their turn; those of members take a tenth of a millisecond or two each."""

_log = logging.getLogger("scenefold.world.datagrams")


class RealDatagrams:
    """One bound UDP socket."""

    def __init__(self, socket: plain.socket, port_of_nodes: int) -> None:
        socket.setblocking(False)
        self._plain = socket
        self._socket = trio.socket.from_stdlib_socket(socket)
        self._port_of_nodes = port_of_nodes
        self._lump: deque[tuple[bytes, Endpoint]] = deque()
        self.here = Endpoint(*socket.getsockname())

    async def send(self, data: bytes, target: Endpoint | str) -> None:
        assert len(data) <= DATAGRAM_SIZE_MAX, f"a datagram of {len(data)} bytes"
        endpoint = Endpoint(target, self._port_of_nodes) if isinstance(target, str) else target
        try:
            await self._socket.sendto(data, endpoint)
        except OSError as error:
            # No route, a full buffer, a firewall: to the sender a datagram that is not sent is one that is lost.
            _log.debug("datagram to %s:%d not sent: %s", *endpoint, error)

    async def receive(self) -> tuple[bytes, Endpoint]:
        if self._lump:
            await trio.lowlevel.checkpoint_if_cancelled()
        else:
            await trio.lowlevel.checkpoint()
        while not self._lump:
            if self._plain.fileno() < 0:
                raise trio.ClosedResourceError
            self._take_lump()
            if not self._lump:
                await trio.lowlevel.wait_readable(self._plain)
        return self._lump.popleft()

    def _take_lump(self) -> None:
        while len(self._lump) < AT_ONCE_MAX:
            try:
                data, source = self._plain.recvfrom(DATAGRAM_SIZE_MAX)
            except BlockingIOError:
                return
            except ConnectionError as error:
                # Some systems report here that an earlier datagram met a closed port.
                _log.debug("receiving datagrams: %s", error)
                continue
            self._lump.append((data, Endpoint(*source)))

    async def aclose(self) -> None:
        self._socket.close()
        self._lump.clear()
        await trio.lowlevel.checkpoint()


def udp_socket() -> plain.socket:
    """Not bound yet."""
    return plain.socket(plain.AF_INET, plain.SOCK_DGRAM)


async def open_datagrams(address: str | None, priority: Priority, ports: Ports) -> RealDatagrams:
    """A UDP socket at a node's address and port, or with None at any free port."""
    await trio.lowlevel.checkpoint()
    socket = udp_socket()
    port = ports.number(priority)
    here = (address, port) if address is not None else ("", 0)
    try:
        socket.bind(here)
    except OSError as error:
        socket.close()
        raise bind_fault(error, "UDP", *here) from error
    return RealDatagrams(socket, port)
