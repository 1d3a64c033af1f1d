"""Which cell comes next: once from the nearest to the camera to the farthest, then where most rays wait."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence


class Sweep:
    """The order of cells in one wave. Camera rays go away from the camera: one way through the scene carries them to what they hit."""

    def __init__(self, order: Sequence[int]) -> None:
        """`order`: all cells, the nearest first."""
        self._order = list(order)
        self._at = 0

    def begin(self) -> None:
        """A new wave's camera rays wait."""
        self._at = 0

    def next(self, waiting: Sequence[int]) -> int:
        """The cell to work off now, by how many rays wait for each, int[cells]; some do."""
        for at in range(self._at, len(self._order)):
            if waiting[self._order[at]]:
                self._at = at + 1
                return self._order[at]
        self._at = len(self._order)
        return max(self._order, key=lambda cell: waiting[cell])

    def after(self, waiting: Sequence[int], now: int) -> int | None:
        """The one that comes after cell `now`, if no more rays came to wait; None if there is none."""
        ahead = next((cell for cell in self._order[self._at :] if waiting[cell] and cell != now), None)
        if ahead is not None:
            return ahead
        most = max((cell for cell in self._order if cell != now), key=lambda cell: waiting[cell], default=None)
        return most if most is not None and waiting[most] else None


def lots_of(rays: Mapping[int, int], threads: int, most: int) -> Iterator[list[int]]:
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
