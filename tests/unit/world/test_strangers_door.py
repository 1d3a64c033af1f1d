"""If this fails, strangers' handshakes leave a node no time for others, or who is too much is kept."""

from __future__ import annotations

import itertools
import socket
import ssl
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.limits import (
    HANDSHAKE_GAP_S,
    HANDSHAKES_BURST,
    HELLO_S_MAX,
    KNOCKS_BURST,
    NEWCOMER_S_MAX,
    NEWCOMERS_BURST,
    PENDING_HANDSHAKES_MAX,
)
from scenefold.world.ports import Connection, ConnectionLost
from scenefold.world.real import door as the_door
from scenefold.world.real.door import Door
from scenefold.world.versions import TAKEN

HELLO = bytes((22, 3, 1, 0, 1, 1))
"""As TLS begins."""
SOURCE, HANDSHAKE_S_MAX = "10.0.0.7", 10.0


class Caller:
    """A connection on its way in. `says`: its first bytes, None if it never says anything."""

    def __init__(self, says: bytes | None = HELLO, source: str = SOURCE) -> None:
        self._says = says
        self._source = source
        self.closed = False
        self.socket = self

    def getpeername(self) -> tuple[str, int]:
        return self._source, 1

    async def recv(self, count: int, flags: int) -> bytes:
        assert flags == socket.MSG_PEEK, "the handshake needs these bytes"
        await trio.lowlevel.checkpoint()
        if self._says is None:
            await trio.sleep_forever()
        assert self._says is not None
        return self._says[:count]


class Inside:
    """Who has come in. It stays until it is told to leave."""

    version, peer_key = 1, None

    def __init__(self, peer: str) -> None:
        self.peer = peer
        self.closed = False

    async def aclose(self) -> None:
        self.closed = True


class Hall:
    """A door, and what goes on behind it. Handshakes take no time, and end as `shake` says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, shake: Callable[[], Inside], *, newcomers: Any = None) -> None:
        self._shake = shake
        self.began_at: list[float] = []
        self.inside: list[Inside] = []
        self.served = 0
        monkeypatch.setattr(the_door, "shake_hands", self._shake_hands)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.door = Door(context, self._serve, newcomers, TAKEN, HANDSHAKE_S_MAX)

    async def _shake_hands(self, *_: object) -> Inside:
        self.began_at.append(trio.current_time())
        await trio.lowlevel.checkpoint()
        self.inside.append(self._shake())
        return self.inside[-1]

    async def _serve(self, _connection: Connection) -> None:
        self.served += 1
        await trio.sleep_forever()

    async def receive(self, *callers: Caller) -> None:
        """All of them at once; until each has left or been sent away."""
        async with trio.open_nursery() as nursery:
            for caller in callers:
                nursery.start_soon(self.door.receive, caller)


def fails() -> Inside:
    raise ConnectionLost("it was cut")


REFUSED = pytest.mark.expect_log("connection refused")


@REFUSED
async def test_handshakes_begin_one_after_the_other_however_many_come_at_once(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    hall, began_at = Hall(monkeypatch, fails), trio.current_time()
    await hall.receive(*(Caller(source=f"10.0.0.{number}") for number in range(40)))
    assert hall.began_at[0] == began_at and len(hall.began_at) == 40
    assert hall.door.turned_away == 40, "each is counted, and few are said"
    gaps = [later - earlier for earlier, later in itertools.pairwise(hall.began_at)]
    assert gaps == pytest.approx([HANDSHAKE_GAP_S] * 39)
    await trio.sleep(1.0)
    came_at = trio.current_time()
    await hall.receive(Caller())
    assert hall.began_at[-1] == came_at, "who comes when nobody else does waits for nothing, and nothing was saved up"
    await hall.receive(Caller(), Caller())
    assert hall.began_at[-1] - came_at == pytest.approx(2 * HANDSHAKE_GAP_S)


@REFUSED
async def test_handshakes_that_fail_are_refused_and_those_that_end_well_are_not_counted(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    monkeypatch.setattr(the_door, "time", SimpleNamespace(monotonic=lambda: 0.0))
    hall = Hall(monkeypatch, fails)
    for _ in range(2 * HANDSHAKES_BURST):
        await hall.receive(Caller())
    assert len(hall.began_at) == HANDSHAKES_BURST
    numbers = itertools.count()
    hall = Hall(monkeypatch, lambda: Inside(f"user:{next(numbers)}"))
    async with trio.open_nursery() as nursery:
        for _ in range(2 * HANDSHAKES_BURST):
            nursery.start_soon(hall.door.receive, Caller())
            await trio.sleep(HANDSHAKE_GAP_S)
        await trio.testing.wait_all_tasks_blocked()
        assert hall.served == 2 * HANDSHAKES_BURST
        nursery.cancel_scope.cancel()


@REFUSED
@pytest.mark.parametrize("says", [b"", b"GET / HTTP/1.0", None])
async def test_who_does_not_begin_as_tls_does_costs_no_handshake(
    says: bytes | None, monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    monkeypatch.setattr(the_door, "time", SimpleNamespace(monotonic=lambda: 0.0))
    hall, came_at = Hall(monkeypatch, fails), trio.current_time()
    await hall.receive(*(Caller(says) for _ in range(HANDSHAKES_BURST)))
    assert not hall.began_at
    assert trio.current_time() - came_at == pytest.approx(HELLO_S_MAX if says is None else 0.0)
    for _ in range(HANDSHAKES_BURST):
        await hall.receive(Caller())
    assert len(hall.began_at) == HANDSHAKES_BURST, "none of them was used up"


@REFUSED
async def test_a_handshake_that_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock) -> None:
    async def never(*_: object) -> None:
        await trio.sleep_forever()

    hall, came_at = Hall(monkeypatch, fails), trio.current_time()
    monkeypatch.setattr(the_door, "shake_hands", never)
    await hall.receive(Caller())
    assert trio.current_time() - came_at == pytest.approx(HANDSHAKE_S_MAX)


@REFUSED
async def test_who_is_pushed_out_by_a_newer_one_is_not_said_to_be_slow(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock, caplog: pytest.LogCaptureFixture
) -> None:
    async def never(*_: object) -> None:
        await trio.sleep_forever()

    def said() -> list[str]:
        return [record.getMessage() for record in caplog.records]

    hall = Hall(monkeypatch, fails)
    monkeypatch.setattr(the_door, "shake_hands", never)
    monkeypatch.setattr(hall.door._admission, "may_shake_hands", lambda *_: True)
    pushed_out = f"{SOURCE}: connection refused: pushed out by a newer one: {PENDING_HANDSHAKES_MAX} TLS handshakes are under way"
    async with trio.open_nursery() as nursery:
        for _ in range(PENDING_HANDSHAKES_MAX):
            nursery.start_soon(hall.door.receive, Caller())
        await trio.sleep(1.0)
        assert not said()
        nursery.start_soon(hall.door.receive, Caller())
        await trio.sleep(1.0)
        assert said() == [pushed_out]
    assert said() == [pushed_out, f"{SOURCE}: connection refused: made no TLS handshake within {HANDSHAKE_S_MAX:g} s"]


@pytest.mark.expect_log("refused: 3 connections are open")
async def test_beyond_so_many_connections_one_more_is_closed_until_one_leaves(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    monkeypatch.setattr(the_door, "CONNECTIONS_MAX", 3)
    hall = Hall(monkeypatch, lambda: Inside("user:ada"))
    async with trio.open_nursery() as nursery:
        leaves = trio.CancelScope()

        async def stays() -> None:
            with leaves:
                await hall.door.receive(Caller())  # type: ignore[arg-type]

        nursery.start_soon(stays)
        for _ in range(2):
            nursery.start_soon(hall.door.receive, Caller())
        await trio.sleep(1.0)
        await hall.receive(Caller())
        assert hall.door.turned_away == 1
        assert hall.served == 3 and not any(one.closed for one in hall.inside[:3])
        leaves.cancel()
        await trio.testing.wait_all_tasks_blocked()
        nursery.start_soon(hall.door.receive, Caller())
        await trio.sleep(1.0)
        assert hall.served == 4
        nursery.cancel_scope.cancel()


@pytest.mark.expect_log("connections are closed: too many come")
async def test_who_knocks_too_often_is_refused_by_its_address_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(the_door, "time", SimpleNamespace(monotonic=lambda: 0.0))
    hall = Hall(monkeypatch, fails)
    assert sum(hall.door.may_knock(SOURCE) for _ in range(2 * KNOCKS_BURST)) == KNOCKS_BURST
    assert hall.door.may_knock("10.0.0.8")
    assert hall.door.turned_away == KNOCKS_BURST


@pytest.mark.expect_log("a newcomer is sent away: too many of this address showed no open invitation")
async def test_newcomers_of_an_address_that_show_no_invitation_are_counted_and_those_that_do_are_not(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    monkeypatch.setattr(the_door, "time", SimpleNamespace(monotonic=lambda: 0.0))
    talked_to = []

    async def talk(_connection: object, expect: Callable[[bytes], None]) -> None:
        if is_expected:
            expect(b"%d" % len(talked_to))
        talked_to.append(is_expected)

    is_expected = True
    hall = Hall(monkeypatch, lambda: Inside(""), newcomers=talk)
    # An address is refused handshakes as well, and gets none back for these.
    monkeypatch.setattr(hall.door._admission, "may_shake_hands", lambda *_: True)
    for is_expected in (True, False):  # noqa: B007 - seen by talk
        for _ in range(2 * NEWCOMERS_BURST):
            await hall.receive(Caller())
    assert talked_to == [True] * 2 * NEWCOMERS_BURST + [False] * NEWCOMERS_BURST
    assert hall.door.turned_away == NEWCOMERS_BURST, "who is served is not among them"
    assert all(one.closed for one in hall.inside)


async def test_newcomers_are_closed_where_nobody_talks_to_them(
    monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock
) -> None:
    hall = Hall(monkeypatch, lambda: Inside(""))
    await hall.receive(Caller())
    assert not hall.served and hall.inside[0].closed


@pytest.mark.expect_log("a newcomer is sent away: its time was over|too many newcomers")
async def test_a_newcomer_that_does_not_leave_is_sent_away(monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock) -> None:
    async def talk(*_: object) -> None:
        await trio.sleep_forever()

    hall, came_at = Hall(monkeypatch, lambda: Inside(""), newcomers=talk), trio.current_time()
    monkeypatch.setattr(the_door, "time", SimpleNamespace(monotonic=trio.current_time))
    await hall.receive(Caller())
    assert trio.current_time() - came_at == pytest.approx(NEWCOMER_S_MAX) and hall.inside[0].closed
