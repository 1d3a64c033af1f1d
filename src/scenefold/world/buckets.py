"""How often somebody may do something: a bucket for each, which fills by itself (specs/03-wire.md, Limits). Pure.

Who is not remembered has a full one. Of many, the one that was idle for longest is forgotten first: an attacker with that many
names gains no more than a full bucket for each.
"""

from __future__ import annotations

from collections import OrderedDict

KEYS_MAX = 4_096


class Buckets:
    """`burst`: what a full bucket holds. `per_s`: what comes back in a second."""

    def __init__(self, burst: int, per_s: float) -> None:
        assert burst >= 1 and per_s > 0
        self._burst = burst
        self._per_s = per_s
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, key: str, now: float, count: int = 1) -> bool:
        """Take so many; False, and nothing is taken, if there are fewer."""
        left = self._content(key, now)
        self._remember(key, left - count if left >= count else left, now)
        return left >= count

    def has(self, key: str, now: float) -> bool:
        """Whether there is one to take."""
        left, at = self._left.get(key, (self._burst, now))
        return left + (now - at) * self._per_s >= 1

    def give_back(self, key: str, now: float) -> None:
        """It was nothing that counts."""
        self._remember(key, min(self._burst, self._content(key, now) + 1), now)

    def _content(self, key: str, now: float) -> float:
        left, at = self._left.pop(key, (self._burst, now))
        return min(self._burst, left + (now - at) * self._per_s)

    def _remember(self, key: str, left: float, now: float) -> None:
        self._left[key] = (left, now)
        if len(self._left) > KEYS_MAX:
            self._left.popitem(last=False)
