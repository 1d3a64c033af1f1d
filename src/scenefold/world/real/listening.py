"""The listening half of a door: what may knock becomes a stream, and what may not is closed where it is.

Closing costs time as well, and who is refused comes again at once. So while nearly all that comes is refused, the node looks
less and less often; what comes meanwhile stays in the system's queue, and is taken as a whole. Whoever is welcome is kept
waiting a tenth of a second at most.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

import trio

from scenefold.world.real.admission import Pauses

_GONE = {errno.ECONNABORTED, errno.ECONNRESET, errno.EPERM, errno.EPROTO}
"""The connection ended in the queue, or something else forbids it: there will be others."""
AT_ONCE_MAX = 64
"""Connections that are refused before other tasks have their turn."""


class GuardedListener(trio.abc.Listener[trio.SocketStream]):
    """Takes over the socket of a listener. `may_knock`: whether a connection of an address is received at all."""

    def __init__(self, listener: trio.SocketListener, may_knock: Callable[[str], bool]) -> None:
        self._socket = socket.socket(fileno=listener.socket.detach())
        self._socket.setblocking(False)
        self._may_knock = may_knock
        self._pauses = Pauses()

    async def accept(self) -> trio.SocketStream:
        refused = 0
        await trio.lowlevel.checkpoint()
        while True:
            try:
                connection, address = self._socket.accept()
            except BlockingIOError:
                await trio.sleep(self._pauses.next_s())
                await trio.lowlevel.wait_readable(self._socket)
                continue
            except OSError as error:
                if error.errno in _GONE:
                    continue
                raise
            if self._may_knock(str(address[0])):
                self._pauses.let_in()
                return trio.SocketStream(trio.socket.from_stdlib_socket(connection))
            connection.close()
            self._pauses.refused()
            refused += 1
            if refused % AT_ONCE_MAX == 0:
                await trio.lowlevel.checkpoint()

    async def aclose(self) -> None:
        trio.lowlevel.notify_closing(self._socket)
        self._socket.close()
        await trio.lowlevel.checkpoint()
