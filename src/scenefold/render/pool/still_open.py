"""Which passes are not closed yet, as far as a node knows: its own, and by what it is told those of others. Pure."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from scenefold.render.passes import PassPlan
from scenefold.render.pool.own_passes import owners_of


class StillOpen:
    """In one attempt of a job."""

    def __init__(self, plan: PassPlan, nodes: int, done: Collection[int]) -> None:
        """`done`: passes that are traced no more."""
        self._plan, self._nodes = plan, nodes
        self._is_open = np.ones(plan.count, np.bool_)
        self._is_open[np.fromiter(done, np.int64, len(done))] = False
        self._until = 0

    def skip(self, first: int) -> None:
        """Passes below this number were closed before."""
        self._is_open[:first] = False

    def release(self, until: int) -> list[int]:
        """Passes below this number may be opened. By their owners: how many paths those have that are not closed, and could not be opened before."""
        fresh = self._until + np.flatnonzero(self._is_open[self._until : until])
        self._until = max(self._until, until)
        owners = owners_of(self._plan, self._nodes)[fresh]
        return [int(rays) for rays in np.bincount(owners, weights=self._plan.sizes(fresh), minlength=self._nodes)]

    def close(self, number: int) -> int:
        """A pass is closed: how many of the released paths are not open any more. Once for each pass."""
        if not self._is_open[number]:
            return 0
        self._is_open[number] = False
        return self._plan.size(number) if number < self._until else 0
