"""If this fails, a walk over a scene hides why it ended, goes on after that, or holds more than a few batches."""

from __future__ import annotations

import pytest
import trio
import trio.testing

from scenefold.client.together import worked_off


async def test_all_batches_are_worked_off_by_as_many_as_there_are_and_no_more_are_made_than_fit() -> None:
    made, begun, done = 0, 0, list[int]()
    all_work = trio.Event()

    async def source(send: trio.MemorySendChannel[int]) -> None:
        nonlocal made
        for made in range(1, 21):
            await send.send(made)

    async def work(batch: int) -> None:
        nonlocal begun
        begun += 1
        if begun == 3:
            await trio.testing.wait_all_tasks_blocked()
            assert made == 3 + 2 + 1, "with the workers, waiting, and in the hand of who makes them"
            all_work.set()
        await all_work.wait()
        done.append(batch)

    with trio.fail_after(5.0):
        await worked_off(source, work, workers=3, ahead=2)
    assert sorted(done) == list(range(1, 21))


@pytest.mark.parametrize("workers", [1, 4])
@pytest.mark.parametrize("ahead", [0, 1])
async def test_the_error_of_a_worker_is_told_and_not_that_nobody_takes_its_batches(workers: int, ahead: int) -> None:
    async def source(send: trio.MemorySendChannel[int]) -> None:
        for number in range(100):
            await send.send(number)

    async def work(batch: int) -> None:
        await trio.lowlevel.checkpoint()
        raise OSError("the disk is full")

    for _ in range(40):  # Trio shuffles who runs first
        with pytest.raises(OSError, match="the disk is full"):
            await worked_off(source, work, workers=workers, ahead=ahead)


async def test_the_error_of_the_source_ends_the_workers() -> None:
    async def source(send: trio.MemorySendChannel[int]) -> None:
        await send.send(1)
        raise LookupError("no more")

    async def work(batch: int) -> None:
        await trio.sleep_forever()

    with trio.fail_after(5.0), pytest.raises(LookupError):
        await worked_off(source, work, workers=2)
