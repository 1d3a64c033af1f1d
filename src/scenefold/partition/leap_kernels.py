"""Leaps over empty space, compiled: how far from anything each voxel is, and rays that go so far at once (specs/28-rebalancing.md, Empty space)."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.partition.occupancy_kernels import SIDE, voxel

_STEP = 2.0**-12
"""Voxels by which a walk goes on behind the hull of what it has seen to be empty: less than what marks is grown by."""
_LEAPS_MAX = 8 * SIDE
"""More than any walk takes."""


@njit(nogil=True, cache=True, error_model="numpy")
def distances(grids):
    """Of each voxel of bitmaps uint64[g, 128, 128, 2] to the next one that is set, along the axis on which it is farther: uint8[g, 128, 128, 128].

    0: it is set; at most 128.
    """
    found = np.empty((grids.shape[0], SIDE, SIDE, SIDE), np.uint8)
    row = np.empty(SIDE, np.uint8)
    for g in range(grids.shape[0]):
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    is_set = (grids[g, i, j, k >> 6] >> np.uint64(k & 63)) & np.uint64(1)
                    found[g, i, j, k] = 0 if is_set != np.uint64(0) else SIDE
                _spread_z(found[g, i, j])
        _spread_axis(found[g], 0, row)
        _spread_axis(found[g], 1, row)
    return found


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _spread_z(line):
    best = SIDE
    for k in range(SIDE):
        best = min(best + 1, int(line[k]))
        line[k] = min(best, SIDE)
    best = SIDE
    for k in range(SIDE - 1, -1, -1):
        best = min(best + 1, int(line[k]))
        line[k] = min(best, SIDE)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _spread_axis(grid, axis, row):
    """Chebyshev's distance, axis by axis: the least of max(distance along this axis, what the line there has). Lines are short: a window that closes."""
    for a in range(SIDE):
        for b in range(SIDE):
            for c in range(SIDE):
                row[c] = grid[a, c, b] if axis == 0 else grid[c, a, b]
            for c in range(SIDE):
                best = int(row[c])
                away = 1
                while away < best:
                    if c >= away:
                        best = min(best, max(away, int(row[c - away])))
                    if c + away < SIDE:
                        best = min(best, max(away, int(row[c + away])))
                    away += 1
                if axis == 0:
                    grid[a, c, b] = best
                else:
                    grid[c, a, b] = best


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def first_near(distances, low, per_voxel, shift, ox, oy, oz, dx, dy, dz, t, far):
    """The first t from the given one on, up to `far`, where o + t d is in a voxel that is set in all grids; inf if there is none.

    The ray lies in the grids' box from t to far, which is finite. Who takes more leaps than any ray does is told where it stands.
    """
    x, y, z = (ox - low[0]) * per_voxel[0], (oy - low[1]) * per_voxel[1], (oz - low[2]) * per_voxel[2]
    vx, vy, vz = dx * per_voxel[0], dy * per_voxel[1], dz * per_voxel[2]
    longest = max(abs(vx), max(abs(vy), abs(vz)))
    if not longest > 0.0:
        far, vx, vy, vz, longest = t, 0.0, 0.0, 0.0, 1.0
    on = _STEP / longest
    ix, iy, iz = 1.0 / vx, 1.0 / vy, 1.0 / vz
    grids = distances.shape[0]
    grid = agreed = 0
    for _ in range(_LEAPS_MAX):
        s = shift[grid]
        i, j, k = voxel(x + t * vx + s), voxel(y + t * vy + s), voxel(z + t * vz + s)
        free = int(distances[grid, i, j, k])
        if free == 0:
            agreed += 1
            if agreed >= grids:
                return t
            grid = grid + 1 if grid + 1 < grids else 0
            continue
        agreed = 0
        leave = math.inf
        if vx != 0.0:
            leave = ((i + free if vx > 0.0 else i - free + 1) - x - s) * ix
        if vy != 0.0:
            leave = min(leave, ((j + free if vy > 0.0 else j - free + 1) - y - s) * iy)
        if vz != 0.0:
            leave = min(leave, ((k + free if vz > 0.0 else k - free + 1) - z - s) * iz)
        if leave >= far:
            return math.inf
        t = min(max(leave, t) + on, far)
    return t


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def first_near_each(distances, low, high, per_voxel, shift, origins, directions, t_from, t_to, found):
    """`first_near` of n rays that may begin and end anywhere (inf allowed) -> f64[n]."""
    for ray in range(origins.shape[0]):
        near, far = t_from[ray], t_to[ray]
        moves = False
        for axis in range(3):
            o, d = origins[ray, axis], directions[ray, axis]
            begin, end = low[axis] - 2.0 / per_voxel[axis], high[axis] + 2.0 / per_voxel[axis]
            if d == 0.0:
                if o < begin or o > end:
                    far = -math.inf
                continue
            moves = True
            one, two = (begin - o) / d, (end - o) / d
            near, far = max(near, min(one, two)), min(far, max(one, two))
        if distances.shape[0] == 0:
            found[ray] = t_from[ray]
        elif not near <= far:
            found[ray] = math.inf
        else:
            found[ray] = first_near(
                distances,
                low,
                per_voxel,
                shift,
                origins[ray, 0],
                origins[ray, 1],
                origins[ray, 2],
                directions[ray, 0],
                directions[ray, 1],
                directions[ray, 2],
                near,
                far if moves else near,
            )
