"""Slabs, compiled: slices across an axis (Planar; thesis 3.3.7, specs/06-cells.md).

`data` is f64[N + 2, 3]:

    row 0      a point that depths are counted from
    row 1      unit vector along which they grow
    row 2 + b  depth of bound b in the first number, b = 1 .. N-1 (row 2 is unused)

A point's depth is one sum of three products, so all points and all bounds are compared by the same numbers.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from scenefold.partition.box_kernels import ROUNDING, least_along, reach_along

HEAD_ROWS = 2


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner(data, x, y, z, dx, dy, dz):
    """Node whose slab holds x, y, z; on a hull the one a little further along d, then the lowest."""
    depth = (x - data[0, 0]) * data[1, 0] + (y - data[0, 1]) * data[1, 1] + (z - data[0, 2]) * data[1, 2]
    ahead = dx * data[1, 0] + dy * data[1, 1] + dz * data[1, 2] > 0.0
    low = 0
    high = data.shape[0] - HEAD_ROWS - 1
    while low < high:
        bound = (low + high + 1) // 2
        at = data[HEAD_ROWS + bound, 0]
        if at < depth or (at == depth and ahead):
            low = bound
        else:
            high = bound - 1
    return low


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave(data, node, ox, oy, oz, dx, dy, dz):
    """Where the line o + t d leaves the node's slab for good, and into whose: (t, node), (inf, -1) if nowhere.

    A slab between two equal bounds is empty, and left at t = -inf.
    """
    nodes = data.shape[0] - HEAD_ROWS
    speed = dx * data[1, 0] + dy * data[1, 1] + dz * data[1, 2]
    if 0 < node < nodes - 1 and data[HEAD_ROWS + node, 0] == data[HEAD_ROWS + node + 1, 0]:
        return -math.inf, node + 1 if speed > 0.0 else node - 1
    depth = (ox - data[0, 0]) * data[1, 0] + (oy - data[0, 1]) * data[1, 1] + (oz - data[0, 2]) * data[1, 2]
    if speed > 0.0 and node < nodes - 1:
        target = node + 1
        at = data[HEAD_ROWS + target, 0]
        while target < nodes - 1 and data[HEAD_ROWS + target + 1, 0] == at:
            target += 1
        return (at - depth) / speed, target
    if speed < 0.0 and node > 0:
        target = node - 1
        at = data[HEAD_ROWS + node, 0]
        while target > 0 and data[HEAD_ROWS + target, 0] == at:
            target -= 1
        return (at - depth) / speed, target
    return math.inf, -1


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def facets(data, node):
    return 2 if data.shape[0] > HEAD_ROWS + 1 else 0


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    """Whether the whole box lies more than `dilation` before the slab (facet 0) or behind it (facet 1)."""
    row = HEAD_ROWS + node + facet
    if row == HEAD_ROWS or row == data.shape[0]:
        return False
    sign = 1.0 if facet == 1 else -1.0
    nx, ny, nz = sign * data[1, 0], sign * data[1, 1], sign * data[1, 2]
    px, py, pz = data[0, 0], data[0, 1], data[0, 2]
    at = data[row, 0]
    beyond = least_along(nx, ny, nz, lx - px, ly - py, lz - pz, hx - px, hy - py, hz - pz) - sign * at
    far_x, far_y, far_z = max(abs(lx - px), abs(hx - px)), max(abs(ly - py), abs(hy - py)), max(abs(lz - pz), abs(hz - pz))
    margin = reach_along(nx, ny, nz, far_x, far_y, far_z) + reach_along(nx, ny, nz, px, py, pz) + abs(at)
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return beyond > dilation * length * (1.0 + ROUNDING) + ROUNDING * (margin + dilation)
