"""Whose request is taken up next at a port (specs/03-wire.md, Limits). Pure: no waiting.

All requests are handled by one thread, in tasks that run in turns: of a hundred of one peer and one of another, the one has a
hundredth of the time. So a peer beside others begins only a few at a time, the next once one of them has ended. One that takes
long, as it waits for a disk or another node, takes nobody's time: it soon counts no more. A peer that is alone may begin all.
"""

from __future__ import annotations

from collections import OrderedDict
from itertools import islice

TURNS_MAX = 4
"""Requests of a peer beside others that may have begun lately: a full one of reading costs two milliseconds."""
TURN_S = 0.025
"""After which a request counts as waiting for something else."""
BESIDE_S = 1.0
"""Others are beside a peer for so long after their last request."""


class Turns:
    """Of all peers at one port."""

    def __init__(self) -> None:
        self._begun: dict[str, dict[int, float]] = {}
        self._last_at: OrderedDict[str, float] = OrderedDict()
        """Those of the last BESIDE_S and maybe one more, the latest last."""
        self._number = 0

    def wait_s(self, peer: str, now: float) -> float:
        """How long this peer's next request has to wait, unless one of its others ends before; 0: it may begin."""
        begun = self._begun.get(peer)
        if begun is None or len(begun) < TURNS_MAX or not self._is_beside_others(peer, now):
            return 0.0
        # They are in the order of their beginning: if this one counts no more, so many are left at most.
        at = next(islice(reversed(begun.values()), TURNS_MAX - 1, None))
        return max(0.0, at + TURN_S - now)

    def begin(self, peer: str, now: float) -> int:
        """A request is taken up; the number is for `end`."""
        self._number += 1
        self._begun.setdefault(peer, {})[self._number] = now
        self._last_at[peer] = now
        self._last_at.move_to_end(peer)
        while self._last_at[first := next(iter(self._last_at))] < now - BESIDE_S:
            del self._last_at[first]
        return self._number

    def end(self, peer: str, number: int) -> None:
        begun = self._begun[peer]
        del begun[number]
        if not begun:
            del self._begun[peer]

    def _is_beside_others(self, peer: str, now: float) -> bool:
        latest = next((at for other, at in reversed(self._last_at.items()) if other != peer), None)
        return latest is not None and latest >= now - BESIDE_S
