"""What waits to be sent to one other node of a job: rays by pass, the counts of passes, and which are closed. Pure.

Rays linger for a moment, or until there are enough for a large frame, or until their node has nothing else to do
(`hurry`): a frame costs what a thousand rays cost to trace, however small it is. While a frame is on its way, or
waits for credit, rays that come after it are gathered too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from scenefold.base.rays import RAY_BYTES
from scenefold.render.arrays import U32
from scenefold.render.ledger import Counts

FRAME_RAYS_MAX = 16_384
"""576 KiB of rays in a frame."""
FRAME_RAYS_ENOUGH = 4_096
"""So many waiting rays leave at once."""
LINGER_S = 0.02
SMALL_BYTES = 256
"""What a packet without rays counts as."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays of one pass, u32[n, RAY_WORDS], addressed by the partition of an epoch."""

    epoch: int
    number: int
    rays: U32

    @property
    def size(self) -> int:
        """Bytes, about."""
        return SMALL_BYTES + RAY_BYTES * len(self.rays)


@dataclass(frozen=True, slots=True)
class Told:
    """Counts of a pass for its owner; or none, from its owner: it is closed."""

    number: int
    counts: Counts | None
    size: int = SMALL_BYTES


class PeerOutbox:
    """Bounded like the job's rays are (`WorkQueue`), and by counts of the passes that are open."""

    def __init__(self) -> None:
        self._rays: dict[tuple[int, int], list[U32]] = {}
        """By the epoch by which they are addressed, and pass."""
        self._counts: dict[int, Counts] = {}
        self._closed: deque[int] = deque()
        self._waiting = 0
        self._since: float | None = None
        self._is_ripe = False
        self._hurries = False

    def put_rays(self, epoch: int, number: int, rays: U32, now: float) -> None:
        """Queue rays of a pass that are addressed by the partition of this epoch."""
        self._rays.setdefault((epoch, number), []).append(rays)
        self._waiting += len(rays)
        self._hurries = self._hurries or self._waiting >= FRAME_RAYS_ENOUGH
        self._begin(now)

    def put_counts(self, number: int, counts: Counts, now: float) -> None:
        """Queue counts of a pass, in place of those that still wait."""
        self._counts[number] = counts
        self._begin(now)

    def put_closed(self, number: int, now: float) -> None:
        """Queue the word that a pass is closed."""
        self._closed.append(number)
        self._begin(now)

    def hurry(self) -> None:
        """Whoever fills this box has nothing else to do: send what there is."""
        self._hurries = True

    def ripe_at(self) -> float | None:
        """From when on something leaves; None as long as nothing waits."""
        if self._since is None:
            return None
        return self._since if self._is_ripe or self._hurries else self._since + LINGER_S

    def next(self) -> Rays | Told | None:
        """What leaves next, all that is ripe being taken one by one; None if nothing is left. Small ones go before rays."""
        self._is_ripe, self._hurries = True, False
        if self._closed:
            return Told(self._closed.popleft(), None)
        if self._counts:
            number = next(iter(self._counts))
            return Told(number, self._counts.pop(number))
        if self._rays:
            return self._next_rays()
        self._since, self._is_ripe = None, False
        return None

    def _next_rays(self) -> Rays:
        epoch, number = due = min(self._rays)
        batches = self._rays.pop(due)
        rays = batches[0] if len(batches) == 1 else np.concatenate(batches)
        if len(rays) > FRAME_RAYS_MAX:
            self._rays[due] = [rays[FRAME_RAYS_MAX:]]
            rays = rays[:FRAME_RAYS_MAX]
        self._waiting -= len(rays)
        return Rays(epoch, number, rays)

    def _begin(self, now: float) -> None:
        if self._since is None:
            self._since = now
