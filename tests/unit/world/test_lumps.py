"""If this fails, a large frame costs a step of a task, and a look at the clock, for each 64 KiB."""

from __future__ import annotations

import socket

import trio

from scenefold.world.real.tls import SEND_PIECE_BYTES, Lumps

MUCH = 100_000
"""More than Trio reads at once if nobody says how much; less than any kernel takes in."""


async def test_all_that_is_here_is_read_at_once() -> None:
    async with await _listener() as listener:
        near = await trio.open_tcp_stream(*listener.socket.getsockname())
        async with near, await listener.accept() as far:
            await near.send_all(bytes(MUCH))
            while len(await far.socket.recv(MUCH, socket.MSG_PEEK)) < MUCH:  # noqa: ASYNC110 - the kernel says no more than that there is something
                await trio.sleep(0.001)
            assert len(await Lumps(far).receive_some()) == MUCH


async def test_it_passes_on_what_it_is_given_and_closes() -> None:
    async with await _listener() as listener:
        near = Lumps(await trio.open_tcp_stream(*listener.socket.getsockname()))
        async with await listener.accept() as far:
            assert far.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT) < SEND_PIECE_BYTES
            Lumps(far)
            assert far.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT) == SEND_PIECE_BYTES
            async with near:
                await near.wait_send_all_might_not_block()
                await near.send_all(b"words")
            assert await far.receive_some() == b"words"
            assert await far.receive_some() == b""


async def _listener() -> trio.SocketListener:
    (listener,) = await trio.open_tcp_listeners(0, host="127.0.0.1")
    return listener
