"""Grids of occupied voxels, compiled: marking, and walking along a ray (specs/28-rebalancing.md, Empty space).

A voxel counts for more than its box: by `SLACK` of a voxel on every side, when geometry marks it and again when a ray
looks. That is far more than all rounding here, so neither side has to be exact.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIDE = 128
"""Voxels on each side of a grid."""
SLACK = 2.0**-10
"""Of a voxel: by how much what marks it is grown, and by how much the walk looks beyond its interval."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _voxel(at):
    return min(max(int(math.floor(at)), 0), SIDE - 1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _is_set(words, i, j, k):
    return (words[i, j, k >> 6] >> np.uint64(k & 63)) & np.uint64(1) != np.uint64(0)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark(grids, low, per_voxel, shift, boxes_low, boxes_high, dilation):
    """Set the voxels of both grids, uint64[2, 128, 128, 2], that boxes f64[m, 3] grown by `dilation` meet.

    `per_voxel` f64[3] is voxels a unit; grid g begins `shift[g]` voxels below `low` f64[3]. What lies outside of a grid counts
    for its outermost voxels.
    """
    for box in range(boxes_low.shape[0]):
        for grid in range(grids.shape[0]):
            words = grids[grid]
            i0 = _voxel((boxes_low[box, 0] - dilation - low[0]) * per_voxel[0] + shift[grid] - SLACK)
            i1 = _voxel((boxes_high[box, 0] + dilation - low[0]) * per_voxel[0] + shift[grid] + SLACK)
            j0 = _voxel((boxes_low[box, 1] - dilation - low[1]) * per_voxel[1] + shift[grid] - SLACK)
            j1 = _voxel((boxes_high[box, 1] + dilation - low[1]) * per_voxel[1] + shift[grid] + SLACK)
            k0 = _voxel((boxes_low[box, 2] - dilation - low[2]) * per_voxel[2] + shift[grid] - SLACK)
            k1 = _voxel((boxes_high[box, 2] + dilation - low[2]) * per_voxel[2] + shift[grid] + SLACK)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    for k in range(k0, k1 + 1):
                        words[i, j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _any_in(words, i0, i1, j0, j1, k0, k1):
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                if _is_set(words, i, j, k):
                    return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _meets_grid(words, x0, y0, z0, x1, y1, z1):
    """Whether the segment between two points, in voxels, comes near an occupied voxel.

    It is cut where it is one voxel farther along its longest axis; each piece looks at all voxels of its box, which
    are 3 x 3 x 3 at most, so none is missed that the segment meets.
    """
    longest = max(abs(x1 - x0), max(abs(y1 - y0), abs(z1 - z0)))
    pieces = int(math.ceil(longest)) if longest > 1.0 else 1
    for piece in range(pieces):
        a, b = piece / pieces, (piece + 1) / pieces
        ax, bx = x0 + (x1 - x0) * a, x0 + (x1 - x0) * b
        ay, by = y0 + (y1 - y0) * a, y0 + (y1 - y0) * b
        az, bz = z0 + (z1 - z0) * a, z0 + (z1 - z0) * b
        if _any_in(
            words,
            _voxel(min(ax, bx) - SLACK),
            _voxel(max(ax, bx) + SLACK),
            _voxel(min(ay, by) - SLACK),
            _voxel(max(ay, by) + SLACK),
            _voxel(min(az, bz) - SLACK),
            _voxel(max(az, bz) + SLACK),
        ):
            return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def is_occupied(grids, low, high, per_voxel, shift, ox, oy, oz, dx, dy, dz, t_from, t_to):
    """False only if o + t d meets nothing that was marked for t_from <= t <= t_to (inf allowed).

    The ray is cut to the box low .. high grown by two voxels: everything that marks lies in the box.
    """
    near, far = t_from, t_to
    for axis in range(3):
        o = ox if axis == 0 else oy if axis == 1 else oz
        d = dx if axis == 0 else dy if axis == 1 else dz
        begin, end = low[axis] - 2.0 / per_voxel[axis], high[axis] + 2.0 / per_voxel[axis]
        if d == 0.0:
            if o < begin or o > end:
                return False
            continue
        one, two = (begin - o) / d, (end - o) / d
        near, far = max(near, min(one, two)), min(far, max(one, two))
    if not near <= far:
        return False
    if far == math.inf:  # it stands still, in the box
        far = near
    x0, y0, z0 = (
        (ox + near * dx - low[0]) * per_voxel[0],
        (oy + near * dy - low[1]) * per_voxel[1],
        (oz + near * dz - low[2]) * per_voxel[2],
    )
    x1, y1, z1 = (ox + far * dx - low[0]) * per_voxel[0], (oy + far * dy - low[1]) * per_voxel[1], (oz + far * dz - low[2]) * per_voxel[2]
    for grid in range(grids.shape[0]):
        s = shift[grid]
        if not _meets_grid(grids[grid], x0 + s, y0 + s, z0 + s, x1 + s, y1 + s, z1 + s):
            return False
    return True
