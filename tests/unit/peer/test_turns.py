"""If this fails, of authors who change a scene at once some lose again and again, or one who goes away holds up all others."""

from __future__ import annotations

import pytest
import trio
import trio.testing
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.scene_log.turns import BACK_S_MAX, BACK_S_MIN, TURN_S_MAX, WAITING_MAX, Line, Turns
from unit.peer.village import TrioClock

A, B, C = (bytes([number]) * 16 for number in range(3))


def test_who_comes_first_goes_first_and_keeps_its_place_while_it_makes_its_change_anew() -> None:
    line = Line()
    for request in (A, B, C):
        assert line.enter(request, 0.0)
    assert [line.is_first(request, 0.0) for request in (A, B, C)] == [True, False, False]
    line.leave(A, 0.0, comes_back=True)
    assert not line.is_first(B, 0.1), "A is on its way"
    assert line.enter(A, 0.1) and line.is_first(A, 0.1)
    line.leave(A, 0.1, comes_back=False)
    assert line.is_first(B, 0.1) and len(line) == 2


def test_who_does_not_come_back_loses_its_place() -> None:
    line = Line()
    line.enter(A, 0.0)
    line.enter(B, 0.0)
    line.leave(A, 0.0, comes_back=True)
    assert line.next_s(0.0) == line.kept_s
    assert not line.is_first(B, line.kept_s / 2)
    assert line.is_first(B, line.kept_s)
    line.enter(A, line.kept_s)
    assert not line.is_first(A, line.kept_s), "it stands behind by now"


def test_a_place_is_kept_as_long_as_others_took_lately() -> None:
    quick, slow = Line(), Line()
    for line, took_s in ((quick, 0.01), (slow, 1.5)):
        now = 0.0
        for _ in range(30):
            line.enter(A, now)
            line.leave(A, now, comes_back=True)
            now += took_s
            line.enter(A, now)
            line.leave(A, now, comes_back=False)
    assert (quick.kept_s, slow.kept_s) == (BACK_S_MIN, BACK_S_MAX)


async def test_a_line_has_an_end() -> None:
    turns = Turns(TrioClock())
    for number in range(WAITING_MAX):
        assert turns.enter(number.to_bytes(16, "big"))
    with pytest.raises(Refused) as refused:
        turns.enter(bytes([255]) * 16)
    assert refused.value.reason is RejectReason.BUSY
    assert not turns.enter(bytes(16)), "it is here already, and needs no second place"


async def test_each_has_its_turn_once_the_one_before_is_answered(autojump_clock: MockClock) -> None:
    turns, order = Turns(TrioClock()), list[bytes]()

    async def ask(request: bytes) -> None:
        assert turns.enter(request)
        assert await turns.comes(request)
        await trio.sleep(0.1)
        order.append(request)
        turns.leave(request, comes_back=False)

    async with trio.open_nursery() as nursery:
        for request in (B, A, C):
            nursery.start_soon(ask, request)
            await trio.testing.wait_all_tasks_blocked()
    assert order == [B, A, C] and len(turns) == 0


async def test_nobody_waits_for_ever(autojump_clock: MockClock) -> None:
    """The first hangs; whoever waits is answered before it would ask elsewhere. And one that went away is passed over."""
    turns = Turns(TrioClock())
    turns.enter(A)
    assert await turns.comes(A)
    turns.enter(B)
    begun = trio.current_time()
    assert not await turns.comes(B)
    assert trio.current_time() - begun == pytest.approx(TURN_S_MAX)
    turns.leave(B, comes_back=True)
    turns.leave(A, comes_back=True)
    turns.enter(C)
    assert await turns.comes(C), "A and B do not come back"
