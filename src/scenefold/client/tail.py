"""How long answers take that take long: nineteen of twenty came sooner (specs/20-copies.md, Reads). Pure.

Whoever asks somebody else as soon as one is slower than that doubles one request in twenty, and no longer waits for a slow disk.
"""

from __future__ import annotations

from collections import deque

KEPT = 128
LEAST = 16
"""Before so many answers nothing is known of them."""


class Tail:
    """Of the latest answers. Until there are enough of them it is `unknown_s`; never below `least_s`, nor above `most_s`."""

    def __init__(self, *, unknown_s: float, least_s: float, most_s: float) -> None:
        self._unknown_s, self._least_s, self._most_s = unknown_s, least_s, most_s
        self._seconds: deque[float] = deque(maxlen=KEPT)
        self._limit_s = unknown_s

    def note(self, seconds: float) -> None:
        """An answer took so long."""
        self._seconds.append(seconds)
        if len(self._seconds) >= LEAST:
            slow = sorted(self._seconds)[len(self._seconds) * 19 // 20]
            self._limit_s = min(max(slow, self._least_s), self._most_s)

    @property
    def limit_s(self) -> float:
        """After so long it is worth asking somebody else as well."""
        return self._limit_s
