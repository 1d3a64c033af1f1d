"""Which cells of centroids are next to each other, compiled: each bisector's facet, clipped (specs/28-rebalancing.md).

Two power cells are next to each other if what is left of the plane between them, after every other node's
half-space has cut it, has an area. That is a polygon in a plane, and one cut after the other: centroids in a
line, in a plane or on a circle are no special case, and no triangulation is kept.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

SLIVER = 2.0**-32
"""Of the square of the room's side: facets of less area are what rounding leaves of an edge."""
_HEAD = 16
"""Corners that the square and the room's six sides may leave, with some to spare."""


@njit(nogil=True, cache=True, error_model="numpy")
def _clip(polygon, count, other, at, along, across):
    """The part of `polygon[:count]`, f64[., 2], with at + along a + across b <= 0, into `other`: its count."""
    kept = 0
    for i in range(count):
        a0, b0 = polygon[i, 0], polygon[i, 1]
        k = i + 1 if i + 1 < count else 0
        a1, b1 = polygon[k, 0], polygon[k, 1]
        s0 = at + along * a0 + across * b0
        s1 = at + along * a1 + across * b1
        if s0 <= 0.0:
            other[kept, 0], other[kept, 1] = a0, b0
            kept += 1
        if (s0 < 0.0 and s1 > 0.0) or (s0 > 0.0 and s1 < 0.0):
            share = s0 / (s0 - s1)
            other[kept, 0], other[kept, 1] = a0 + share * (a1 - a0), b0 + share * (b1 - b0)
            kept += 1
    return kept


@njit(nogil=True, cache=True, error_model="numpy")
def _area(polygon, count):
    twice = 0.0
    for i in range(1, count - 1):
        a0, b0 = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        a1, b1 = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1]
        twice += a0 * b1 - a1 * b0
    return 0.5 * abs(twice)


@njit(nogil=True, cache=True, error_model="numpy")
def _facet_area(table, i, j, half, one, two):
    """Area of the facet between nodes i and j in the cube of half side `half` around 0; 0 if there is none.

    A node on the centroid of a lower or heavier one hides behind it from all others. `table` is f64[N, 4], centroids from the cube's middle, and weights.
    """
    nx, ny, nz = table[j, 0] - table[i, 0], table[j, 1] - table[i, 1], table[j, 2] - table[i, 2]
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length == 0.0:
        return 0.0
    nx, ny, nz = nx / length, ny / length, nz / length
    mx, my, mz = 0.5 * (table[i, 0] + table[j, 0]), 0.5 * (table[i, 1] + table[j, 1]), 0.5 * (table[i, 2] + table[j, 2])
    height = nx * mx + ny * my + nz * mz - 0.5 * (table[j, 3] - table[i, 3]) / length
    # A frame of the plane: u across n and the axis that n is least along, v across both.
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        ux, uy, uz = 0.0, -nz, ny
    elif abs(ny) <= abs(nz):
        ux, uy, uz = nz, 0.0, -nx
    else:
        ux, uy, uz = -ny, nx, 0.0
    across = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / across, uy / across, uz / across
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    px, py, pz = height * nx, height * ny, height * nz
    reach = 2.0 * half
    one[0, 0], one[0, 1], one[1, 0], one[1, 1] = -reach, -reach, reach, -reach
    one[2, 0], one[2, 1], one[3, 0], one[3, 1] = reach, reach, -reach, reach
    count = 4
    for sign in (-1.0, 1.0):
        count = _clip(one, count, two, sign * px - half, sign * ux, sign * vx)
        count = _clip(two, count, one, sign * py - half, sign * uy, sign * vy)
        count = _clip(one, count, two, sign * pz - half, sign * uz, sign * vz)
        one, two = two, one
    for k in range(table.shape[0]):
        if k == i or k == j or count == 0:
            continue
        ex, ey, ez = table[k, 0] - table[i, 0], table[k, 1] - table[i, 1], table[k, 2] - table[i, 2]
        lead = 0.5 * (table[k, 3] - table[i, 3])
        if ex == 0.0 and ey == 0.0 and ez == 0.0:
            if lead > 0.0 or (lead == 0.0 and k < i):
                return 0.0
            continue
        if table[k, 0] == table[j, 0] and table[k, 1] == table[j, 1] and table[k, 2] == table[j, 2]:
            if table[k, 3] > table[j, 3] or (table[k, 3] == table[j, 3] and k < j):
                return 0.0
            continue
        qx = px - 0.5 * (table[k, 0] + table[i, 0])
        qy = py - 0.5 * (table[k, 1] + table[i, 1])
        qz = pz - 0.5 * (table[k, 2] + table[i, 2])
        at = ex * qx + ey * qy + ez * qz + lead
        count = _clip(one, count, two, at, ex * ux + ey * uy + ez * uz, ex * vx + ey * vy + ez * vz)
        one, two = two, one
    return _area(one, count)


@njit(nogil=True, cache=True, error_model="numpy")
def facet_areas(table, half):
    """Area of the facet of each two nodes' cells in the cube: f64[N, N], symmetric, 0 on the diagonal."""
    nodes = table.shape[0]
    areas = np.zeros((nodes, nodes))
    one, two = np.empty((nodes + _HEAD, 2)), np.empty((nodes + _HEAD, 2))
    for i in range(nodes):
        for j in range(i + 1, nodes):
            areas[i, j] = areas[j, i] = _facet_area(table, i, j, half, one, two)
    return areas
