"""Boxes as numbers: 3 (N - 1) of them, the cuts of a k-d tree (partitions.md; specs/06-cells.md).

A cut is an axis (0, 1 or 2), the coordinate of its plane, and the number of nodes on the lower side. They come
root first, then all of the lower side, then all of the upper. Leaves are nodes 0 .. N-1 from lower to upper, and
leaves at the rim have no end. A plane lies within the box that it cuts; on its rim it leaves an empty cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class Cut(NamedTuple):
    """One plane: across `axis` at `plane`, with `lower` nodes on its lower side."""

    axis: int
    plane: float
    lower: int


class _Part(NamedTuple):
    """What a cut is to part: nodes first .. first + count - 1, and the box of their cells."""

    row: int
    """Of the cut above it in the kernels' table, or -1."""
    side: int
    first: int
    nodes: int
    box: Floats
    """f64[6]: the low corner, the high corner."""


def size(nodes: int) -> int:
    return 3 * (nodes - 1)


def fault(values: Floats, nodes: int) -> str:
    if not np.isin(values[0::3], (0.0, 1.0, 2.0)).all():
        return "a cut goes across axis 0, 1 or 2"
    lower = values[2::3]
    if not ((lower >= 1.0) & (lower < nodes) & (lower == np.floor(lower))).all():
        return "a cut has at least one node on each side"
    for part, cut in _cuts(values, nodes):
        if cut.lower >= part.nodes:
            return "a cut has at least one node on each side"
        if not part.box[cut.axis] <= cut.plane <= part.box[3 + cut.axis]:
            return "a cut lies outside of the box that it parts"
    return ""


def kernel_data(values: Floats, nodes: int) -> Floats:
    """f64[2 N - 1, 6] as `kd_kernels` reads it: a fresh array."""
    data = np.zeros((2 * nodes - 1, 6))
    data[0, :3], data[0, 3:] = -np.inf, np.inf
    for number, (part, cut) in enumerate(_cuts(values, nodes)):
        row = nodes + number
        data[row, :2] = cut.axis, cut.plane
        if part.row >= 0:
            data[part.row, 2 + part.side] = row
        for side, (first, count, box) in enumerate(_halves(part, cut)):
            if count == 1:
                data[first] = box
                data[row, 2 + side] = first
    return data


def pack(cuts: list[Cut]) -> Floats:
    """The canonical numbers of these cuts, root first, lower side before upper."""
    return np.array(cuts, np.float64).reshape(-1)


def _halves(part: _Part, cut: Cut) -> tuple[tuple[int, int, Floats], tuple[int, int, Floats]]:
    lower, upper = part.box.copy(), part.box.copy()
    lower[3 + cut.axis] = upper[cut.axis] = cut.plane
    return (part.first, cut.lower, lower), (part.first + cut.lower, part.nodes - cut.lower, upper)


def _cuts(values: Floats, nodes: int) -> Iterator[tuple[_Part, Cut]]:
    """Each cut with what it parts; a cut without a node on one side is given out once more, and is the last."""
    waiting = [_Part(-1, 0, 0, nodes, np.repeat([-np.inf, np.inf], 3))] if nodes > 1 else []
    for number, (axis, plane, lower) in enumerate(values.reshape(-1, 3)):
        part, cut = waiting.pop(), Cut(int(axis), float(plane), int(lower))
        yield part, cut
        if cut.lower >= part.nodes:
            return
        halves = _halves(part, cut)
        for side in (1, 0):  # the lower one is the next to come out
            first, count, box = halves[side]
            if count > 1:
                waiting.append(_Part(nodes + number, side, first, count, box))
