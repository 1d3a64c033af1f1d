"""Several calls at once, with the error of the first that fails; and batches that some make and others work off.

Trio gathers the errors of a nursery into a group. Who puts a thousand records wants to hear that the disk is
full, not a group of eight times the same; so the first error cancels the others and is raised as it is.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import TypeVar

import trio

from scenefold.base.limits import CLIENT_IMPORT_BATCHES

Batch = TypeVar("Batch")


async def together(calls: Iterable[Callable[[], Awaitable[None]]]) -> None:
    """Run all calls concurrently and wait for them."""
    calls = list(calls)
    if len(calls) == 1:
        # What is most often asked for needs no task of its own.
        await calls[0]()
        return
    errors: list[Exception] = []

    async with trio.open_nursery() as nursery:

        async def guarded(call: Callable[[], Awaitable[None]]) -> None:
            try:
                await call()
            except Exception as error:  # noqa: BLE001 - whatever it is, it is raised below
                errors.append(error)
                nursery.cancel_scope.cancel()

        for call in calls:
            nursery.start_soon(guarded, call)
    if errors:
        raise errors[0]


async def worked_off(
    source: Callable[[trio.MemorySendChannel[Batch]], Awaitable[None]],
    work: Callable[[Batch], Awaitable[None]],
    *,
    workers: int = CLIENT_IMPORT_BATCHES,
    ahead: int = 0,
) -> None:
    """Have `source` send batches until it returns, and so many workers take one after the other. `ahead`: how many may wait beside theirs."""
    send, receive = trio.open_memory_channel[Batch](ahead)

    async def make() -> None:
        with send:
            await source(send)

    async def take(mine: trio.MemoryReceiveChannel[Batch]) -> None:
        # Closed without a checkpoint: else the source hears that nobody takes its batches before anybody hears why.
        with mine:
            async for batch in mine:
                await work(batch)

    takers = [partial(take, receive.clone()) for _ in range(workers)]
    receive.close()
    await together([make, *takers])
