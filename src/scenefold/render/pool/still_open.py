"""Which passes are not closed yet, as far as a node knows: its own, and by what it is told those of others. Pure."""

from __future__ import annotations

from collections.abc import Collection

from scenefold.render.passes import PassPlan
from scenefold.render.pool.own_passes import pass_owner


class StillOpen:
    """In one attempt of a job."""

    def __init__(self, plan: PassPlan, nodes: int, done: Collection[int]) -> None:
        """`done`: passes that are traced no more."""
        self._plan, self._nodes = plan, nodes
        self._is_closed = bytearray(plan.count)
        for number in done:
            self._is_closed[number] = True
        self._until = 0

    def skip(self, first: int) -> None:
        """Passes below this number were closed before."""
        self._is_closed[:first] = b"\x01" * first

    def release(self, until: int) -> list[int]:
        """Passes below this number may be opened. By their owners: how many paths those have that are not closed, and could not be opened before."""
        left = [0] * self._nodes
        for number in range(self._until, until):
            if not self._is_closed[number]:
                left[pass_owner(self._plan, number, self._nodes)] += self._plan.size(number)
        self._until = max(self._until, until)
        return left

    def close(self, number: int) -> int:
        """A pass is closed: how many of the released paths are not open any more. Once for each pass."""
        if self._is_closed[number]:
            return 0
        self._is_closed[number] = True
        return self._plan.size(number) if number < self._until else 0
