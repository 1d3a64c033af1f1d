"""How far a ray flies through empty space, in few steps: compiled (specs/28-rebalancing.md, Empty space).

Of each voxel of the first grid it is known how far the next occupied one is, so a ray flies that far at once. Where a voxel is occupied, those of
the second grid that it meets there are looked at.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.partition.occupancy_kernels import SIDE, _is_set, _voxel

_NUDGE = 2.0**-20
"""Of a voxel: so far a ray gets beyond a wall, that it gets on. What marks voxels is grown by far more."""
_STEPS_MAX = 1024
"""A ray crosses no more than 382 voxels."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def fill_reach(words, reach):
    """Of each voxel of a grid, words uint64[128, 128, 2], the distance to the next occupied one to reach uint8[128, 128, 128]: 0 if it is itself.

    In voxels, the longest axis counts; 127 at most. Exact, by two sweeps (Rosenfeld and Pfaltz, 1968).
    """
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                best = 0 if _is_set(words, i, j, k) else 127
                if best > 0:
                    for di in range(-1, 1):
                        for dj in range(-1, 2 if di < 0 else 1):
                            for dk in range(-1, 2 if di < 0 or dj < 0 else 0):
                                a, b, c = i + di, j + dj, k + dk
                                if 0 <= a and 0 <= b < SIDE and 0 <= c < SIDE:
                                    best = min(best, int(reach[a, b, c]) + 1)
                reach[i, j, k] = np.uint8(best)
    for i in range(SIDE - 1, -1, -1):
        for j in range(SIDE - 1, -1, -1):
            for k in range(SIDE - 1, -1, -1):
                best = int(reach[i, j, k])
                if best > 1:
                    for di in range(2):
                        for dj in range(0 if di == 0 else -1, 2):
                            for dk in range(1 if di == 0 and dj == 0 else -1, 2):
                                a, b, c = i + di, j + dj, k + dk
                                if a < SIDE and 0 <= b < SIDE and 0 <= c < SIDE:
                                    best = min(best, int(reach[a, b, c]) + 1)
                    reach[i, j, k] = np.uint8(best)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _leaves(at, way, low, high):
    """How far along a ray the interval low .. high is left on an axis, from a place in it."""
    return (high - at) / way if way > 0.0 else (low - at) / way if way < 0.0 else math.inf


@njit(error_model="numpy", _nrt=False)
def _second_is_set(words, ax, ay, az, bx, by, bz):
    """Whether a voxel of the second grid is occupied that the box between two places meets, which has sides of a voxel at most."""
    for i in range(_voxel(min(ax, bx)), _voxel(max(ax, bx)) + 1):
        for j in range(_voxel(min(ay, by)), _voxel(max(ay, by)) + 1):
            for k in range(_voxel(min(az, bz)), _voxel(max(az, bz)) + 1):
                if _is_set(words, i, j, k):
                    return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def first_met(empty, ox, oy, oz, dx, dy, dz, t_from, t_to):
    """The least t_from <= t <= t_to at which o + t d may meet geometry, or inf if it does not: nothing that was marked lies before. t_to may be inf.

    `empty`: an `EmptySpace` that knows something. t is where a voxel is entered, or t_from.
    """
    low, high, per_voxel = empty.low, empty.high, empty.per_voxel
    near, far = t_from, t_to
    for axis in range(3):
        o = ox if axis == 0 else oy if axis == 1 else oz
        d = dx if axis == 0 else dy if axis == 1 else dz
        # Everything that marks lies in the box, and that in both grids.
        begin, end = low[axis] - 0.125 / per_voxel[axis], high[axis] + 0.125 / per_voxel[axis]
        if d == 0.0:
            if o < begin or o > end:
                return math.inf
            continue
        one, two = (begin - o) / d, (end - o) / d
        near, far = max(near, min(one, two)), min(far, max(one, two))
    if not near <= far:
        return math.inf
    # In voxels of the first grid; the second one is so far aside.
    aside = empty.shift[1] - empty.shift[0]
    ux, uy, uz = dx * per_voxel[0], dy * per_voxel[1], dz * per_voxel[2]
    x = (ox - low[0]) * per_voxel[0] + empty.shift[0]
    y = (oy - low[1]) * per_voxel[1] + empty.shift[0]
    z = (oz - low[2]) * per_voxel[2] + empty.shift[0]
    longest = max(abs(ux), max(abs(uy), abs(uz)))
    if not longest > 0.0:
        return near
    nudge = _NUDGE / longest
    t = near
    for _ in range(_STEPS_MAX):
        px, py, pz = x + t * ux, y + t * uy, z + t * uz
        i, j, k = _voxel(px), _voxel(py), _voxel(pz)
        reach = int(empty.reach[i, j, k])
        wide = max(reach - 1, 0)
        step = min(
            _leaves(px, ux, i - wide, i + wide + 1), min(_leaves(py, uy, j - wide, j + wide + 1), _leaves(pz, uz, k - wide, k + wide + 1))
        )
        step = max(step, 0.0)
        if reach == 0:
            last = min(t + step, far) - t
            qx, qy, qz = px + last * ux, py + last * uy, pz + last * uz
            if _second_is_set(empty.second, px + aside, py + aside, pz + aside, qx + aside, qy + aside, qz + aside):
                return t
        t += step + nudge
        if t > far:
            return math.inf
    return t


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def firsts_met(empty, origins, directions, t_from, t_to, found):
    """`first_met` of n rays: f64[n, 3] twice, f64[n] twice -> f64[n]."""
    for i in range(origins.shape[0]):
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        found[i] = first_met(empty, ox, oy, oz, dx, dy, dz, t_from[i], t_to[i])
