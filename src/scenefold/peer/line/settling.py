"""What was received a short time ago stays for a while: a record moves at most once in ten seconds (Algorithm 5)."""

from __future__ import annotations

from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.world import Clock

SETTLING_S = 10.0
CLOCK_MARGIN = 1.05
"""Whoever watches has a clock of its own; rates differ by 1 % at most, the rest is for what lies between two packets."""
PIECES_MAX = 64
"""Pieces remembered; beyond it they become one that spans all."""


class Settling:
    """Which pieces of the line came when. Nothing of it survives a restart, so a start counts as receipt of everything."""

    def __init__(self, clock: Clock, seconds: float | None = None) -> None:
        """`seconds`: until what came has settled; None: the usual time."""
        self._clock = clock
        self._seconds = seconds
        self._received: list[tuple[Arc, float]] = [(WHOLE_LINE, clock.now())]

    def note(self, piece: Arc) -> None:
        """This piece, or records in it, have just come."""
        self._forget()
        self._received.append((piece, self._clock.now()))
        if len(self._received) > PIECES_MAX:
            span = Arc(min(arc.first for arc, _ in self._received), max(arc.last for arc, _ in self._received))
            self._received = [(span, self._clock.now())]

    def settles_in_s(self, arc: Arc) -> float:
        """Seconds until everything in the arc has settled; 0 if it has."""
        times = [at for piece, at in self._received if piece.intersection(arc) is not None]
        return max(0.0, max(times) + self._lasting_s() - self._clock.now()) if times else 0.0

    def _forget(self) -> None:
        oldest = self._clock.now() - self._lasting_s()
        self._received = [(arc, at) for arc, at in self._received if at > oldest]

    def _lasting_s(self) -> float:
        return settling_s() if self._seconds is None else self._seconds * CLOCK_MARGIN


def settling_s() -> float:
    """Seconds by this node's own clock."""
    return SETTLING_S * CLOCK_MARGIN
