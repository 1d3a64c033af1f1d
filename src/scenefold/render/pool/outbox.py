"""What waits to be sent to one other node of a job: rays by pass, the counts of passes, and which are closed. Pure.

All of it leaves together, in one frame: a frame costs what a thousand rays cost to trace, however small it is. So it
lingers for a moment, or until there are enough rays, or until its node has nothing else to do (`hurry`), but even then
for long enough that a few rays do not go to and fro in frames of their own. What nothing will follow leaves at once. While a frame is on its way, or waits for
credit, what comes after it gathers for the next one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import islice

import numpy as np

from scenefold.base.limits import RAY_FRAME_ITEMS_MAX
from scenefold.base.rays import RAY_BYTES
from scenefold.render.arrays import U32
from scenefold.render.ledger import Counts

FRAME_RAYS_MAX = 32_768
"""1,152 KiB of rays in a frame."""
FRAME_RAYS_ENOUGH = 12_288
"""So many waiting rays leave at once."""
LINGER_S = 0.05
HURRIED_S = 0.02
"""From one frame to the next that leaves only because its node has nothing else to do."""
EMPTY_BYTES = 256
"""What a frame counts as, beside its rays,"""
COUNTS_BYTES = 32
"""and the counts of a pass in it."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Rays of one pass, u32[n, RAY_WORDS], addressed by the partition of an epoch."""

    epoch: int
    number: int
    rays: U32


@dataclass(frozen=True, slots=True)
class Frame:
    """What leaves at a time."""

    batches: list[Batch]
    counts: list[tuple[int, Counts]]
    """Of passes, for their owner."""
    closed: list[int]
    """Passes of this node."""

    @property
    def size(self) -> int:
        """Bytes, about."""
        return frame_size(sum(len(batch.rays) for batch in self.batches), len(self.counts))


def frame_size(rays: int, counts: int) -> int:
    """What a frame of so many rays, and so many passes' counts, takes of a link's credit, in bytes."""
    return EMPTY_BYTES + COUNTS_BYTES * counts + RAY_BYTES * rays


class PeerOutbox:
    """Bounded like the job's rays are (`WorkQueue`), and by counts of the passes that are open."""

    def __init__(self) -> None:
        self._rays: dict[tuple[int, int], list[U32]] = {}
        """By the epoch by which they are addressed, and pass."""
        self._counts: dict[int, Counts] = {}
        self._closed: deque[int] = deque()
        self._waiting = 0
        self._since: float | None = None
        self._left_at = -math.inf
        self._is_ripe = False
        self._hurries = False

    def put_rays(self, epoch: int, number: int, rays: U32, now: float, *, are_all: bool = False) -> None:
        """Queue rays of a pass that are addressed by the partition of this epoch. `are_all`: no more of it will follow, so they leave at once."""
        self._rays.setdefault((epoch, number), []).append(rays)
        self._waiting += len(rays)
        self._is_ripe = self._is_ripe or are_all or self._waiting >= FRAME_RAYS_ENOUGH
        self._begin(now)

    def put_counts(self, number: int, counts: Counts, now: float, *, are_last: bool = False) -> None:
        """Queue counts of a pass, in place of those that still wait. `are_last`: as far as is known no more will follow, and the pass may close: they leave at once."""
        self._counts[number] = counts
        self._is_ripe = self._is_ripe or are_last
        self._begin(now)

    def put_closed(self, number: int, now: float) -> None:
        """Queue the word that a pass is closed."""
        self._closed.append(number)
        self._begin(now)

    def hurry(self) -> None:
        """Whoever fills this box has nothing else to do: send what rays there are. That a pass closes a moment later keeps nobody from tracing."""
        self._hurries = self._waiting > 0

    def ripe_at(self) -> float | None:
        """From when on something leaves; None as long as nothing waits."""
        if self._since is None:
            return None
        if self._is_ripe:
            return self._since
        lingered = self._since + LINGER_S
        return min(lingered, max(self._since, self._left_at + HURRIED_S)) if self._hurries else lingered

    def next(self, now: float, rays_max: int = FRAME_RAYS_MAX) -> Frame | None:
        """What leaves now, all that is ripe in one frame, or several if it is too much for one; None if nothing is left. `rays_max`: of the link."""
        if self._since is None:
            return None
        self._is_ripe, self._hurries, self._left_at = True, False, now
        counts = list(islice(self._counts.items(), RAY_FRAME_ITEMS_MAX))
        for number, _ in counts:
            del self._counts[number]
        closed = [self._closed.popleft() for _ in range(min(len(self._closed), RAY_FRAME_ITEMS_MAX))]
        frame = Frame(self._next_batches(min(FRAME_RAYS_MAX, rays_max)), counts, closed)
        if not (self._rays or self._counts or self._closed):
            self._since, self._is_ripe = None, False
        return frame

    def _next_batches(self, most: int) -> list[Batch]:
        """Of old epochs and passes first."""
        batches: list[Batch] = []
        room = most
        for due in sorted(self._rays):
            if not room or len(batches) == RAY_FRAME_ITEMS_MAX:
                break
            arrays = self._rays.pop(due)
            rays = arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
            if len(rays) > room:
                self._rays[due] = [rays[room:]]
                rays = rays[:room]
            room -= len(rays)
            batches.append(Batch(*due, rays))
        self._waiting -= most - room
        return batches

    def _begin(self, now: float) -> None:
        if self._since is None:
            self._since = now
