"""If this fails, who has no certificate yet can end a node with one request."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
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


async def test_made_up_tokens_have_no_newcomer_refused_for_good(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    """The log is asked for few unknown ones a second; whose token was not asked for may just have been given it."""
    pulls = []

    async def pull() -> None:
        pulls.append(trio.current_time())

    log = SimpleNamespace(registry=SimpleNamespace(roll=SimpleNamespace(invitations={b"known": None})), pull=pull)
    none: Any = None
    enrolling = Enrolling(
        cast(Any, SimpleNamespace(clock=SimpleNamespace(now=trio.current_time))), none, none, none, cast(Any, log), none, none
    )
    monkeypatch.setattr("scenefold.peer.enrolment.enrolling.form_in", lambda form: SimpleNamespace(invitation=form))

    def judged(_packet: object) -> None:
        raise Refused(RejectReason.NOT_AUTHORISED, "no such token was given out")

    monkeypatch.setattr(enrolling, "_judged", judged)

    async def reason(token: bytes) -> RejectReason:
        with pytest.raises(Refused) as told:
            await enrolling._enrolled(cast(Any, SimpleNamespace(form=token)), lambda _: None)
        return told.value.reason

    strange = [await reason(b"made up %d" % number) for number in range(3)]
    assert strange == [RejectReason.NOT_AUTHORISED] * 2 + [RejectReason.NOT_READY] and len(pulls) == 2
    assert await reason(b"known") is RejectReason.NOT_AUTHORISED, "it is known, and used"
    await trio.sleep(1.0)
    assert await reason(b"made up 3") is RejectReason.NOT_AUTHORISED and len(pulls) == 3
