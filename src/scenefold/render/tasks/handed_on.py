"""What is made, on its way to who writes it: a few at a time, so that neither waits long for the other, and no more lie in memory."""

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
        """`room`: so many wait at most; who has made one more waits with it."""
        self.last_at: float | None = None
        """When the last one was made, by the clock of `time.monotonic`."""
        self._room, self._write = room, write
        self._waiting: deque[T] = deque()
        self._is_over = False
        self._changed = threading.Condition()

    def give(self, made: T) -> None:
        """Hand one on. If writing has failed nobody wants it, and it is dropped."""
        with self._changed:
            self.last_at = time.monotonic()
            self._changed.wait_for(lambda: len(self._waiting) < self._room or self._is_over)
            if not self._is_over:
                self._waiting.append(made)
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
                self._write(self._waiting[0])
                with self._changed:
                    self._waiting.popleft()
                    self._changed.notify_all()
        finally:
            self.end()

    def _is_one_there(self) -> bool:
        with self._changed:
            self._changed.wait_for(lambda: bool(self._waiting) or self._is_over)
            return bool(self._waiting)
