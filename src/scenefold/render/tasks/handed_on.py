"""What is made, on its way to who writes it: some of it at a time, so that neither waits long for the other, and no more lies in memory."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class HandedOn(Generic[T]):
    """From any threads to one. Thread safe."""

    def __init__(self, room: int, write: Callable[[T], None]) -> None:
        """`room`: bytes that wait at most, but one in any case; who has made more waits with it."""
        self.last_at: float | None = None
        """When the last one was made, by the clock of `time.monotonic`."""
        self._room, self._write = room, write
        self._waiting: deque[tuple[T, int]] = deque()
        self._is_over = False
        self._changed = threading.Condition()

    def give(self, made: T, size: int) -> None:
        """Hand one of so many bytes on. If writing has failed nobody wants it, and it is dropped."""
        with self._changed:
            self.last_at = time.monotonic()
            self._changed.wait_for(lambda: self._has_room(size) or self._is_over)
            if not self._is_over:
                self._waiting.append((made, size))
                self._changed.notify_all()

    def end(self) -> None:
        """No more will be given; what is there is still written."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def write_all(self) -> None:
        """Write what is given, one after the other, until the end; the errors of `write`."""
        try:
            while self._is_one_there():
                self._write(self._waiting[0][0])
                with self._changed:
                    self._waiting.popleft()
                    self._changed.notify_all()
        finally:
            self.end()

    def _has_room(self, size: int) -> bool:
        return not self._waiting or sum(waiting for _, waiting in self._waiting) + size <= self._room

    def _is_one_there(self) -> bool:
        with self._changed:
            self._changed.wait_for(lambda: bool(self._waiting) or self._is_over)
            return bool(self._waiting)
