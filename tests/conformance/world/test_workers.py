"""If this failed, a lane that is full would hold up others, or work would go on in the dark after its caller has gone: in one world, unnoticed in the other."""

from __future__ import annotations

import pytest
import trio

from conformance.world.makers import Worlds

LASTS_S = 0.1
AT_LEAST = 0.99
"""Of what it should take: clocks are compared."""
ON_AND_ON_S = 5.0
"""Longer than anything here has to wait, so that waiting for the wrong thing shows."""


async def test_workers_return_and_raise(worlds: Worlds) -> None:
    workers = worlds.node(0).workers
    assert await workers.run("crypto", pow, 2, 10) == 1024
    with pytest.raises(ZeroDivisionError):
        await workers.run("import", divmod, 1, 0)


async def test_a_lane_is_no_wider_than_it_says(worlds: Worlds) -> None:
    """Lane `store` is one call wide: the store has one writer, and this is its queue."""
    workers = worlds.node(0).workers
    lasting = worlds.lasting(0, LASTS_S)
    begin = trio.current_time()
    async with trio.open_nursery() as nursery:
        for _ in range(4):
            nursery.start_soon(workers.run, "store", lasting.work)
    assert trio.current_time() - begin >= 4 * LASTS_S * AT_LEAST
    assert lasting.ended == 4


@pytest.mark.parametrize("other", ["crypto", "store-read", "render", "import", "film"])
async def test_a_full_lane_never_holds_up_another(worlds: Worlds, other: str) -> None:
    workers = worlds.node(0).workers
    lasting, ends = worlds.lasting(0, ON_AND_ON_S), []

    async def store() -> None:
        await workers.run("store", lasting.work)
        ends.append("store")

    async with trio.open_nursery() as nursery:
        for _ in range(2):
            nursery.start_soon(store)
        await trio.testing.wait_all_tasks_blocked()
        await workers.run(other, int)
        ends.append(other)
        lasting.done.set()
    assert ends == [other, "store", "store"]


async def test_waiting_for_a_lane_can_be_cancelled(worlds: Worlds) -> None:
    workers = worlds.node(0).workers
    lasting = worlds.lasting(0, ON_AND_ON_S)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(workers.run, "store", lasting.work)
        await trio.testing.wait_all_tasks_blocked()
        with trio.move_on_after(LASTS_S) as scope:
            await workers.run("store", pytest.fail, "this must not run")
        assert scope.cancelled_caught and lasting.ended <= 1
        lasting.done.set()


async def test_who_is_cancelled_before_it_waits_has_nothing_done(worlds: Worlds) -> None:
    with trio.CancelScope() as scope:
        scope.cancel()
        await worlds.node(0).workers.run("store", pytest.fail, "this must not run")
    assert scope.cancelled_caught


async def test_a_call_that_has_begun_is_waited_for(worlds: Worlds) -> None:
    """Its caller learns how it ended, cancelled or not: what it changed is changed."""
    workers = worlds.node(0).workers
    lasting, results = worlds.lasting(0, LASTS_S), []
    begin = trio.current_time()

    async def ask() -> None:
        results.append(await workers.run("store", lasting.work))

    async with trio.open_nursery() as nursery:
        nursery.start_soon(ask)
        await lasting.begun.wait()
        nursery.cancel_scope.cancel()
    assert (lasting.ended, results) == (1, ["worked"])
    assert trio.current_time() - begin >= LASTS_S * AT_LEAST
