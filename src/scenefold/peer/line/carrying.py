"""Records that this node has read from its disk and is sending to others (specs/22-purge.md, Marks).

Such a record may be on its way when it lies here no more. Who says that it has nothing else of a place waits until what was on its way
before has arrived, or is given up.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import trio


class Carrying:
    """Used from the Trio thread only."""

    def __init__(self) -> None:
        self._under_way: set[object] = set()
        self._changed = trio.Event()

    @contextmanager
    def begun(self) -> Iterator[None]:
        """From before the records are read until they are answered for."""
        token = object()
        self._under_way.add(token)
        try:
            yield
        finally:
            self._under_way.discard(token)
            self._changed.set()
            self._changed = trio.Event()

    async def ended(self) -> None:
        """Return once all that is under way now has ended."""
        before = set(self._under_way)
        while before & self._under_way:
            await self._changed.wait()
