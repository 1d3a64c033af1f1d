"""How much is still to be brought to those who hold copies, as far as it is known, and how fast that goes."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass

from scenefold.world import Clock

RATE_S = 10.0
"""Time over which the rate is measured."""


@dataclass(frozen=True, slots=True)
class Left:
    """What is left: pairs of a segment and a holder that is not complete; of those that are worked on, records, and about how many bytes."""

    segments: int
    records: int
    bytes: int
    bytes_per_s: float

    @property
    def seconds(self) -> float | None:
        """Until what is known of is brought over; None if nothing moves."""
        if not self.records:
            return 0.0
        return self.bytes / self.bytes_per_s if self.bytes_per_s else None


class Progress:
    """Used from the Trio thread only. `key`: of one comparison, from `begin` to `end`."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._left: dict[Hashable, int] = {}
        self._sent: deque[tuple[float, int]] = deque()
        self._records = self._bytes = 0
        self.segments = 0

    def begin(self, key: Hashable, records: int) -> None:
        self._left[key] = records

    def sent(self, key: Hashable, records: int, stored_bytes: int) -> None:
        self._left[key] = max(0, self._left.get(key, 0) - records)
        self._records += records
        self._bytes += stored_bytes
        self._sent.append((self._clock.now(), stored_bytes))
        self._forget()

    def end(self, key: Hashable) -> None:
        self._left.pop(key, None)

    def left(self) -> Left:
        self._forget()
        records = sum(self._left.values())
        mean = self._bytes / self._records if self._records else 0.0
        return Left(self.segments, records, round(records * mean), sum(size for _, size in self._sent) / RATE_S)

    def _forget(self) -> None:
        oldest = self._clock.now() - RATE_S
        while self._sent and self._sent[0][0] < oldest:
            self._sent.popleft()
