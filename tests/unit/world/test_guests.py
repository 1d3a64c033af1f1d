"""If this failed, one member with many connections, or with frames that never end, could keep a node from serving the others."""

from __future__ import annotations

import pytest
import trio
import trio.testing

from scenefold.base.limits import (
    CONNECTIONS_PER_PEER_MAX,
    FRAME_BYTES_MAX,
    FRAME_S_MAX,
    PEER_REQUEST_BYTES_HANDLED_MAX,
    PEER_REQUESTS_HANDLED_MAX,
)
from scenefold.wire import Fault, Packet, RequestPublicKey, SendRays, decode_packet, encode_frame
from scenefold.world import Guests, serve_connection
from scenefold.world.ports import ConnectionLost
from scenefold.world.turns import BESIDE_S, TURN_S, TURNS_MAX, Turns


class Line:
    """A connection that a test feeds, and whose answers it counts."""

    version = 1
    peer_key = None

    def __init__(self, peer: str) -> None:
        self.peer = peer
        self.answers: list[bytes] = []
        self.ended = trio.Event()
        self.unread = 0
        self._send, self._receive = trio.open_memory_channel[bytes](1000)

    def feed(self, data: bytes) -> None:
        self.unread += 1
        self._send.send_nowait(data)

    def close(self) -> None:
        self._send.close()

    async def send(self, data: bytes | memoryview) -> None:
        await trio.lowlevel.checkpoint()
        self.answers.append(bytes(data))

    async def receive(self, _count_max: int) -> bytes:
        try:
            data = await self._receive.receive()
        except trio.EndOfChannel:
            return b""
        self.unread -= 1
        return data

    async def aclose(self) -> None:
        raise AssertionError


class Port:
    """A node's port; its handler answers when the test says so."""

    def __init__(self, nursery: trio.Nursery) -> None:
        self._nursery = nursery
        self._guests = Guests()
        self.handled: dict[str, int] = {}
        self.may_answer = trio.Event()

    def connect(self, peer: str) -> Line:
        line = Line(peer)
        self._nursery.start_soon(self._serve, line)
        return line

    async def _serve(self, line: Line) -> None:
        await serve_connection(line, self._handle, guests=self._guests)
        line.ended.set()

    async def _handle(self, packet: Packet, peer: str) -> Packet:
        self.handled[peer] = self.handled.get(peer, 0) + 1
        await self.may_answer.wait()
        return packet

    @property
    def peers(self) -> int:
        return len(self._guests._shares)


QUESTION = encode_frame(RequestPublicKey(request_id=1, mini_status=None, key=7))


def large(size: int) -> bytes:
    return encode_frame(SendRays(1, 0, 0, 1, 0, b"", (), (), (), (), bytes(size), request_id=1))


@pytest.fixture
def port(nursery: trio.Nursery) -> Port:
    """It closes when the test ends."""
    return Port(nursery)


@pytest.mark.expect_log("its oldest connection is closed: it has too many")
async def test_too_many_connections_push_out_the_peers_own_oldest(port: Port, autojump_clock: trio.testing.MockClock) -> None:
    honest = port.connect("user:honest")
    lines = [port.connect("user:pushy") for _ in range(10 * CONNECTIONS_PER_PEER_MAX)]
    await trio.testing.wait_all_tasks_blocked()
    kept = [line for line in lines if not line.ended.is_set()]
    assert len(kept) == CONNECTIONS_PER_PEER_MAX
    port.may_answer.set()
    for line in (honest, kept[0]):
        line.feed(QUESTION)
        await trio.testing.wait_all_tasks_blocked()
        assert len(line.answers) == 1
    for line in (honest, *kept):
        line.close()
    await trio.testing.wait_all_tasks_blocked()
    assert port.peers == 0, "nothing is kept of who has gone"


async def test_requests_of_all_connections_of_a_peer_are_counted_together(port: Port, autojump_clock: trio.testing.MockClock) -> None:
    for line in [port.connect("user:pushy") for _ in range(20)]:
        line.feed(QUESTION * 50)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled == {"user:pushy": PEER_REQUESTS_HANDLED_MAX}
    honest = port.connect("user:honest")
    honest.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:honest"] == 1
    port.may_answer.set()
    await trio.sleep(10.0)
    assert port.handled["user:pushy"] == 20 * 50, "who waits gets its turn"


async def test_beside_others_a_peer_begins_a_few_requests_at_a_time_over_all_its_connections(
    port: Port, autojump_clock: trio.testing.MockClock
) -> None:
    honest = port.connect("user:honest")
    honest.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    for line in [port.connect("user:pushy") for _ in range(5)]:
        line.feed(QUESTION * 10)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled == {"user:honest": 1, "user:pushy": TURNS_MAX}
    await trio.sleep(TURN_S)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:pushy"] == 2 * TURNS_MAX, "what takes long keeps nobody waiting"
    honest.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:honest"] == 2
    port.may_answer.set()
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:pushy"] == 50


async def test_a_connection_that_breaks_while_its_requests_wait_for_their_turn_binds_nothing(
    port: Port, autojump_clock: trio.testing.MockClock
) -> None:
    honest = port.connect("user:honest")
    honest.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    for _ in range(3 * PEER_REQUESTS_HANDLED_MAX // 50):
        line = port.connect("user:pushy")
        line.feed(QUESTION * 50)
        await trio.testing.wait_all_tasks_blocked()
        line.close()
        await line.ended.wait()
    line = port.connect("user:pushy")
    await trio.sleep(TURN_S)
    before = port.handled["user:pushy"]
    line.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:pushy"] == before + 1


async def test_large_frames_that_have_begun_count_together_with_those_that_are_handled(
    port: Port, autojump_clock: trio.testing.MockClock
) -> None:
    frame = large(FRAME_BYTES_MAX - 70_000)
    lines = [port.connect("user:pushy") for _ in range(3 * PEER_REQUEST_BYTES_HANDLED_MAX // FRAME_BYTES_MAX)]
    for line in lines:
        line.feed(frame[:100])
        for start in range(100, len(frame), 1 << 20):
            line.feed(frame[start : start + (1 << 20)])
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:pushy"] <= PEER_REQUEST_BYTES_HANDLED_MAX // (FRAME_BYTES_MAX - 70_000)
    waiting = [line for line in lines if line.unread]
    assert len(waiting) == 2 * len(lines) // 3 and all(line.unread == 8 for line in waiting), "nothing more of them is read"
    port.may_answer.set()
    await trio.testing.wait_all_tasks_blocked()
    assert all(sum(map(len, line.answers)) == len(frame) for line in lines)


@pytest.mark.expect_log("the connection ended within a frame")
async def test_a_frame_that_was_begun_and_given_up_is_not_counted_for_ever(port: Port, autojump_clock: trio.testing.MockClock) -> None:
    port.may_answer.set()
    for _ in range(5 * PEER_REQUESTS_HANDLED_MAX):
        line = port.connect("user:pushy")
        keeps = port.connect("user:pushy")
        line.feed(large(1 << 20)[:1000])
        await trio.testing.wait_all_tasks_blocked()
        line.close()
        await line.ended.wait()
        keeps.feed(QUESTION)
        await trio.testing.wait_all_tasks_blocked()
        assert len(keeps.answers) == 1
        keeps.close()


@pytest.mark.expect_log(f"a frame did not arrive whole within {FRAME_S_MAX:g} s")
async def test_a_byte_a_second_is_too_slow(port: Port, autojump_clock: trio.testing.MockClock) -> None:
    port.may_answer.set()
    slow, idle = port.connect("user:slow"), port.connect("user:idle")
    frame = large(1000)
    began_at = trio.current_time()
    for at in range(len(frame)):
        if slow.ended.is_set():
            break
        slow.feed(frame[at : at + 1])
        await trio.sleep(1.0)
    assert FRAME_S_MAX - 1 <= trio.current_time() - began_at <= FRAME_S_MAX + 2
    assert not idle.ended.is_set(), "who has begun nothing may be silent"
    idle.feed(QUESTION)
    await trio.testing.wait_all_tasks_blocked()
    assert not isinstance(decode_packet(idle.answers[0][4:]), Fault)


@pytest.mark.expect_log(f"a frame did not arrive whole within {FRAME_S_MAX:g} s")
async def test_a_byte_that_comes_as_patience_ends_ends_no_node(autojump_clock: trio.testing.MockClock) -> None:
    """A busy thread learns of both at once, and later than they were."""

    class Busy(Line):
        async def receive(self, count_max: int) -> bytes:
            data = await super().receive(count_max)
            with trio.CancelScope(shield=True):
                await trio.sleep(FRAME_S_MAX * 0.6)
            return data

    line = Busy("user:slow")
    for at in range(4):
        line.feed(QUESTION[at : at + 1])
    await serve_connection(line, answer_nothing, guests=Guests())
    assert line.unread == 1, "the third came too late, after the patience, and ended the connection"


async def answer_nothing(_packet: Packet, _peer: str) -> None:
    return None


async def test_time_in_which_we_do_not_read_is_not_the_peers(port: Port, autojump_clock: trio.testing.MockClock) -> None:
    line = port.connect("user:busy")
    line.feed(QUESTION * 64 + QUESTION[:5])
    line.feed(QUESTION[5:] + QUESTION[:5])
    await trio.sleep(10 * FRAME_S_MAX)
    assert not line.ended.is_set()
    port.may_answer.set()
    line.feed(QUESTION[5:])
    await trio.testing.wait_all_tasks_blocked()
    assert port.handled["user:busy"] == 66


@pytest.mark.expect_log("it was cut")
async def test_a_lost_connection_ends_only_itself(autojump_clock: trio.testing.MockClock) -> None:
    class Broken(Line):
        async def receive(self, _count_max: int) -> bytes:
            await trio.lowlevel.checkpoint()
            raise ConnectionLost("it was cut")

    guests = Guests()

    async def handle(packet: Packet, _peer: str) -> Packet:
        return packet

    await serve_connection(Broken("user:ada"), handle, guests=guests)
    assert not guests._shares


async def test_who_waits_beside_others_goes_on_once_they_are_gone(autojump_clock: trio.testing.MockClock) -> None:
    turns = Turns(lambda peer: peer.startswith("node:"))
    guests = Guests(turns)
    with guests.admitted("node:5") as (share, _):
        turns.end(("user:ada", 0), turns.begin(("user:ada", 0), trio.current_time()))
        turns.pay(("node:5", 0), 3.0, trio.current_time())
        assert turns.wait_s(("node:5", 0), trio.current_time()) > 3 * BESIDE_S
        await share.take_turn()
        assert trio.current_time() < 2.1 * BESIDE_S
