"""Whose turn it is to have the next change of a scene decided here (specs/16-scene-log.md, Deciding). Pure but for the waiting.

Each change follows one certain header, so of several authors who ask at once one gets in, and all others make theirs anew. Told so all at once
they would all come back at once, and the same ones might lose each time. So they stand in line by their request ids: the first one alone is
answered, and as long as it makes its change anew, nobody else's goes in.
"""

from __future__ import annotations

from collections import OrderedDict

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.waiters import Waiters
from scenefold.world import Clock

WAITING_MAX = 64
"""Authors in the line of a scene: beyond that, 13."""
TURN_S_MAX = 2.0
"""So long one waits here: then it is told where the log is, keeps its place, and asks again. Before that it would ask another participant."""
BACK_S_MIN, BACK_S_MAX = 0.25, 2.0
"""Bounds of the time for which the place of one who was told is kept: four times as long as it took the others lately."""
_SMOOTHING = 0.25
_LOOK_S = 0.001


class Line:
    """Requests in the order in which they came first. `now` never falls."""

    def __init__(self) -> None:
        self._left_at: OrderedDict[bytes, float | None] = OrderedDict()
        """When somebody left to make its change anew; None: it is here."""
        self._back_s = BACK_S_MAX / 4

    def __len__(self) -> int:
        return len(self._left_at)

    @property
    def kept_s(self) -> float:
        """For so long a place is kept."""
        return min(BACK_S_MAX, max(BACK_S_MIN, 4 * self._back_s))

    def is_here(self, request: bytes) -> bool:
        """Whether it waits, or has its turn."""
        return self._left_at.get(request, 0.0) is None

    def enter(self, request: bytes, now: float) -> bool:
        """At the place that was kept, or behind all others; False if there is no room."""
        self._forget(now)
        left_at = self._left_at.get(request)
        if left_at is not None:
            self._back_s += _SMOOTHING * (now - left_at - self._back_s)
        elif len(self._left_at) >= WAITING_MAX:
            return False
        self._left_at[request] = None
        return True

    def is_first(self, request: bytes, now: float) -> bool:
        """Whether nobody is before it."""
        self._forget(now)
        return next(iter(self._left_at), None) == request

    def leave(self, request: bytes, now: float, *, comes_back: bool) -> None:
        """It is answered."""
        if comes_back:
            self._left_at[request] = now
        else:
            self._left_at.pop(request, None)

    def next_s(self, now: float) -> float:
        """After so long the first place is free if nobody comes back to it."""
        left_at = next(iter(self._left_at.values()), None)
        return self.kept_s if left_at is None else max(0.0, left_at + self.kept_s - now)

    def _forget(self, now: float) -> None:
        for request, left_at in list(self._left_at.items()):
            if left_at is not None and now - left_at >= self.kept_s:
                del self._left_at[request]


class Turns:
    """Of one scene. Used from the Trio thread only."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._line = Line()
        self._news = Waiters()

    def __len__(self) -> int:
        """How many have a place."""
        return len(self._line)

    def enter(self, request: bytes) -> bool:
        """Take a place, to be left again; False if this one is here already, and goes on as it can. Refused (13) if there is no room."""
        if self._line.is_here(request):
            return False
        if not self._line.enter(request, self._clock.now()):
            raise Refused(RejectReason.BUSY, f"{WAITING_MAX} others want to change the scene, too", remedy="try again in a while")
        return True

    async def comes(self, request: bytes) -> bool:
        """Wait for its turn, TURN_S_MAX at most; whether it has come."""
        until = self._clock.now() + TURN_S_MAX
        while not self._line.is_first(request, now := self._clock.now()):
            if now >= until:
                return False
            # Somebody may not come back, and nobody tells of that.
            with trio.move_on_after(min(until - now, max(self._line.next_s(now), _LOOK_S))):
                await self._news.until(lambda: self._line.is_first(request, self._clock.now()))
        return True

    def leave(self, request: bytes, *, comes_back: bool) -> None:
        """It is answered. `comes_back`: it is told to make its change anew, and its place is kept meanwhile."""
        self._line.leave(request, self._clock.now(), comes_back=comes_back)
        self._news.tell()
