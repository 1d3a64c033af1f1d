"""Writers pass here, so that a piece of the line can be held still for a moment before it is let go.

Freezing keeps new writers of the piece out and waits for those inside. A writer that was cancelled inside may have left
its record in the store's queue: whoever freezes flushes that queue afterwards (`Keeper.flush`). In memory only: a
crash thaws everything, and nothing had been released.

Before that, a piece is *watched*: who gives it learns which places writers may have touched since, so that its last copy,
while writers wait, need not look at everything else again.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager

import trio

from scenefold.base.location import Arc, Location

TOUCHED_MAX = 1024
"""Places remembered of a watched piece; beyond it, all of the piece is looked at."""


class Touched:
    """Where in a piece writers may have written. `outer`: the end of the arc that lies in the piece.

    Who writes to a place of the store's choice passes for both ends of the arc, and may have touched anything.
    """

    def __init__(self, piece: Arc, outer: Location) -> None:
        self._piece = piece
        self._outer = outer
        self._places: set[Location] = set()
        self._anything = False

    def add(self, locations: Sequence[Location]) -> None:
        self._places.update(location for location in locations if location in self._piece)
        if self._outer in self._places or len(self._places) > TOUCHED_MAX:
            self._anything = True
            self._places.clear()

    @property
    def pieces(self) -> list[Arc]:
        """What to look at: ascending, apart from each other."""
        return [self._piece] if self._anything else [Arc(place, place) for place in sorted(self._places)]


class Gate:
    """Used from the Trio thread only; what lies between two awaits is atomic."""

    def __init__(self) -> None:
        self._frozen: list[Arc] = []
        self._inside: list[tuple[Arc, Sequence[Location]]] = []
        self._watching: list[Touched] = []
        self._changed = trio.Event()

    @asynccontextmanager
    async def writing(self, locations: Sequence[Location]) -> AsyncIterator[None]:
        """Be a writer of these places; waits as long as one of them is frozen. The caller sets its own time limit."""
        if not locations:
            yield
            return
        while any(location in piece for piece in self._frozen for location in locations):
            await self._changed.wait()
        inside = Arc(min(locations), max(locations)), list(locations)
        self._inside.append(inside)
        for touched in self._watching:
            touched.add(locations)
        try:
            yield
        finally:
            self._inside.remove(inside)
            self._announce()

    @contextmanager
    def watched(self, piece: Arc, outer: Location) -> Iterator[Touched]:
        """Which places of the piece are touched from now on, those of writers that are inside already included.

        What a writer left in the store's queue is not: flush that before looking at the piece for the last time but one.
        """
        touched = Touched(piece, outer)
        for _, locations in self._inside:
            touched.add(locations)
        self._watching.append(touched)
        try:
            yield touched
        finally:
            self._watching.remove(touched)

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
        while any(span.intersection(piece) is not None for span, _ in self._inside):
            await self._changed.wait()

    def _announce(self) -> None:
        self._changed.set()
        self._changed = trio.Event()
