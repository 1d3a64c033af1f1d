"""If this fails, who has no certificate yet can end a node with one request."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.reasons import RejectReason
from scenefold.peer.enrolment.enrolling import Enrolling
from scenefold.wire import Fault, FrameReader, Packet, decode_packet
from scenefold.wire.enrol_packets import Greeting
from scenefold.world import ConnectionLost, DiskFailed
from unit.peer.members_made import AUTHORITY


class Line:
    """A newcomer's connection; over what it sends the node fails."""

    def __init__(self, error: Exception) -> None:
        self._error = error
        self._reader = FrameReader()
        self.heard: list[Packet] = []

    async def receive(self, _count_max: int) -> bytes:
        await trio.lowlevel.checkpoint()
        raise self._error

    async def send(self, data: bytes) -> None:
        await trio.lowlevel.checkpoint()
        self.heard += map(decode_packet, self._reader.feed(data))


async def served(error: Exception) -> list[Packet]:
    world: Any = SimpleNamespace(clock=SimpleNamespace(now=trio.current_time))
    facts: Any = SimpleNamespace(authority=AUTHORITY.certificate)
    none: Any = None
    line: Any = Line(error)
    await Enrolling(world, facts, none, none, none, none, none).serve_newcomer(line, lambda _: None)
    return line.heard  # type: ignore[no-any-return]


@pytest.mark.expect_log("newcomers: an internal error, RecursionError")
async def test_a_request_over_which_a_node_fails_is_answered_and_ends_it_not() -> None:
    greeting, fault = await served(RecursionError("secret"))
    assert isinstance(greeting, Greeting) and isinstance(fault, Fault)
    assert fault.reason == RejectReason.NOT_READY and "secret" not in fault.text


@pytest.mark.parametrize("error", [DiskFailed("gone"), ConnectionLost("cut")])
async def test_what_is_none_of_its_bugs_is_told_to_who_called(error: Exception) -> None:
    with pytest.raises(type(error)):
        await served(error)
