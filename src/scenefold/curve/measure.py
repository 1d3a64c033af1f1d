"""How fast the curves are on this machine: what `scenectl bench curve` prints.

Pure but for the time it takes: the clock is handed in, points come from a fixed seed, and every figure is the
best of a few rounds, after one that compiles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from scenefold.curve.curves import Curve, CurveKind

ROUNDS = 3


@dataclass(frozen=True, slots=True)
class CurveSpeed:
    """Speeds of one curve on one core. Boxes have random corners anywhere in the space."""

    kind: CurveKind
    dimensions: int
    encode_points_s: float
    decode_points_s: float
    arcs_boxes_s: float
    """Boxes turned into arcs in a second."""
    arcs_limit: int
    arcs_per_box: float


def measure_curve(
    kind: CurveKind, dimensions: int, clock: Callable[[], float], *, points: int = 200_000, boxes: int = 100, limit: int = 64
) -> CurveSpeed:
    """Speeds of one curve by `clock` (seconds, as time.perf_counter), with that many points and boxes a round."""
    curve = Curve(kind, dimensions)
    random = np.random.default_rng(dimensions)
    cells = random.integers(0, (1 << curve.cell_bits) - 1, (points, dimensions), dtype=np.uint64, endpoint=True)
    corners = random.integers(0, (1 << curve.cell_bits) - 1, (boxes, 2, dimensions), dtype=np.uint64, endpoint=True)
    lows, highs = corners.min(axis=1), corners.max(axis=1)
    locations = curve.encode(cells)
    arcs = sum(len(curve.arcs(low, high, limit)) for low, high in zip(lows, highs, strict=True))
    encode_s = _best_s(clock, lambda: curve.encode(cells))
    decode_s = _best_s(clock, lambda: curve.decode(locations))
    arcs_s = _best_s(clock, lambda: [curve.arcs(low, high, limit) for low, high in zip(lows, highs, strict=True)])
    return CurveSpeed(kind, dimensions, points / encode_s, points / decode_s, boxes / arcs_s, limit, arcs / boxes)


def measure_curves(clock: Callable[[], float], dimensions: Iterable[int] = range(1, 9)) -> list[CurveSpeed]:
    """Speeds of both curves for each number of dimensions."""
    kinds: tuple[CurveKind, CurveKind] = ("hilbert", "z-order")
    return [measure_curve(kind, count, clock) for count in dimensions for kind in kinds]


def hilbert_ratios(speeds: Iterable[CurveSpeed]) -> dict[int, float]:
    """For each number of dimensions measured with both curves: points/s encoded by Hilbert over those by Z-order."""
    encode = {(speed.kind, speed.dimensions): speed.encode_points_s for speed in speeds}
    return {
        count: rate / encode["z-order", count]
        for (kind, count), rate in encode.items()
        if kind == "hilbert" and ("z-order", count) in encode
    }


def _best_s(clock: Callable[[], float], work: Callable[[], object]) -> float:
    work()
    spent = []
    for _ in range(ROUNDS):
        begin = clock()
        work()
        spent.append(clock() - begin)
    return max(min(spent), 1e-9)
