"""From a verb into Trio and out again: signals end the work in order, whatever it is doing.

SIGINT, SIGTERM and SIGHUP (the terminal was closed) cancel the command's own scope instead of raising
KeyboardInterrupt at some arbitrary line, so every `finally` runs and nothing is left half done. A second SIGINT
ends the process at once, for work in a thread that cannot be asked to stop.
"""

from __future__ import annotations

import gc
import signal
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from scenectl.errors import INTERRUPTED, Interrupted, most_telling
from scenectl.passphrases import PassphraseNeeded, ask_person, known_passphrase

if TYPE_CHECKING:
    from scenefold.client import Cluster

Result = TypeVar("Result")


def run(function: Callable[..., Awaitable[Result]], *args: Any) -> Result:
    """Run an async call to its end and return what it returns; `Interrupted` after a signal."""
    import trio

    async def guarded() -> Result:
        received: list[int] = []

        async def watch(scope: trio.CancelScope, *, task_status: trio.TaskStatus[None]) -> None:
            with trio.open_signal_receiver(*_ending_signals()) as signals:
                task_status.started()
                async for number in signals:
                    if received:
                        _leave_now()
                    received.append(number)
                    scope.cancel()

        async with trio.open_nursery() as nursery:
            with trio.CancelScope() as scope:
                await nursery.start(watch, scope)
                result = await function(*args)
            nursery.cancel_scope.cancel()
        if scope.cancelled_caught:
            raise Interrupted(received[0])
        return result

    while True:
        try:
            return trio.run(guarded)
        except BaseException as error:
            needed = most_telling(error)
            if not isinstance(needed, PassphraseNeeded):
                raise
        # Nothing was sent yet: the keys are read before anything else.
        ask_person(needed)


def _ending_signals() -> list[signal.Signals]:
    # Under nohup SIGHUP is ignored, and shall stay so.
    hung_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hung_up]


def _leave_now() -> None:
    import os

    os._exit(INTERRUPTED)


@asynccontextmanager
async def connected(profile: str | None) -> AsyncIterator[Cluster]:
    """The cluster of a profile, its user's keys opened with a passphrase if they are locked."""
    from scenefold.client import connect

    async with connect(profile, known_passphrase) as cluster:
        # What is imported stays. To look through it again and again takes a tenth of a second each time, in which no node is heard.
        gc.freeze()
        yield cluster


def serve(function: Callable[..., Awaitable[None]], *args: Any) -> None:
    """Run what goes on until it is told to stop. SIGTERM is the usual end of a service, Ctrl-C an interruption."""
    try:
        run(function, *args)
    except Interrupted as end:
        if end.signal_number != signal.SIGTERM:
            raise
