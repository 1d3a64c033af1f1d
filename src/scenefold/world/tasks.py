"""Nurseries that a context manager or a call hides from its user.

Trio gathers what goes wrong in a nursery into a group. A user of `open_store` or `open_links` never saw a nursery, and
expects their own exception back; so a group of one is opened, and the wreckage of the cancellation itself left out.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from typing import TypeVar

import trio

E = TypeVar("E", bound=BaseException)


@asynccontextmanager
async def background_tasks() -> AsyncIterator[trio.Nursery]:
    """A nursery whose tasks are cancelled when the body ends, however it ends."""
    try:
        async with trio.open_nursery() as nursery:
            try:
                yield nursery
            finally:
                nursery.cancel_scope.cancel()
    except BaseExceptionGroup as group:
        causes = [leaf for leaf in leaves(group) if not isinstance(leaf, trio.Cancelled)]
        if len(causes) == 1:
            raise causes[0] from causes[0].__cause__
        raise


async def first_of(*waits: Callable[[], Awaitable[object]]) -> None:
    """Return once one of these returns; the others are cancelled."""
    async with background_tasks() as nursery:
        over = trio.Event()

        async def wait_for(wait: Callable[[], Awaitable[object]]) -> None:
            await wait()
            over.set()

        for wait in waits:
            nursery.start_soon(wait_for, wait)
        await over.wait()


def leaves(group: BaseExceptionGroup[E]) -> Iterator[E]:
    """The errors of a group, and of the groups in it."""
    for error in group.exceptions:
        if isinstance(error, BaseExceptionGroup):
            yield from leaves(error)
        else:
            yield error
