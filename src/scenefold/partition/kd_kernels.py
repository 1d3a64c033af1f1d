"""Boxes, compiled: leaves of a k-d tree (partitions.md, k-d; specs/06-cells.md).

`data` is f64[2 N - 1, 6]:

    row i, i < N    low and high corner of node i's box, infinite at the rim
    row N + k       cut k: axis, plane, the rows of its lower and its upper side (the last two are unused); N is the root

The walk compares the t of each plane's crossing, never coordinates of a point that was rounded: a ray that left
one box is in the next by the same numbers, and cannot fall back.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from scenefold.partition.box_kernels import ROUNDING


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _along(axis, x, y, z):
    return x if axis == 0 else y if axis == 1 else z


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner(data, x, y, z, dx, dy, dz):
    """Node whose box holds x, y, z; on a plane the one a little further along d, then the lower one."""
    nodes = (data.shape[0] + 1) // 2
    row = nodes if nodes > 1 else 0
    while row >= nodes:
        axis = int(data[row, 0])
        at, plane = _along(axis, x, y, z), data[row, 1]
        if at > plane or (at == plane and _along(axis, dx, dy, dz) > 0.0):
            row = int(data[row, 3])
        else:
            row = int(data[row, 2])
    return row


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _owner_after(data, ox, oy, oz, dx, dy, dz, t):
    """Node in whose box the line is right after t."""
    nodes = (data.shape[0] + 1) // 2
    row = nodes if nodes > 1 else 0
    while row >= nodes:
        axis = int(data[row, 0])
        start, speed, plane = _along(axis, ox, oy, oz), _along(axis, dx, dy, dz), data[row, 1]
        if speed > 0.0:
            is_upper = (plane - start) / speed <= t
        elif speed < 0.0:
            is_upper = (plane - start) / speed > t
        else:
            is_upper = start > plane
        row = int(data[row, 3]) if is_upper else int(data[row, 2])
    return row


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave(data, node, ox, oy, oz, dx, dy, dz):
    """Where the line o + t d leaves the node's box for good, and into whose: (t, node), (inf, -1) if nowhere."""
    first = math.inf
    for axis in range(3):
        start, speed = _along(axis, ox, oy, oz), _along(axis, dx, dy, dz)
        if speed == 0.0:
            continue
        plane = data[node, 3 + axis] if speed > 0.0 else data[node, axis]
        if math.isinf(plane):
            continue
        first = min(first, (plane - start) / speed)
    if first == math.inf:
        return math.inf, -1
    return first, _owner_after(data, ox, oy, oz, dx, dy, dz, first)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def facets(data, node):
    return 6 if data.shape[0] > 1 else 0


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    """Whether the whole box lies more than `dilation` beyond one side of the node's: facets 0 to 2 low, 3 to 5 high."""
    side = data[node, facet]
    if math.isinf(side):
        return False
    if facet < 3:
        at = _along(facet, hx, hy, hz)
        beyond = side - at
    else:
        at = _along(facet - 3, lx, ly, lz)
        beyond = at - side
    return beyond > dilation * (1.0 + ROUNDING) + ROUNDING * (abs(at) + abs(side))
