"""A TCP connection to a node, or nothing that has to be closed."""

from __future__ import annotations

import trio


async def dial(address: str, port: int) -> trio.SocketStream:
    """Connect; OSError if that fails. The caller bounds the time, and closes the stream."""
    socket = trio.socket.socket()
    try:
        await socket.connect((address, port))
    except BaseException:
        socket.close()
        raise
    return trio.SocketStream(socket)
