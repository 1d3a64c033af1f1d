"""Writers pass here, so that a piece of the line can be held still for a moment before it is let go.

Freezing keeps new writers of the piece out and waits for those inside. A writer that was cancelled inside may have left
its record in the store's queue: whoever freezes flushes that queue afterwards (`Keeper.flush`). In memory only: a
crash thaws everything, and nothing had been released.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

import trio

from scenefold.base.location import Arc, Location


class Gate:
    """Used from the Trio thread only; what lies between two awaits is atomic."""

    def __init__(self) -> None:
        self._frozen: list[Arc] = []
        self._inside: list[Arc] = []
        self._changed = trio.Event()

    @asynccontextmanager
    async def writing(self, locations: Sequence[Location]) -> AsyncIterator[None]:
        """Be a writer of these places; waits as long as one of them is frozen. The caller sets its own time limit."""
        if not locations:
            yield
            return
        while any(location in piece for piece in self._frozen for location in locations):
            await self._changed.wait()
        span = Arc(min(locations), max(locations))
        self._inside.append(span)
        try:
            yield
        finally:
            self._inside.remove(span)
            self._announce()

    @asynccontextmanager
    async def frozen(self, piece: Arc) -> AsyncIterator[None]:
        """Keep new writers out of the piece. `drained` waits for the ones inside."""
        self._frozen.append(piece)
        try:
            yield
        finally:
            self._frozen.remove(piece)
            self._announce()

    async def drained(self, piece: Arc) -> None:
        """Return once no writer is inside that may write to the piece."""
        while any(span.intersection(piece) is not None for span in self._inside):
            await self._changed.wait()

    def _announce(self) -> None:
        self._changed.set()
        self._changed = trio.Event()
