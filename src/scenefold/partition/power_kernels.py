"""Power cells, compiled: a point belongs to the least (x - c)^2 - w (Laguerre cells; specs/06-cells.md).

`data` is f64[N, 4], centroid and weight of each node. Along a line all these powers are parabolas of one width,
so two of them are equal at one point at most: cells are convex, and are bounded by planes across the lines that
connect centroids, as Voronoi cells are. With equal weights they are those.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from scenefold.partition.box_kernels import ROUNDING, least_along, reach_along


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner(data, x, y, z, dx, dy, dz):
    """Node of the least power at x, y, z; of equal ones that of the least a little further along d, then the lowest."""
    best = 0
    least = math.inf
    for node in range(data.shape[0]):
        ex = x - data[node, 0]
        ey = y - data[node, 1]
        ez = z - data[node, 2]
        power = ex * ex + ey * ey + ez * ez - data[node, 3]
        if power < least:
            best = node
            least = power
        elif power == least:
            nearing = dx * (data[node, 0] - data[best, 0]) + dy * (data[node, 1] - data[best, 1]) + dz * (data[node, 2] - data[best, 2])
            if nearing > 0.0:
                best = node
    return best


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _is_hidden(data, node, other):
    """Of two nodes with one centroid: whether `other` has the greater weight, or the same and the lower number."""
    return data[other, 3] > data[node, 3] or (data[other, 3] == data[node, 3] and other < node)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave(data, node, ox, oy, oz, dx, dy, dz):
    """Where the line o + t d leaves the node's cell for good, and into whose: (t, node), (inf, -1) if nowhere.

    A cell that is empty, because another node hides it on the same centroid, is left at t = -inf.
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
            gap = (
                (0.5 * (data[other, 0] + cx) - ox) * ex + (0.5 * (data[other, 1] + cy) - oy) * ey + (0.5 * (data[other, 2] + cz) - oz) * ez
            ) - 0.5 * (data[other, 3] - data[node, 3])
            t = gap / nearing
            if t < first or (t == first and nearing > steepest):
                first = t
                steepest = nearing
                target = other
        elif other != node and ex == 0.0 and ey == 0.0 and ez == 0.0 and _is_hidden(data, node, other):
            return -math.inf, other
    return first, target


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def facets(data, node):
    return data.shape[0]


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    """Whether the whole box lies more than `dilation` beyond the half-space between node and node `facet`.

    The margin for rounding is that of Voronoi cells and of both weights: far away they have no digits left.
    """
    if facet == node:
        return False
    cx, cy, cz = data[node, 0], data[node, 1], data[node, 2]
    ex = data[facet, 0] - cx
    ey = data[facet, 1] - cy
    ez = data[facet, 2] - cz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    lead = 0.5 * (data[facet, 3] - data[node, 3])
    if length == 0.0 and facet < node and lead >= 0.0:
        return True
    mx = 0.5 * (data[facet, 0] + cx)
    my = 0.5 * (data[facet, 1] + cy)
    mz = 0.5 * (data[facet, 2] + cz)
    beyond = least_along(ex, ey, ez, lx - mx, ly - my, lz - mz, hx - mx, hy - my, hz - mz) + lead
    far_x = max(abs(lx - cx), abs(hx - cx)) + abs(ex) + dilation
    far_y = max(abs(ly - cy), abs(hy - cy)) + abs(ey) + dilation
    far_z = max(abs(lz - cz), abs(hz - cz)) + abs(ez) + dilation
    margin = far_x * far_x + far_y * far_y + far_z * far_z + reach_along(ex, ey, ez, mx, my, mz)
    margin += abs(data[facet, 3]) + abs(data[node, 3])
    return beyond > dilation * length * (1.0 + ROUNDING) + ROUNDING * margin
