"""Which cell comes next: to and fro between the nearest to the camera and the farthest, past those for which few rays wait."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

_FEW = 0.25
"""Of what waits for a cell on average, where any does."""


class Sweep:
    """A place in the order of cells, and a direction. What goes one way through the scene is carried all of that way by one sweep."""

    def __init__(self, order: Sequence[int]) -> None:
        """`order`: all cells, the first to be worked off first."""
        self._order = list(order)
        self._at, self._way = -1, 1

    def next(self, waiting: Sequence[int]) -> int:
        """The cell to work off now, of those that rays wait for, int[cells]; some do."""
        self._at, self._way = self._found(waiting, None) or (self._at, self._way)
        return self._order[self._at]

    def after(self, waiting: Sequence[int]) -> int | None:
        """The one that comes after that, if no more rays came to wait; None if there is none."""
        found = self._found(waiting, self._at)
        return None if found is None else self._order[found[0]]

    def _found(self, waiting: Sequence[int], left_out: int | None) -> tuple[int, int] | None:
        counts = [count for count in waiting if count]
        few = _FEW * sum(counts) / max(len(counts), 1)
        size, at, way = len(self._order), self._at, self._way
        ahead = range(at + way, size if way > 0 else -1, way)
        back = range(size - 1, -1, -1) if way > 0 else range(size)
        for places, direction in ((ahead, way), (back, -way)):
            for place in places:
                count = waiting[self._order[place]]
                if place != left_out and count and count >= few:
                    return place, direction
        return None


def lots_of(rays: Mapping[int, int], threads: int, most: int = 65_536) -> Iterator[list[int]]:
    """Passes, ascending, put together until they have so many rays, or what each of the threads has four of."""
    enough = min(most, sum(rays.values()) // (4 * threads))
    lot: list[int] = []
    size = 0
    for number in sorted(rays):
        lot.append(number)
        size += rays[number]
        if size >= enough:
            yield lot
            lot, size = [], 0
    if lot:
        yield lot
