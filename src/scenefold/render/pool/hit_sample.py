"""Where rays hit on one node, as a sample of bounded size (specs/29-moving-cells.md, What is measured). Pure."""

from __future__ import annotations

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.partition.running_sample import EMPTY, extended
from scenefold.render.arrays import F32
from scenefold.render.job import Job

KEPT_OF_ALL = 4096
KEPT_LEAST = 32
KEPT_OF_POOL = 512
"""Of a node of a small pool among many."""
COORDINATE_MAX = 1e30


def kept_of(nodes: int, pool: int | None = None) -> int:
    """Of one node among so many, of which so many are in its pool: cells of a small pool follow what these few tell."""
    of_all = max(KEPT_LEAST, KEPT_OF_ALL // nodes)
    return of_all if pool is None else max(of_all, min(KEPT_OF_POOL, KEPT_OF_ALL // pool))


def kept_in(job: Job) -> int:
    """Of each node of a job."""
    return kept_of(len(job.nodes), min(one.nodes for one in job.division.pools) if job.others else None)


class HitSample:
    """Of all hits so far."""

    def __init__(self, kept: int, seed: int) -> None:
        self._kept, self._seed = kept, seed
        self._sample = EMPTY
        self._turn = 0
        self.count = 0
        """Hits that it is a sample of."""

    def add(self, places: F32, count: int) -> None:
        """[n, 3], a fair sample of so many hits. What is no number is left out."""
        self.count += count
        sound = places[np.isfinite(places).all(axis=1)]
        if len(sound):
            self._turn += 1
            self._sample = extended(self._sample, sound, hash((self._seed, self._turn)) & 0xFFFFFFFF, self._kept)

    def to_bytes(self) -> bytes:
        """f32 × 3 of each."""
        return self._sample.points.astype("<f4").tobytes()


def hits_of_bytes(payload: object, kept: int) -> F32:
    """What `to_bytes` gave of so many at most, f32[n, 3]; PeerFault for anything else."""
    if not isinstance(payload, bytes) or len(payload) % 12 or len(payload) > 12 * kept:
        raise PeerFault("a sample of hits is ill-formed")
    hits = np.frombuffer(payload, "<f4").reshape(-1, 3).astype(np.float32)
    if not (np.abs(hits) < COORDINATE_MAX).all():
        raise PeerFault("a hit lies nowhere")
    return hits
