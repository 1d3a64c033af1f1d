"""If this fails, one packet that nobody thought of ends a node, and with it everybody else's work."""

from __future__ import annotations

import logging

import pytest
import trio
import trio.testing

from scenefold.base.reasons import RejectReason
from scenefold.simulation.logs import hear_bugs, quiet_logs
from scenefold.wire import Fault, FrameReader, ListScenes, Packet, RequestPublicKey, decode_packet, encode_frame
from scenefold.world import DiskFailed, serve_connection
from scenefold.world.serving import Handler

SECRET = "0123456789abcdef of a key"
BAD, GOOD = RequestPublicKey(request_id=5, mini_status=None, key=7), ListScenes(request_id=6)


class Line:
    """A connection over which these packets come; `answers` is what went back."""

    version = 1
    peer = "user:eve"
    peer_key = None

    def __init__(self, *packets: Packet) -> None:
        self._arriving = [encode_frame(packet) for packet in packets]
        self._reader = FrameReader()
        self.answers: dict[int, Packet] = {}

    async def receive(self, _count_max: int) -> bytes:
        await trio.testing.wait_all_tasks_blocked()
        return self._arriving.pop(0) if self._arriving else b""

    async def send(self, data: bytes) -> None:
        await trio.lowlevel.checkpoint()
        for payload in self._reader.feed(data):
            answer = decode_packet(payload)
            self.answers[answer.request_id] = answer

    async def aclose(self) -> None:
        raise AssertionError


def failing(*errors: BaseException) -> Handler:
    async def handle(packet: Packet, _peer: str) -> Packet:
        await trio.lowlevel.checkpoint()
        if isinstance(packet, RequestPublicKey):
            held = SECRET  # which no log line may show
            if len(errors) > 1:
                raise BaseExceptionGroup(f"several, beside {len(held)} characters", errors)
            raise errors[0]
        return packet

    return handle


@pytest.mark.expect_log("user:eve: an internal error")
@pytest.mark.parametrize("error", [OverflowError("1"), MemoryError(), AssertionError("a bug"), KeyError("x"), RecursionError()])
async def test_a_bug_is_answered_and_the_others_are_served_on(error: Exception, caplog: pytest.LogCaptureFixture) -> None:
    line = Line(BAD, GOOD)
    await serve_connection(line, failing(error))
    fault = line.answers[5]
    assert isinstance(fault, Fault) and fault.reason == RejectReason.NOT_READY
    assert isinstance(line.answers[6], ListScenes)
    (told,) = [record for record in caplog.records if record.name == "scenefold.bugs"]
    assert told.levelno == logging.ERROR and told.exc_info is not None
    assert "in handle" in caplog.text and SECRET not in caplog.text


@pytest.mark.expect_log("user:eve: an internal error")
async def test_a_group_of_bugs_is_one() -> None:
    line = Line(BAD, GOOD)
    await serve_connection(line, failing(ValueError(), KeyError()))
    assert isinstance(line.answers[5], Fault) and isinstance(line.answers[6], ListScenes)


@pytest.mark.expect_log("user:eve: an internal error")
async def test_what_the_exception_says_is_not_the_peers_business() -> None:
    line = Line(BAD)
    await serve_connection(line, failing(ValueError(SECRET)))
    fault = line.answers[5]
    assert isinstance(fault, Fault) and SECRET not in fault.text


@pytest.mark.expect_log("user:eve: an internal error")
async def test_a_flood_of_them_is_one_line(caplog: pytest.LogCaptureFixture) -> None:
    await serve_connection(Line(*[BAD] * 50), failing(OverflowError()))
    assert len([record for record in caplog.records if record.name == "scenefold.bugs"]) == 1


@pytest.mark.parametrize("errors", [(DiskFailed("gone"),), (ValueError(), DiskFailed("gone")), (KeyboardInterrupt(),)])
async def test_a_failed_disk_still_ends_the_node(errors: tuple[BaseException, ...]) -> None:
    with pytest.raises(BaseExceptionGroup) as caught:
        await serve_connection(Line(BAD, GOOD), failing(*errors))
    assert caught.value.subgroup(type(errors[-1])) is not None


async def test_a_simulation_hears_of_each() -> None:
    heard: list[str] = []
    with quiet_logs():
        hear_bugs(heard.append)
        await serve_connection(Line(BAD), failing(OverflowError("too much")))
    assert heard == ["user:eve: an internal error, OverflowError, in answering it: too much"]
    with quiet_logs():
        await serve_connection(Line(BAD), failing(OverflowError("again")))
    assert len(heard) == 1
