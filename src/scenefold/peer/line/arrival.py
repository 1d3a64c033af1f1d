"""Whether this process may act on what its disk says of others' places (specs/22-purge.md, Arrival).

What lies here may be older than something that was purged while nobody could ask this node. So it shows and takes nothing before the
voter has said that its disk is no older one, and, where its incarnation has begun nothing yet, before it knows all scenes' headers.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason


class Arrival:
    """Used from the Trio thread only. Done from the start, unless somebody says that it has to be waited for."""

    def __init__(self) -> None:
        self.is_done = True
        self._news = trio.Event()
        self.before: list[Callable[[], Awaitable[None]]] = []
        """What is done before anybody else acts, in every process; so each of these may find it done. What they refuse is tried again."""

    def begin(self) -> None:
        """There is something to be waited for."""
        self.is_done = False

    def end(self) -> None:
        self.is_done = True
        self._news.set()

    async def done(self) -> None:
        if not self.is_done:
            await self._news.wait()

    async def then(self, run: Callable[[], Awaitable[None]]) -> None:
        """What brings to others what lies here runs only then: this disk may be older than theirs, and they have forgotten what was purged."""
        await self.done()
        await run()

    def require(self) -> None:
        """Refused (16) before that."""
        if not self.is_done:
            raise Refused(RejectReason.NOT_READY, "this node has just started, and does not know yet what of its disk counts")
