"""If this failed, a cancelled or stuck sender would spoil a connection for everybody else on it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import trio
import trio.testing

from scenefold.base.limits import SEND_STALL_S_MAX
from scenefold.world.guests import Budget
from scenefold.world.outbox import PIECE_BYTES, Outbox
from scenefold.world.ports import ConnectionLost


class Wire:
    """A connection that only sends, piece by piece, as fast as it is allowed to."""

    peer = "node:1"
    version = 1

    def __init__(self) -> None:
        self.sent = b""
        self.open = trio.Event()

    async def send(self, data: bytes | memoryview) -> None:
        assert len(data) <= PIECE_BYTES
        await self.open.wait()
        await trio.lowlevel.checkpoint()
        self.sent += bytes(data)

    async def receive(self, _count_max: int) -> bytes:
        raise AssertionError

    async def aclose(self) -> None:
        raise AssertionError


async def test_a_cancelled_caller_leaves_whole_frames() -> None:
    wire = Wire()
    outbox = Outbox(wire)
    frames = [bytes([number]) * (PIECE_BYTES + 100) for number in range(3)]
    async with trio.open_nursery() as nursery:
        nursery.start_soon(outbox.run)
        with trio.CancelScope() as scope:
            await outbox.put(frames[0])
            async with trio.open_nursery() as callers:
                callers.start_soon(outbox.put, frames[1])
                await trio.testing.wait_all_tasks_blocked()
                scope.cancel()
        wire.open.set()
        await outbox.put(frames[2])
        await outbox.finish()
    assert wire.sent == frames[0] + frames[2]
    with pytest.raises(ConnectionLost):
        await outbox.put(b"late")


async def test_small_frames_that_wait_leave_together() -> None:
    wire = Wire()
    outbox = Outbox(wire)
    async with trio.open_nursery() as nursery:
        for number in range(10):
            nursery.start_soon(outbox.put, bytes([number]) * 10)
        await trio.testing.wait_all_tasks_blocked()
        wire.open.set()
        nursery.start_soon(outbox.run)
        await trio.testing.wait_all_tasks_blocked()
        await outbox.finish()
    assert sorted(wire.sent[::10]) == list(range(10))


async def test_a_peer_that_reads_nothing_is_given_up(autojump_clock: trio.testing.MockClock) -> None:
    outbox = Outbox(Wire())
    begin = trio.current_time()

    async def run() -> None:
        with pytest.raises(ConnectionLost, match="read nothing"):
            await outbox.run()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(run)
        await outbox.put(b"frame")
        await trio.testing.wait_all_tasks_blocked()
        with pytest.raises(ConnectionLost):
            await outbox.put(b"another")
    assert trio.current_time() - begin == pytest.approx(SEND_STALL_S_MAX)
    assert autojump_clock.autojump_threshold == 0


async def test_a_budget_bounds_number_and_bytes() -> None:
    budget = Budget(3, 100)
    taken: list[int] = []

    async def take(sizes: list[int]) -> None:
        for size in sizes:
            await budget.take(size)
            taken.append(size)

    give_back: Callable[[int], None] = budget.give_back
    async with trio.open_nursery() as nursery:
        nursery.start_soon(take, [60, 50, 10, 10, 10])
        await trio.testing.wait_all_tasks_blocked()
        assert taken == [60]
        give_back(60)
        await trio.testing.wait_all_tasks_blocked()
        assert taken == [60, 50, 10, 10]
        give_back(10)
        await trio.testing.wait_all_tasks_blocked()
        assert taken == [60, 50, 10, 10, 10]
