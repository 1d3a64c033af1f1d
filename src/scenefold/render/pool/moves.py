"""When the cells of a job move, and where to (specs/29-moving-cells.md, Rounds). Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition
from scenefold.partition.damping import decayed
from scenefold.partition.families import Family
from scenefold.partition.rules import Measured, Rule
from scenefold.partition.running_sample import FIRST_RAYS, rays_of_round
from scenefold.render.arrays import F32, F64

ROUND_RAYS_MAX = 1 << 22
DAMPING_HALF_RAYS = 1 << 22
"""Rays after which what is left of free algorithms' moves has halved."""


class Told(NamedTuple):
    """By one node, of all that it has done so far."""

    casts: int
    busy_seconds: float
    hits: F32
    """[n, 3], a sample."""


class Moves:
    """Of one attempt of a job. `partition` is the newest one."""

    def __init__(
        self, rule: Rule, partition: Partition, box: F64, geometry: F64, first_rays: int = FIRST_RAYS, before: Sequence[Told] = ()
    ) -> None:
        """box f64[2, 3]: the scene's; geometry f64[m, 2, 3]: boxes of what nodes hold. `before`: what all had told when the partition was made."""
        self.partition = partition
        self._rule, self._box, self._geometry, self._first_rays = rule, box, geometry, first_rays
        self._rounds = 0
        self._casts = sum(one.casts for one in before)
        self._busy = np.array([one.busy_seconds for one in before]) if before else np.zeros(partition.nodes)

    def is_due(self, told: Sequence[Told]) -> bool:
        """Whether the round is over."""
        return sum(one.casts for one in told) - self._casts >= rays_of_round(self._rounds, ROUND_RAYS_MAX, self._first_rays)

    def idle_share(self, told: Sequence[Told]) -> float:
        """Of the time since the last move, what an average node waited for the busiest one: so much of the rest better cells could save."""
        loads = np.maximum(np.array([one.busy_seconds for one in told]) - self._busy, 0.0)
        return float(1.0 - loads.mean() / loads.max()) if loads.any() else 0.0

    def next(self, told: Sequence[Told]) -> Partition:
        """What the rule says after a round, in the next epoch; the partition itself if nothing is to move. LocalFault if it is for other nodes."""
        casts, busy = sum(one.casts for one in told), np.array([one.busy_seconds for one in told])
        measured = Measured(np.maximum(busy - self._busy, 0.0), *_weighted(told), self._box, self._geometry)
        # Those that go by loads alone never rest by themselves.
        damping = decayed(0.0, casts, DAMPING_HALF_RAYS) if self.partition.family == Family.VORONOI else 0.0
        self._rounds, self._casts, self._busy = self._rounds + 1, casts, busy
        after = self._rule(self.partition, measured, damping)
        if after.nodes != self.partition.nodes:
            raise LocalFault(f"the rule made cells for {after.nodes} nodes, of {self.partition.nodes}")
        is_same = (after.family, after.values) == (self.partition.family, self.partition.values)
        return self.partition if is_same else after.with_epoch(self.partition.epoch + 1)


def _weighted(told: Sequence[Told]) -> tuple[F64, F64]:
    """All hits, f64[n, 3], and what each stands for in seconds of its node."""
    hits = np.concatenate([one.hits for one in told]).astype(np.float64)
    weights = np.concatenate([np.full(len(one.hits), one.busy_seconds / max(1, len(one.hits))) for one in told])
    return hits, weights
