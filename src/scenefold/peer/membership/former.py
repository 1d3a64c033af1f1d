"""What those claimed who are no members any more: until their leases are over, they may still speak for it. Pure."""

from __future__ import annotations

from scenefold.base.location import Arc
from scenefold.peer.timing import T_WAIT_S


class FormerArcs:
    """Each is forgotten T_wait after this node learnt of the removal."""

    def __init__(self) -> None:
        self._until: list[tuple[float, Arc]] = []

    def add(self, arc: Arc | None, now: float) -> None:
        """A member is gone, whose newest word was that it owns this."""
        if arc is not None:
            self._until = [*self._known(now), (now + T_WAIT_S, arc)]

    def at(self, now: float) -> list[Arc]:
        """What may still be spoken for."""
        return [arc for _, arc in self._known(now)]

    def _known(self, now: float) -> list[tuple[float, Arc]]:
        return [(until, arc) for until, arc in self._until if now < until]
