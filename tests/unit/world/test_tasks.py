"""If this failed, users of our context managers would get groups of exceptions instead of their own."""

from __future__ import annotations

import pytest
import trio

from scenefold.world import background_tasks


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
