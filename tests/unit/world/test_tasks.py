"""If this failed, users of our context managers would get groups of exceptions instead of their own, or somebody would wait for ever."""

from __future__ import annotations

import pytest
import trio
import trio.testing

from scenefold.world import background_tasks, first_of


async def test_the_body_s_own_error_comes_out() -> None:
    async def use() -> None:
        async with background_tasks() as nursery:
            nursery.start_soon(trio.sleep_forever)
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        await use()


async def test_a_task_s_error_ends_the_body() -> None:
    async def fail() -> None:
        raise ValueError("task")

    async def use() -> None:
        async with background_tasks() as nursery:
            nursery.start_soon(fail)
            await trio.sleep_forever()

    with pytest.raises(ValueError, match="task"):
        await use()


async def test_cancelling_from_outside_stays_cancelling() -> None:
    with trio.CancelScope() as scope:
        async with background_tasks() as nursery:
            nursery.start_soon(trio.sleep_forever)
            scope.cancel()
            await trio.sleep_forever()
    assert scope.cancelled_caught


async def test_two_errors_stay_a_group() -> None:
    async def fail() -> None:
        raise ValueError("task")

    async def use() -> None:
        async with background_tasks() as nursery:
            nursery.start_soon(fail)
            try:
                await trio.sleep_forever()
            finally:
                raise KeyError("mine")

    with pytest.raises(ExceptionGroup) as caught:
        await use()
    assert len(caught.value.exceptions) == 2


async def test_the_first_wait_that_ends_ends_all() -> None:
    one, other = trio.Event(), trio.Event()
    cancelled: list[str] = []

    async def never() -> None:
        try:
            await trio.sleep_forever()
        except trio.Cancelled:
            cancelled.append("never")
            raise

    async with trio.open_nursery() as nursery:
        nursery.start_soon(first_of, one.wait, other.wait, never)
        await trio.testing.wait_all_tasks_blocked()
        other.set()
    assert cancelled == ["never"]
    assert not one.is_set()


async def test_an_error_in_a_wait_comes_out_as_it_is() -> None:
    async def fail() -> None:
        raise ValueError("wait")

    with pytest.raises(ValueError, match="wait"):
        await first_of(trio.sleep_forever, fail)
