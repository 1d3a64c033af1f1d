"""If this fails, who has no certificate gets further than to ask for one, or keeps those away who have; or a newcomer tells its secret to a stranger."""

from __future__ import annotations

import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
import trio

from integration.clusters import Nodes, links_of_user, nodes_here
from loopback import addresses, free_ports
from scenefold.base.errors import Refused, TurnedAway, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.limits import NEWCOMERS_MAX
from scenefold.client import connect
from scenefold.client.enrolling import enrol
from scenefold.crypto import ENROL_DOMAIN, SigningKey, Token, mark_of, newcomer_context
from scenefold.wire import Fault, FrameReader, RequestTable, RespondTable, decode_packet, encode_frame
from scenefold.wire.enrol_packets import Greeting, RequestEnrolment
from scenefold.wire.orders import EnrolForm
from scenefold.world import Priority, newcomer_world
from scenefold.world.knocking import request_enrolment
from scenefold.world.profile import ClusterProfile

NEWCOMER = "scenefold-enrol/1"
FIRST = "127.0.0.2"
AGAIN_S = 0.2
ADMITTED_S_MAX = 60.0
ELSEWHERE = "127.0.0.99"
GARBAGE = RequestEnrolment(form=b"x" * 40, signature=bytes(64))


@asynccontextmanager
async def stranger(nodes: Nodes, *names: str, at: str | None = None) -> AsyncIterator[trio.SSLStream[trio.SocketStream]]:
    """A TLS connection to the first node, without a certificate, under one of these names."""
    stream = await trio.open_tcp_stream(FIRST, nodes.profile.ports.high, local_address=at)
    context = newcomer_context()
    context.set_alpn_protocols(list(names))
    secure: trio.SSLStream[trio.SocketStream] = trio.SSLStream(stream, context, server_hostname=FIRST, https_compatible=True)
    try:
        await secure.do_handshake()
        yield secure
    finally:
        await trio.aclose_forcefully(secure)


async def all_of(secure: trio.SSLStream[trio.SocketStream]) -> bytes:
    data = b""
    with trio.fail_after(20):
        try:
            while more := await secure.receive_some(65536):
                data += more
        except trio.BrokenResourceError:
            return data
    return data


async def served(nodes: Nodes) -> None:
    """A member is served as ever."""
    async with links_of_user(nodes.profile) as links:
        assert isinstance(await links.request(FIRST, Priority.HIGH, RequestTable(), 10), RespondTable)


@pytest.mark.expect_log("connection refused: the other side's certificate names no member")
async def test_without_a_certificate_nothing_else_is_spoken(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 1) as nodes:
        async with stranger(nodes, "scenefold/1") as secure:
            assert await all_of(secure) == b"", "whoever names no certificate is not even answered"
        async with stranger(nodes, "scenefold") as secure:
            assert await all_of(secure) == b""


@pytest.mark.expect_log("a newcomer is refused")
@pytest.mark.expect_log("a newcomer")
async def test_whatever_a_newcomer_sends_it_gets_a_greeting_and_one_refusal(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 1) as nodes:
        for sent in (
            encode_frame(GARBAGE),
            encode_frame(RequestTable(request_id=7)),
            struct.pack(">I", 8_000_000) + b"x" * 100,
            struct.pack(">I", 3) + b"\x93\xcc\xff",
            struct.pack(">I", 0),
        ):
            async with stranger(nodes, NEWCOMER) as secure:
                await secure.send_all(sent)
                greeting, refusal = [decode_packet(frame) for frame in FrameReader().feed(await all_of(secure))]
            assert isinstance(greeting, Greeting) and mark_of(greeting.authority) == mark_of(nodes.profile.authority_certificate())
            assert isinstance(refusal, Fault), sent[:20]
        await served(nodes)


@pytest.mark.expect_log("a newcomer is sent away|connection refused")
@pytest.mark.expect_log("a newcomer")
async def test_newcomers_that_say_nothing_keep_nobody_away(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 1) as nodes, trio.open_nursery() as nursery:
        async with connect(nodes.profile.folder) as cluster:
            token = await cluster.membership.invite("user:ada", seconds=600)
        silent = 0
        all_here = trio.Event()

        async def be_silent() -> None:
            nonlocal silent
            while True:
                with suppress(trio.BrokenResourceError, OSError):
                    async with stranger(nodes, NEWCOMER, at=ELSEWHERE) as secure:
                        await secure.receive_some(65536)
                        silent += 1
                        if silent == NEWCOMERS_MAX:
                            all_here.set()
                        await all_of(secure)
                # Pushed out, or told that its time is over, it comes again.
                await trio.sleep(AGAIN_S)

        for _ in range(2 * NEWCOMERS_MAX):
            nursery.start_soon(be_silent)
        await all_here.wait()
        await served(nodes)
        joined = await until_admitted(tmp_path / "ada", token)
        assert joined.user == "ada"
        nursery.cancel_scope.cancel()


async def until_admitted(folder: Path, token: Token) -> ClusterProfile:
    """Fails if nobody lets it in for ADMITTED_S_MAX."""
    with trio.fail_after(ADMITTED_S_MAX):
        while True:
            try:
                return await enrol(folder, token)
            except Unreachable:
                await trio.sleep(AGAIN_S)


@pytest.mark.expect_log("a newcomer")
async def test_a_newcomer_tells_nothing_to_a_node_of_another_cluster(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 1) as nodes:
        with pytest.raises(TurnedAway, match="another cluster"):
            await request_enrolment(newcomer_world(nodes.profile.ports).network, node_id_of(FIRST), bytes(16), never)
        async with connect(nodes.profile.folder) as cluster:
            token = await cluster.membership.invite("user:ada", seconds=600)
        with pytest.raises(Refused, match="no such token"):
            await request_enrolment(newcomer_world(nodes.profile.ports).network, node_id_of(FIRST), token.mark, own_form)
        joined = await enrol(tmp_path / "ada", token)
        assert joined.user == "ada" and joined.facts().genesis_header == nodes.profile.facts().genesis_header


async def never() -> RequestEnrolment:
    raise AssertionError("a request is made for who showed that it is a node of the cluster")


async def own_form() -> RequestEnrolment:
    """A form by an invitation that nobody gave."""
    key = SigningKey.generate()
    form = EnrolForm(key.public.raw, "user:eve", node_id_of("0.0.0.0"), b"t", b"k").encode()
    return RequestEnrolment(form=form, signature=key.sign(ENROL_DOMAIN, form))


async def test_while_no_node_runs_the_token_waits(tmp_path: Path) -> None:
    profile = ClusterProfile.create(tmp_path / "profile", "trial", addresses(1), ports=free_ports(addresses(1)))
    async with nodes_here(tmp_path, 1, profile=profile), connect(profile.folder) as cluster:
        token = await cluster.membership.invite("user:ada", seconds=600)
    with pytest.raises(Unreachable, match="no node of the cluster takes the token"):
        await enrol(tmp_path / "ada", token)
    async with nodes_here(tmp_path, 1, profile=profile):
        assert (await enrol(tmp_path / "ada", token)).user == "ada"
