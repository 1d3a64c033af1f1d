"""What one process holds for the tasks that are done in it: a scene for each render, shared by its threads, until the render has ended."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, Protocol, TypeVar

ENDED_MAX = 256
"""Renders that have ended are known for so long, that tasks which come late do not begin."""


class RenderEnded(Exception):
    """Nobody wants what this task would make."""


class Closable(Protocol):
    """What can be held."""

    def close(self) -> None:
        """Free it; nobody uses it any more."""
        ...


H = TypeVar("H", bound=Closable)


class _Place(Generic[H]):
    """Of one render."""

    def __init__(self) -> None:
        self.opening = threading.Lock()
        self.held: H | None = None
        self.users = 0


class Holding(Generic[H]):
    """Of one process; of renders that nobody uses at the moment one at most is held. Thread safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._places: dict[str, _Place[H]] = {}
        self._ended: deque[str] = deque(maxlen=ENDED_MAX)

    @contextmanager
    def borrowed(self, render: str, open_it: Callable[[], H]) -> Iterator[tuple[H, bool]]:
        """What is held for a render, and whether this call has opened it; others wait for that. RenderEnded if it has ended."""
        place = self._entered(render)
        try:
            with place.opening:
                self.check(render)
                is_new = place.held is None
                held = place.held = open_it() if place.held is None else place.held
            yield held, is_new
        finally:
            self._close(self._left(render, place))

    def check(self, render: str) -> None:
        """RenderEnded if it has."""
        if render in self._ended:
            raise RenderEnded(render)

    def end(self, render: str) -> None:
        """No task of this render is wanted: those that are at work notice it soon, and the last one frees what was held."""
        with self._lock:
            if render not in self._ended:
                self._ended.append(render)
            place = self._places.get(render)
            unused = [] if place is None or place.users else [self._places.pop(render)]
        self._close(unused)

    def _entered(self, render: str) -> _Place[H]:
        with self._lock:
            self.check(render)
            place = self._places.setdefault(render, _Place())
            place.users += 1
            # A render whose client is gone never ends: what it has left goes when there is other work.
            unused = [self._places.pop(other) for other, former in [*self._places.items()] if other != render and not former.users]
        self._close(unused)
        return place

    def _left(self, render: str, place: _Place[H]) -> list[_Place[H]]:
        with self._lock:
            place.users -= 1
            if place.users or render not in self._ended:
                return []
            self._places.pop(render, None)
            return [place]

    def _close(self, places: list[_Place[H]]) -> None:
        for place in places:
            if place.held is not None:
                place.held.close()
