"""Voronoi cells, compiled: a point belongs to the nearest centroid (thesis 3.2.1, specs/06-cells.md).

`data` is f64[N, 3], the centroids. Every pair of nodes has one bounding half-space, through the middle of the
two centroids and across their connecting line; N - 1 of them bound a cell. They are all looked at, without a
Delaunay graph: with 127 nodes that is cheap, and collinear, coplanar, cocircular and equal centroids are no
special case (thesis 4.4.1 lost its machines to libraries for which they are).
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from scenefold.partition.box_kernels import ROUNDING, least_along, reach_along


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner(data, x, y, z, dx, dy, dz):
    """Node nearest to x, y, z; among equally near ones the nearest a little further along d, then the lowest."""
    best = 0
    nearest = math.inf
    for node in range(data.shape[0]):
        ex = x - data[node, 0]
        ey = y - data[node, 1]
        ez = z - data[node, 2]
        distance = ex * ex + ey * ey + ez * ez
        if distance < nearest:
            best = node
            nearest = distance
        elif distance == nearest:
            nearing = dx * (data[node, 0] - data[best, 0]) + dy * (data[node, 1] - data[best, 1]) + dz * (data[node, 2] - data[best, 2])
            if nearing > 0.0:
                best = node
    return best


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave(data, node, ox, oy, oz, dx, dy, dz):
    """Where the line o + t d leaves the node's cell for good, and into whose: (t, node), (inf, -1) if nowhere.

    A cell that is empty, because a lower node sits on the same centroid, is left at t = -inf.
    """
    first = math.inf
    steepest = 0.0
    target = -1
    cx, cy, cz = data[node, 0], data[node, 1], data[node, 2]
    for other in range(data.shape[0]):
        ex = data[other, 0] - cx
        ey = data[other, 1] - cy
        ez = data[other, 2] - cz
        nearing = dx * ex + dy * ey + dz * ez
        if nearing > 0.0:
            # From the middle of both, not from |c|^2 - |c'|^2: that would cancel far from the world's origin.
            gap = (
                (0.5 * (data[other, 0] + cx) - ox) * ex + (0.5 * (data[other, 1] + cy) - oy) * ey + (0.5 * (data[other, 2] + cz) - oz) * ez
            )
            t = gap / nearing
            # Through an edge, where three cells meet or more, into the one that comes nearest fastest.
            if t < first or (t == first and nearing > steepest):
                first = t
                steepest = nearing
                target = other
        elif other < node and ex == 0.0 and ey == 0.0 and ez == 0.0:
            return -math.inf, other
    return first, target


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def facets(data, node):
    return data.shape[0]


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    """Whether the whole box lies more than `dilation` beyond the half-space between node and node `facet`.

    The margin for rounding grows with the square of distances, as that of `owner` does: of two centroids
    closer to each other than the last digit of their distance from a point, either may own the point.
    """
    cx, cy, cz = data[node, 0], data[node, 1], data[node, 2]
    ex = data[facet, 0] - cx
    ey = data[facet, 1] - cy
    ez = data[facet, 2] - cz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    if length == 0.0:
        return facet < node
    mx = 0.5 * (data[facet, 0] + cx)
    my = 0.5 * (data[facet, 1] + cy)
    mz = 0.5 * (data[facet, 2] + cz)
    beyond = least_along(ex, ey, ez, lx - mx, ly - my, lz - mz, hx - mx, hy - my, hz - mz)
    far_x = max(abs(lx - cx), abs(hx - cx)) + abs(ex)
    far_y = max(abs(ly - cy), abs(hy - cy)) + abs(ey)
    far_z = max(abs(lz - cz), abs(hz - cz)) + abs(ez)
    margin = far_x * far_x + far_y * far_y + far_z * far_z + reach_along(ex, ey, ez, mx, my, mz)
    return beyond > dilation * length * (1.0 + ROUNDING) + ROUNDING * margin
