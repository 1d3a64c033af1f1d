"""Several calls at once, with the error of the first that fails.

Trio gathers the errors of a nursery into a group. Who puts a thousand records wants to hear that the disk is
full, not a group of eight times the same; so the first error cancels the others and is raised as it is.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable

import trio


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
