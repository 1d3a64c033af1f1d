"""Where space is empty, in voxels, and how far a ray flies through it: compiled (specs/28-rebalancing.md, Empty space).

A voxel counts for more than its box: by `SLACK` of a voxel on every side, when geometry marks it. That is far more than all
rounding here, so a ray need not be exact. Of each voxel it is known how far the next occupied one is, so a ray flies that far at once.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIDE = 64
"""Voxels on each axis. Of so many a byte each stays in a core's second-level cache, beside what else a tracer reads."""
SLACK = 2.0**-10
"""Of a voxel: by how much what marks it is grown."""
_NUDGE = 2.0**-20
"""Of a voxel: so far a ray gets beyond a wall, that it gets on."""
_STEPS_MAX = 512
"""A ray crosses no more than 190 voxels."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _voxel(at):
    return min(max(int(math.floor(at)), 0), SIDE - 1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark_box(occupied, low, per_voxel, x0, y0, z0, x1, y1, z1):
    """Set the voxels, uint8[SIDE, SIDE, SIDE], that the box x0 y0 z0 .. x1 y1 z1 meets. Voxel 0 begins at `low` f64[3], `per_voxel` f64[3] is voxels a unit.

    What lies outside counts for the outermost voxels.
    """
    i0, i1 = _voxel((x0 - low[0]) * per_voxel[0] - SLACK), _voxel((x1 - low[0]) * per_voxel[0] + SLACK)
    j0, j1 = _voxel((y0 - low[1]) * per_voxel[1] - SLACK), _voxel((y1 - low[1]) * per_voxel[1] + SLACK)
    k0, k1 = _voxel((z0 - low[2]) * per_voxel[2] - SLACK), _voxel((z1 - low[2]) * per_voxel[2] + SLACK)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                occupied[i, j, k] = np.uint8(1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def fill_reach(occupied, reach):
    """Of each voxel the distance to the next occupied one, to reach uint8[SIDE, SIDE, SIDE]: 0 if it is itself.

    In voxels, the longest axis counts; SIDE at most. Exact, by two sweeps (Rosenfeld and Pfaltz, 1968).
    """
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                best = 0 if occupied[i, j, k] else SIDE
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
def _leaves(at, inverse, low, high):
    """How far along a ray the interval low .. high is left on an axis, from a place in it. inverse: of its speed there."""
    return (high - at) * inverse if inverse > 0.0 else (low - at) * inverse


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
        # Everything that marks lies in the box.
        begin, end = low[axis], high[axis]
        if d == 0.0:
            if o < begin or o > end:
                return math.inf
            continue
        one, two = (begin - o) / d, (end - o) / d
        near, far = max(near, min(one, two)), min(far, max(one, two))
    if not near <= far:
        return math.inf
    ux, uy, uz = dx * per_voxel[0], dy * per_voxel[1], dz * per_voxel[2]
    x, y, z = (ox - low[0]) * per_voxel[0], (oy - low[1]) * per_voxel[1], (oz - low[2]) * per_voxel[2]
    longest = max(abs(ux), max(abs(uy), abs(uz)))
    if not longest > 0.0:
        return near
    # An axis along which it stands still is left never, but after 1e300.
    ix = 1.0 / ux if ux != 0.0 else 1e300
    iy = 1.0 / uy if uy != 0.0 else 1e300
    iz = 1.0 / uz if uz != 0.0 else 1e300
    nudge, t = _NUDGE / longest, near
    for _ in range(_STEPS_MAX):
        px, py, pz = x + t * ux, y + t * uy, z + t * uz
        i, j, k = _voxel(px), _voxel(py), _voxel(pz)
        reach = int(empty.reach[i, j, k])
        if reach == 0:
            return t
        wide = reach - 1
        step = min(_leaves(px, ix, i - wide, i + reach), min(_leaves(py, iy, j - wide, j + reach), _leaves(pz, iz, k - wide, k + reach)))
        t += max(step, 0.0) + nudge
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
