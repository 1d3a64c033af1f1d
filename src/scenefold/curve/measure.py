"""How fast the curves are on this machine: what `scenectl bench curve` prints.

Pure but for the time it takes: the clock is handed in and points come from a fixed seed. A machine's speed drifts, so
everything that is compared is one list of works, done once to compile and then in turns; each has the median of its
rounds, with the least and the most beside it.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenefold.curve.curves import Curve

_SECONDS_MIN = 1e-9


@dataclass(frozen=True, slots=True)
class Work:
    """Something to time: `run` does `items` of it."""

    name: str
    items: int
    run: Callable[[], object]


@dataclass(frozen=True, slots=True)
class Rate:
    """Items a second: the median of all rounds, and the two ends."""

    median: float
    least: float
    most: float


def measure_in_turns(works: Sequence[Work], clock: Callable[[], float], rounds: int) -> dict[str, Rate]:
    """The rate of every work by `clock` (seconds of processor time, as time.thread_time); `rounds` >= 1."""
    rates: dict[str, list[float]] = {work.name: [] for work in works}
    for work in works:
        work.run()
    for _ in range(rounds):
        for work in works:
            begin = clock()
            work.run()
            rates[work.name].append(work.items / max(clock() - begin, _SECONDS_MIN))
    return {name: Rate(statistics.median(found), min(found), max(found)) for name, found in rates.items()}


def random_cells(curve: Curve, count: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint64]]:
    """The cells that a curve is measured with, anywhere in its space."""
    dice = np.random.default_rng(curve.dimensions)
    return dice.integers(0, (1 << curve.cell_bits) - 1, (count, curve.dimensions), dtype=np.uint64, endpoint=True)


def curve_works(curve: Curve, points: int, boxes: int, limit: int) -> list[Work]:
    """Works `encode` and `decode` of that many points, and `arcs` of that many boxes with random corners, at most `limit` arcs each."""
    cells = random_cells(curve, points)
    locations = curve.encode(cells)
    corners = random_cells(curve, 2 * boxes).reshape(boxes, 2, curve.dimensions)
    pairs = list(zip(corners.min(axis=1), corners.max(axis=1), strict=True))
    return [
        Work("encode", points, lambda: curve.encode(cells)),
        Work("decode", points, lambda: curve.decode(locations)),
        Work("arcs", boxes, lambda: [curve.arcs(low, high, limit) for low, high in pairs]),
    ]
