"""If this failed, anybody who reaches the ports could keep the members of a cluster from working."""

from __future__ import annotations

import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest
import trio
import trio.testing

from conformance.world.logs import logged
from conformance.world.makers import RealWorlds
from scenefold.base.limits import PENDING_HANDSHAKES_MAX
from scenefold.crypto import client_context
from scenefold.world import Connection, Priority
from scenefold.world.real import admission, door
from scenefold.world.real.network import RealNetwork

LOW = Priority.LOW


async def echo(connection: Connection) -> None:
    while data := await connection.receive(1 << 16):
        await connection.send(data)


@asynccontextmanager
async def serving(worlds: RealWorlds, handshake_s_max: float = 60.0) -> AsyncIterator[RealNetwork]:
    network = RealNetwork(worlds.identity(0), worlds.authority.certificate, worlds.ports, handshake_s_max=handshake_s_max)
    async with trio.open_nursery() as nursery:
        await nursery.start(network.listen, worlds.address(0), LOW, echo)
        yield network
        nursery.cancel_scope.cancel()


async def knock(worlds: RealWorlds, source: str | None = None) -> trio.SocketStream:
    return await trio.open_tcp_stream(worlds.address(0), worlds.ports.low, local_address=source)


async def until_closed(stream: trio.SocketStream) -> None:
    """Read until the node's end closes; over what it has not read, that is a reset."""
    with suppress(trio.BrokenResourceError):
        while await stream.receive_some():
            pass
    await stream.aclose()


async def is_served(worlds: RealWorlds) -> None:
    """A member gets in and is answered."""
    with trio.fail_after(30):
        connection = await worlds.user("ada").network.connect(worlds.address(0), LOW)
        await connection.send(b"hello")
        assert await connection.receive(100) == b"hello"
        await connection.aclose()


@pytest.mark.expect_log("127.0.0.1: connection refused: what it says is not TLS")
async def test_garbage_is_logged_once_and_counted_and_blocks_nobody() -> None:
    worlds = RealWorlds()
    async with serving(worlds) as network:
        for _ in range(20):
            stream = await knock(worlds)
            await stream.send_all(b"GET / HTTP/1.0\r\n\r\n")
            await until_closed(stream)
        await is_served(worlds)
        assert network.turned_away == 20


@pytest.mark.expect_log("no TLS handshake within")
async def test_who_says_nothing_is_closed_in_time() -> None:
    worlds = RealWorlds()
    async with serving(worlds, handshake_s_max=0.05):
        async with logged("no TLS handshake within 0.05 s"), await knock(worlds) as stream:
            assert await stream.receive_some() == b""


@pytest.mark.expect_log("connection refused: (pushed out by a newer one: 64 TLS handshakes are under way|the connection was cut)")
async def test_a_crowd_that_says_nothing_keeps_no_member_out() -> None:
    worlds = RealWorlds()
    async with serving(worlds):
        crowd = [await knock(worlds) for _ in range(2 * PENDING_HANDSHAKES_MAX)]
        await is_served(worlds)
        for stream in crowd:
            await stream.aclose()


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> int:
    """Handshakes that one address may fail in, in an hour; it may open five times as many connections."""
    for name, burst in (("KNOCKS", 100), ("HANDSHAKES", 20), ("PEER_HANDSHAKES", 20)):
        monkeypatch.setattr(admission, f"{name}_BURST", burst)
        monkeypatch.setattr(admission, f"{name}_PER_S", 1e-9)
    return 20


@pytest.mark.expect_log("connections are closed: too many come, or their TLS handshakes fail|connection refused")
async def test_handshakes_that_fail_are_refused_before_they_begin_but_other_addresses_get_in(few: int) -> None:
    worlds = RealWorlds()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cadata=worlds.authority.certificate.decode())
    async with serving(worlds), logged("their TLS handshakes fail"):
        answered = 0
        for _ in range(2 * few):
            stream = trio.SSLStream(await knock(worlds, "127.0.0.77"), context, server_hostname=worlds.address(0))
            with suppress(trio.BrokenResourceError):
                await stream.do_handshake()
                answered += 1
            await trio.aclose_forcefully(stream)
        assert answered == few
        await is_served(worlds)


async def test_honest_peers_behind_one_address_come_in_as_often_as_they_like(few: int) -> None:
    worlds = RealWorlds()
    async with serving(worlds):
        for number in range(3 * few):
            connection = await worlds.user(f"ada{number % 4}").network.connect(worlds.address(0), LOW)
            await connection.aclose()
        await is_served(worlds)


@pytest.mark.expect_log("connections are closed: too many come|connection refused")
async def test_a_flood_of_connections_of_one_address_is_closed_and_keeps_no_other_out(few: int) -> None:
    worlds = RealWorlds()
    async with serving(worlds), logged("connections are closed: too many come"):
        for _ in range(6 * few):
            stream = await knock(worlds, "127.0.0.77")
            stream.socket.close()
        await is_served(worlds)


@pytest.mark.expect_log("connection refused|connections are closed")
async def test_addresses_that_begin_tls_and_hang_up_leave_no_queue_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "HANDSHAKE_GAP_S", 0.05)
    worlds = RealWorlds()
    async with serving(worlds):
        for _ in range(6):
            crowd = [await knock(worlds, f"127.0.1.{number + 1}") for number in range(PENDING_HANDSHAKES_MAX)]
            for stream in crowd:
                await stream.send_all(b"\x16\x03\x01\x00\xf0\x01")
            await trio.testing.wait_all_tasks_blocked(0.01)
            for stream in crowd:
                stream.socket.close()
        await is_served(worlds)


@pytest.mark.expect_log("did not return a certificate")
async def test_a_stranger_without_a_certificate() -> None:
    worlds = RealWorlds()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cadata=worlds.authority.certificate.decode())
    async with serving(worlds):
        stream = trio.SSLStream(await knock(worlds), context, server_hostname=worlds.address(0))
        with pytest.raises(trio.BrokenResourceError):
            await stream.receive_some()
        await trio.aclose_forcefully(stream)
        await is_served(worlds)


@pytest.mark.expect_log("connection refused")
async def test_a_stranger_with_an_older_tls() -> None:
    worlds = RealWorlds()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cadata=worlds.authority.certificate.decode())
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    async with serving(worlds):
        stream = trio.SSLStream(await knock(worlds), context, server_hostname=worlds.address(0))
        with pytest.raises(trio.BrokenResourceError):
            await stream.do_handshake()
        await trio.aclose_forcefully(stream)
        await is_served(worlds)


@asynccontextmanager
async def member_that_offers(worlds: RealWorlds, *names: str) -> AsyncIterator[trio.SSLStream[trio.SocketStream]]:
    """A member's program of another make, after its handshake."""
    context = client_context(worlds.authority.issue("user:odd", []), worlds.authority.certificate)
    if names:
        context.set_alpn_protocols(list(names))
    stream = trio.SSLStream(await knock(worlds), context, server_hostname=worlds.address(0))
    await stream.do_handshake()
    yield stream
    await trio.aclose_forcefully(stream)


@pytest.mark.expect_log("connection refused: user:odd names no version of the protocol, this program takes version 1: upgrade")
@pytest.mark.parametrize("names", [(), ("http/1.1",), ("scenefold/0", "scenefold/01", "scenefold/1 ")])
async def test_a_program_that_agrees_on_no_name_is_refused(names: tuple[str, ...]) -> None:
    worlds = RealWorlds()
    async with serving(worlds):
        async with logged("names no version"), member_that_offers(worlds, *names) as stream:
            with suppress(trio.BrokenResourceError):
                assert await stream.receive_some() == b""
        await is_served(worlds)


@pytest.mark.expect_log("connection refused: user:odd (names|takes)")
@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (b"SFDV\x00\x05\x00\x07", "takes versions 5 to 7 of the protocol, this program version 1: upgrade this program"),
        (b"SFDV\x00\x07\x00\x05", "names no version"),
        (b"SFDV\x00\x00\x00\x00", "names no version"),
        (b"XXXX\x00\x05\x00\x07", "names no version"),
        (b"GET / HTTP/1.0\r\n\r\n" * 1000, "names no version"),
    ],
)
async def test_forged_ranges_of_versions(sent: bytes, said: str) -> None:
    worlds = RealWorlds()
    async with serving(worlds):
        async with logged(said), member_that_offers(worlds, "scenefold/9", "scenefold") as stream:
            assert stream.selected_alpn_protocol() == "scenefold"
            assert await stream.receive_some() == b"SFDV\x00\x01\x00\x01"
            await stream.send_all(sent)
        await is_served(worlds)


@pytest.mark.expect_log("connection refused: made no TLS handshake within")
async def test_who_has_no_version_and_says_nothing_is_closed_in_time() -> None:
    worlds = RealWorlds()
    async with serving(worlds, handshake_s_max=0.3):
        async with logged("no TLS handshake within"), member_that_offers(worlds, "scenefold") as stream:
            with suppress(trio.BrokenResourceError):
                while await stream.receive_some():
                    pass
