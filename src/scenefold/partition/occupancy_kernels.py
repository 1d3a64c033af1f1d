"""Grids of occupied voxels, compiled: marking, and walking along a ray (specs/28-rebalancing.md, Empty space).

A voxel counts for more than its box: by `SLACK` of a voxel on every side, when geometry marks it. That is far more than all
rounding here, so a ray need not be exact.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIDE = 128
"""Voxels on each side of a grid."""
SLACK = 2.0**-10
"""Of a voxel: by how much what marks it is grown."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _voxel(at):
    return min(max(int(math.floor(at)), 0), SIDE - 1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _is_set(words, i, j, k):
    return (words[i, j, k >> 6] >> np.uint64(k & 63)) & np.uint64(1) != np.uint64(0)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark_box(grids, low, per_voxel, shift, x0, y0, z0, x1, y1, z1):
    """Set the voxels of both grids, uint64[2, 128, 128, 2], that the box x0 y0 z0 .. x1 y1 z1 meets; see `mark`."""
    for grid in range(grids.shape[0]):
        words = grids[grid]
        i0 = _voxel((x0 - low[0]) * per_voxel[0] + shift[grid] - SLACK)
        i1 = _voxel((x1 - low[0]) * per_voxel[0] + shift[grid] + SLACK)
        j0 = _voxel((y0 - low[1]) * per_voxel[1] + shift[grid] - SLACK)
        j1 = _voxel((y1 - low[1]) * per_voxel[1] + shift[grid] + SLACK)
        k0 = _voxel((z0 - low[2]) * per_voxel[2] + shift[grid] - SLACK)
        k1 = _voxel((z1 - low[2]) * per_voxel[2] + shift[grid] + SLACK)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    words[i, j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark(grids, low, per_voxel, shift, boxes_low, boxes_high, dilation):
    """Set the voxels of both grids, uint64[2, 128, 128, 2], that boxes f64[m, 3] grown by `dilation` meet.

    `per_voxel` f64[3] is voxels a unit; grid g begins `shift[g]` voxels below `low` f64[3]. What lies outside of a grid counts
    for its outermost voxels.
    """
    for box in range(boxes_low.shape[0]):
        mark_box(
            grids, low, per_voxel, shift,
            boxes_low[box, 0] - dilation, boxes_low[box, 1] - dilation, boxes_low[box, 2] - dilation,
            boxes_high[box, 0] + dilation, boxes_high[box, 1] + dilation, boxes_high[box, 2] + dilation,
        )  # fmt: skip


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _first_wall(at, way, voxel):
    """Where along a segment of length 1 the first wall of its voxel lies on an axis, and how far apart walls are; inf where there is none."""
    if way > 0.0:
        return (voxel + 1 - at) / way, 1.0 / way
    if way < 0.0:
        return (voxel - at) / way, -1.0 / way
    return math.inf, math.inf


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _meets_grid(words, x0, y0, z0, x1, y1, z1):
    """Whether the segment between two points of the grid, in voxels, meets an occupied voxel: from wall to wall (Amanatides and Woo, 1987).

    Where it comes near an edge rounding may choose the other voxel beside it. What was marked is grown by far more than that.
    """
    i, j, k = _voxel(x0), _voxel(y0), _voxel(z0)
    i_end, j_end, k_end = _voxel(x1), _voxel(y1), _voxel(z1)
    tx, dtx = _first_wall(x0, x1 - x0, i)
    ty, dty = _first_wall(y0, y1 - y0, j)
    tz, dtz = _first_wall(z0, z1 - z0, k)
    si, sj, sk = 1 if i_end > i else -1, 1 if j_end > j else -1, 1 if k_end > k else -1
    tx, ty, tz = tx if i != i_end else math.inf, ty if j != j_end else math.inf, tz if k != k_end else math.inf
    for _ in range(abs(i_end - i) + abs(j_end - j) + abs(k_end - k)):
        if _is_set(words, i, j, k):
            return True
        if tx <= ty and tx <= tz:
            i += si
            tx = tx + dtx if i != i_end else math.inf
        elif ty <= tz:
            j += sj
            ty = ty + dty if j != j_end else math.inf
        else:
            k += sk
            tz = tz + dtz if k != k_end else math.inf
    return _is_set(words, i, j, k)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def is_occupied(grids, low, high, per_voxel, shift, ox, oy, oz, dx, dy, dz, t_from, t_to):
    """False only if o + t d meets nothing that was marked for t_from <= t <= t_to (inf allowed).

    The ray is cut to the box low .. high grown by an eighth of a voxel: everything that marks lies in the box, and that in both grids.
    """
    near, far = t_from, t_to
    for axis in range(3):
        o = ox if axis == 0 else oy if axis == 1 else oz
        d = dx if axis == 0 else dy if axis == 1 else dz
        begin, end = low[axis] - 0.125 / per_voxel[axis], high[axis] + 0.125 / per_voxel[axis]
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
