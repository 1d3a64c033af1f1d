"""Rays that wait for a cell, on the disk: a file for each cell, and where in it those of each pass lie."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np

from scenefold.base.rays import RAY_BYTES, RAY_WORDS
from scenefold.render.arrays import U32
from scenefold.render.out_of_core.spill import Spill

Places = list[tuple[int, int]]
"""Each: the number of the first ray in the file, and how many there are."""


class WaitingRays:
    """Of all cells and open passes. Thread safe, but that one thread at a time takes."""

    def __init__(self, spill: Spill, cells: int) -> None:
        self._files = [spill.file() for _ in range(cells)]
        self._ends = [0] * cells
        self._places: list[dict[int, Places]] = [{} for _ in range(cells)]
        self._lock = threading.Lock()
        self.counts = [0] * cells
        """Rays that wait for each cell."""
        self._waiting = 0
        self.most = 0
        """The most that waited, in all."""

    def put(self, cell: int, rays: Sequence[tuple[int, U32]]) -> None:
        """uint32[n, 9] of each of some passes; LocalFault where the disk is full."""
        count = sum(len(some) for _, some in rays)
        with self._lock:
            first, self._ends[cell] = self._ends[cell], self._ends[cell] + count
        together = np.concatenate([some for _, some in rays])
        self._files[cell].write_at(first * RAY_BYTES, memoryview(together.data).cast("B"))
        with self._lock:
            for number, some in rays:
                self._places[cell].setdefault(number, []).append((first, len(some)))
                first += len(some)
            self.counts[cell] += count
            self._waiting += count
            self.most = max(self.most, self._waiting)

    def take(self, cell: int) -> dict[int, Places]:
        """By pass, all that waits; it no longer does. What is put from now on lies behind it."""
        with self._lock:
            taken, self._places[cell] = self._places[cell], {}
            self._waiting -= self.counts[cell]
            self.counts[cell] = 0
        return taken

    def read(self, cell: int, first: int, count: int) -> U32:
        """uint32[count, 9] of what was taken."""
        data = self._files[cell].read_at(first * RAY_BYTES, count * RAY_BYTES)
        return np.frombuffer(data, np.uint32).reshape(-1, RAY_WORDS).copy()

    def worked_off(self, cell: int) -> None:
        """What was taken is done with; if nothing was put since, the file gives its room back."""
        with self._lock:
            if self.counts[cell] == 0:
                self._files[cell].empty()
                self._ends[cell] = 0
