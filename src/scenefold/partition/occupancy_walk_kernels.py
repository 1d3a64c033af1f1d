"""Rays against the bitmap of empty space, in loops over arrays, compiled (specs/28-rebalancing.md, Empty space)."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.partition.kernels import leave_after
from scenefold.partition.occupancy_kernels import is_occupied


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def occupied(grids, low, high, per_voxel, shift, origins, directions, t_from, t_to, found):
    """`is_occupied` of n rays -> bool[n]."""
    for i in range(origins.shape[0]):
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        found[i] = is_occupied(grids, low, high, per_voxel, shift, ox, oy, oz, dx, dy, dz, t_from[i], t_to[i])


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def next_cell(family, data, nodes, grids, low, high, per_voxel, shift, node, ox, oy, oz, dx, dy, dz, t):
    """The first cell from t on, `node`'s included, in which the ray may meet geometry: (t, int32), or (inf, -1).

    Of a walk that takes longer than any can, rounding apart, the cell where it stands is told: more is held for occupied.
    """
    for _ in range(2 * nodes + 2):
        t_exit, target = leave_after(family, data, node, ox, oy, oz, dx, dy, dz, t)
        if is_occupied(grids, low, high, per_voxel, shift, ox, oy, oz, dx, dy, dz, t, t_exit):
            return t, np.int32(node)
        if target < 0:
            return math.inf, np.int32(-1)
        node, t = target, t_exit
    return t, np.int32(node)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def next_cells(family, data, count, grids, low, high, per_voxel, shift, origins, directions, t, nodes, t_found, found):
    """`next_cell` of n rays -> f64[n], int32[n]."""
    for i in range(origins.shape[0]):
        ox, oy, oz = origins[i, 0], origins[i, 1], origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t_found[i], found[i] = next_cell(family, data, count, grids, low, high, per_voxel, shift, nodes[i], ox, oy, oz, dx, dy, dz, t[i])
