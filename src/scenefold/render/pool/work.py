"""Rays that wait on a node, by pass: the largest heap goes first. Pure.

Oldest first looks tidier, and is far slower: the few rays that are left of an old pass then go round and round
between the nodes alone. Heaps of old passes are never starved for long, since
new passes open only while few rays wait.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from scenefold.base.rays import RAY_WORDS
from scenefold.render.arrays import U32

TAKE_RAYS_MAX = 65_536
"""Rays handed to a tracer at a time: enough to outweigh the hand-over, few enough to answer within a moment."""
SHARE_RAYS_MIN = 8_192
"""A thread takes so many, if there are, however many others have nothing to do."""


@dataclass(frozen=True, slots=True)
class Work:
    """Rays of one pass, taken to be traced."""

    number: int
    """The pass."""
    rays: U32


class WorkQueue:
    """Not bounded by itself: a job has at most `passes in flight x paths x 2` rays anywhere (specs/08-passes.md)."""

    def __init__(self) -> None:
        self._waiting: dict[int, deque[U32]] = {}
        self._sizes: dict[int, int] = {}
        self._rays = 0
        self._under_way: dict[int, int] = {}

    def __len__(self) -> int:
        """Rays waiting."""
        return self._rays

    def put(self, number: int, rays: U32) -> None:
        """Add rays of a pass."""
        if len(rays):
            self._waiting.setdefault(number, deque()).append(rays)
            self._sizes[number] = self._sizes.get(number, 0) + len(rays)
            self._rays += len(rays)

    def lend(self, number: int) -> None:
        """Rays of a pass are elsewhere, and come back, or leave this node, before `done`."""
        self._under_way[number] = self._under_way.get(number, 0) + 1

    def drain(self) -> list[Work]:
        """All rays that wait, which then wait no more. Their passes are busy until `done`, once for each of these."""
        drained = []
        while (work := self.take()) is not None:
            drained.append(work)
        return drained

    def take_share(self, threads: int) -> list[Work]:
        """One thread's part, where so many have nothing to do."""
        share = -(-self._rays // threads)
        return self.take_some(min(TAKE_RAYS_MAX, max(SHARE_RAYS_MIN, share)))

    def take_some(self, room: int = TAKE_RAYS_MAX) -> list[Work]:
        """Rays of those passes of which most wait, largest heaps first, so many in all. Each is busy until `done`."""
        taken: list[Work] = []
        for number in self._largest_first():
            if taken and self._sizes[number] > room:
                continue
            taken.append(self._take_of(number, room))
            room -= len(taken[-1].rays)
        return taken

    def _largest_first(self) -> list[int]:
        return sorted(self._sizes, key=lambda number: (-self._sizes[number], number))

    def take(self) -> Work | None:
        """Rays of the pass of which most wait, or None. The pass is busy until `done`."""
        if not self._waiting:
            return None
        return self._take_of(self._largest_first()[0], TAKE_RAYS_MAX)

    def _take_of(self, number: int, room: int) -> Work:
        batches, count = self._waiting[number], 0
        taken: list[U32] = []
        while batches and count < room:
            rays = batches.popleft()
            if count + len(rays) > room:
                batches.appendleft(rays[room - count :])
                rays = rays[: room - count]
            taken.append(rays)
            count += len(rays)
        self._sizes[number] -= count
        if not batches:
            del self._waiting[number], self._sizes[number]
        self._rays -= count
        self.lend(number)
        rays = taken[0] if len(taken) == 1 else np.concatenate(taken)
        return Work(number, rays.reshape(-1, RAY_WORDS))

    def done(self, number: int) -> bool:
        """What was taken of a pass is traced; True if nothing of that pass waits or is under way here."""
        self._under_way[number] -= 1
        if not self._under_way[number]:
            del self._under_way[number]
        return not self.is_busy(number)

    def is_busy(self, number: int) -> bool:
        """Whether rays of a pass wait or are being traced here."""
        return number in self._waiting or number in self._under_way
