"""If this fails, a node believes a frame of which a bit was changed on the way, or goes on with a connection that somebody tampers with."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import pytest
import trio

from conformance.world.makers import RealWorlds
from scenefold.crypto import client_context, server_context
from scenefold.world.ports import ConnectionLost
from scenefold.world.real.tls import TlsConnection, shake_hands
from scenefold.world.versions import TAKEN

CONNECTIONS = 60
SECRET = b"nobody may see this"
LIMIT_S = 20.0


@dataclass
class Tamperer:
    """Carries bytes between two sockets. Once it is told a bit, it flips that one of the next bytes to the server (or client), and only then."""

    to_server: bool
    bit: int | None = None
    flipped: bool = False

    async def carry(self, client: trio.SocketStream, server: trio.SocketStream) -> None:
        async with client, server, trio.open_nursery() as nursery:
            nursery.start_soon(self._carry, client, server, self.to_server)
            nursery.start_soon(self._carry, server, client, not self.to_server)

    async def _carry(self, source: trio.SocketStream, target: trio.SocketStream, is_target: bool) -> None:
        try:
            async for data in source:
                changed = bytearray(data)
                if is_target and self.bit is not None and not self.flipped:
                    self.flipped = True
                    bit = self.bit % (8 * len(changed))
                    changed[bit // 8] ^= 1 << bit % 8
                await target.send_all(bytes(changed))
            await target.send_eof()
        except trio.BrokenResourceError:
            return


async def connected(worlds: RealWorlds, tamperer: Tamperer, nursery: trio.Nursery) -> tuple[TlsConnection, TlsConnection]:
    """A client's and a server's end, with the tamperer between them."""
    address = worlds.address(0)
    client_side, server_side = (
        client_context(worlds.authority.issue("user:ada", []), worlds.authority.certificate),
        server_context(worlds.identity(0), worlds.authority.certificate),
    )
    for context in (client_side, server_side):
        context.set_alpn_protocols(TAKEN.names)
    [inner] = await trio.open_tcp_listeners(0, host="127.0.0.1")
    [outer] = await trio.open_tcp_listeners(0, host="127.0.0.1")
    near = trio.SocketStream(await _dialled(outer))
    middle_near = await outer.accept()
    middle_far = trio.SocketStream(await _dialled(inner))
    far = await inner.accept()
    for listener in (inner, outer):
        await listener.aclose()
    nursery.start_soon(tamperer.carry, middle_near, middle_far)
    ends: dict[str, TlsConnection] = {}

    async def shake(name: str, stream: trio.SocketStream, dialled: str | None) -> None:
        ends[name] = await shake_hands(stream, client_side if dialled else server_side, TAKEN, dialled=dialled)

    async with trio.open_nursery() as both:
        both.start_soon(shake, "client", near, address)
        both.start_soon(shake, "server", far, None)
    return ends["client"], ends["server"]


async def _dialled(listener: trio.SocketListener) -> trio.socket.SocketType:
    socket = trio.socket.socket()
    await socket.connect(listener.socket.getsockname())
    return socket


@pytest.mark.parametrize("to_server", [True, False], ids=["to the server", "to the client"])
async def test_a_flipped_bit_ends_the_connection_and_nothing_is_delivered(to_server: bool) -> None:
    worlds, dice = RealWorlds(), Random(6)
    for _ in range(CONNECTIONS):
        tamperer = Tamperer(to_server)
        with trio.fail_after(LIMIT_S):
            async with trio.open_nursery() as nursery:
                client, server = await connected(worlds, tamperer, nursery)
                source, target = (client, server) if to_server else (server, client)
                await source.send(b"hello")
                assert await target.receive(100) == b"hello"
                tamperer.bit = dice.randrange(1 << 20)
                await source.send(SECRET + dice.randbytes(dice.randrange(5_000)))
                # A length that was made greater waits for more; the end of the stream is all that it gets.
                nursery.start_soon(source.aclose)
                with pytest.raises(ConnectionLost):
                    raise AssertionError(f"{await target.receive(10_000)!r} was delivered")
                assert tamperer.flipped
                with pytest.raises(ConnectionLost):
                    raise AssertionError(f"{await target.receive(10_000)!r} was delivered")
                await target.aclose()
