"""If this failed, code that runs in one world would not run in the other: clock and entropy."""

from __future__ import annotations

import time

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


async def test_the_stopwatch_measures_what_computing_takes_where_that_takes_any_time(worlds: Worlds) -> None:
    clock = worlds.node(0).clock
    stopwatch = clock.stopwatch
    now = clock.now()
    begin = None if stopwatch is None else stopwatch()
    until = time.perf_counter() + 0.002
    while time.perf_counter() < until:
        pass
    if stopwatch is None or begin is None:
        assert clock.now() == now
    else:
        assert stopwatch() - begin >= 0.0019
        await clock.sleep(0.01)
        assert stopwatch() - begin >= 0.0119
