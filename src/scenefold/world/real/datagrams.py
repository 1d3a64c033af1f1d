"""UDP sockets (port `Datagrams`)."""

from __future__ import annotations

import logging

import trio

from scenefold.world.ports import Endpoint, Ports, Priority
from scenefold.world.real.binding import bind_fault

DATAGRAM_SIZE_MAX = 65_507
"""What IPv4 can carry in one UDP datagram."""

_log = logging.getLogger("scenefold.world.datagrams")


class RealDatagrams:
    """One bound UDP socket."""

    def __init__(self, socket: trio.socket.SocketType, port_of_nodes: int) -> None:
        self._socket = socket
        self._port_of_nodes = port_of_nodes
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
        while True:
            try:
                data, source = await self._socket.recvfrom(DATAGRAM_SIZE_MAX)
            except ConnectionError as error:
                # Some systems report here that an earlier datagram met a closed port.
                _log.debug("receiving datagrams: %s", error)
                continue
            return data, Endpoint(*source)

    async def aclose(self) -> None:
        self._socket.close()
        await trio.lowlevel.checkpoint()


async def open_datagrams(address: str | None, priority: Priority, ports: Ports) -> RealDatagrams:
    """A UDP socket at a node's address and port, or with None at any free port."""
    socket = trio.socket.socket(trio.socket.AF_INET, trio.socket.SOCK_DGRAM)
    port = ports.number(priority)
    here = (address, port) if address is not None else ("", 0)
    try:
        await socket.bind(here)
    except OSError as error:
        socket.close()
        raise bind_fault(error, "UDP", *here) from error
    return RealDatagrams(socket, port)
