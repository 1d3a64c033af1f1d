"""How fast the curves are on this machine: what `scenectl bench curve` prints.

Points come from a fixed seed; base/measuring.py does the measuring.
"""

from __future__ import annotations

import numpy as np

from scenefold.base.measuring import Work
from scenefold.curve.curves import Curve


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
