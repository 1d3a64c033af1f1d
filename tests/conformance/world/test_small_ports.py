"""If this failed, code that runs in one world would not run in the other: clock, entropy, workers."""

from __future__ import annotations

import threading

import pytest
import trio

from conformance.world.makers import Worlds


async def test_the_clock_goes_forward_over_a_sleep(worlds: Worlds) -> None:
    clock = worlds.node(0).clock
    before, wall_before = clock.now(), clock.wall()
    await clock.sleep(0.01)
    assert clock.now() >= before + 0.009
    assert clock.wall() > wall_before


async def test_a_sleep_can_be_cancelled(worlds: Worlds) -> None:
    with trio.move_on_after(0.01) as scope:
        await worlds.node(0).clock.sleep(1e6)
    assert scope.cancelled_caught


def test_entropy_gives_what_was_asked_for(worlds: Worlds) -> None:
    entropy = worlds.node(0).entropy
    assert len(entropy.token(16)) == 16
    assert entropy.token(16) != entropy.token(16)
    assert all(0 <= entropy.uniform() < 1 for _ in range(1000))


async def test_workers_return_and_raise(worlds: Worlds) -> None:
    workers = worlds.node(0).workers
    assert await workers.run("crypto", pow, 2, 10) == 1024
    with pytest.raises(ZeroDivisionError):
        await workers.run("import", divmod, 1, 0)


async def test_a_lane_is_no_wider_than_it_says(worlds: Worlds) -> None:
    workers = worlds.node(0).workers
    lock = threading.Lock()
    overlaps = []

    def alone() -> None:
        overlaps.append(not lock.acquire(blocking=False))
        sum(range(10_000))
        lock.release()

    async with trio.open_nursery() as nursery:
        for _ in range(50):
            nursery.start_soon(workers.run, "store", alone)
    assert overlaps == [False] * 50


async def test_waiting_for_a_lane_can_be_cancelled(worlds: Worlds) -> None:
    workers = worlds.node(0).workers
    with trio.CancelScope() as scope:
        scope.cancel()
        await workers.run("store", pytest.fail, "this must not run")
    assert scope.cancelled_caught
