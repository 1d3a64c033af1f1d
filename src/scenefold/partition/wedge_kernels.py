"""Wedges, compiled: sectors around an axis (Radial, Bounded radial; thesis 3.3.7, specs/06-cells.md).

`data` is f64[N + 3, 3]:

    row 0      a point of the axis
    row 1      unit vector towards bound 0, across the axis
    row 2      unit vector a quarter turn on, in the direction in which bounds are counted
    row 3 + b  cosine and sine of bound b's angle, b = 0 .. N-1 (the third number is unused); bound 0: 1, 0

Node b's cell runs from bound b to bound b + 1 and is at most half a turn wide, so it is the intersection of two
half-spaces, and side-of-a-bound tests decide everything: no angle of a point is ever computed.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from scenefold.partition.box_kernels import ROUNDING, least_along

HEAD_ROWS = 3


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _sector(data, x, y, dx, dy):
    """Node at x, y of the plane across the axis; on a hull that of a point slightly along d, else the lowest.

    Counts, by bisection, the bounds 1 .. N-1 that lie strictly behind the point in the direction of counting.
    """
    height = y if y != 0.0 else dy
    if height == 0.0 and (x if x != 0.0 else dx) >= 0.0:
        return 0
    low = 0
    high = data.shape[0] - HEAD_ROWS - 1
    while low < high:
        bound = (low + high + 1) // 2
        cosine = data[HEAD_ROWS + bound, 0]
        sine = data[HEAD_ROWS + bound, 1]
        side = cosine * y - sine * x
        if side == 0.0:
            side = cosine * dy - sine * dx
        if height > 0.0:
            behind = sine > 0.0 and side > 0.0
        elif height < 0.0:
            behind = sine >= 0.0 or side > 0.0
        else:
            behind = sine > 0.0
        if behind:
            low = bound
        else:
            high = bound - 1
    return low


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner(data, x, y, z, dx, dy, dz):
    """Node whose wedge holds x, y, z; on a hull or on the axis the one a little further along d, then the lowest."""
    rx = x - data[0, 0]
    ry = y - data[0, 1]
    rz = z - data[0, 2]
    return _sector(
        data,
        rx * data[1, 0] + ry * data[1, 1] + rz * data[1, 2],
        rx * data[2, 0] + ry * data[2, 1] + rz * data[2, 2],
        dx * data[1, 0] + dy * data[1, 1] + dz * data[1, 2],
        dx * data[2, 0] + dy * data[2, 1] + dz * data[2, 2],
    )


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave(data, node, ox, oy, oz, dx, dy, dz):
    """Where the line o + t d leaves the node's wedge for good, and into whose: (t, node), (inf, -1) if nowhere."""
    nodes = data.shape[0] - HEAD_ROWS
    if nodes == 1:
        return math.inf, -1
    rx = ox - data[0, 0]
    ry = oy - data[0, 1]
    rz = oz - data[0, 2]
    x = rx * data[1, 0] + ry * data[1, 1] + rz * data[1, 2]
    y = rx * data[2, 0] + ry * data[2, 1] + rz * data[2, 2]
    u = dx * data[1, 0] + dy * data[1, 1] + dz * data[1, 2]
    v = dx * data[2, 0] + dy * data[2, 1] + dz * data[2, 2]
    row = HEAD_ROWS + node
    down = data[row, 1] * u - data[row, 0] * v
    t_down = (data[row, 0] * y - data[row, 1] * x) / down if down > 0.0 else math.inf
    row = HEAD_ROWS + (node + 1) % nodes
    up = data[row, 0] * v - data[row, 1] * u
    t_up = (data[row, 1] * x - data[row, 0] * y) / up if up > 0.0 else math.inf
    if t_down < t_up:
        return t_down, (node + nodes - 1) % nodes
    if t_up < t_down:
        return t_up, (node + 1) % nodes
    if t_up == math.inf:
        return math.inf, -1
    # Both at once: through the axis (or two cells of half a turn each, with one plane between them).
    return t_up, _sector(data, u, v, 0.0, 0.0)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def facets(data, node):
    return 3 if data.shape[0] > HEAD_ROWS + 1 else 0


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    """Whether the whole box lies more than `dilation` beyond a half-space that holds the wedge.

    Facets 0 and 1 are the wedge's bounds. Facet 2, the sum of their outward normals, cuts across the axis: a
    box opposite of a thin wedge straddles both bounds' planes, and without it every such box would count.
    """
    nodes = data.shape[0] - HEAD_ROWS
    from_cos, from_sin = data[HEAD_ROWS + node, 0], data[HEAD_ROWS + node, 1]
    upto = HEAD_ROWS + (node + 1) % nodes
    upto_cos, upto_sin = data[upto, 0], data[upto, 1]
    if facet == 0:
        along, across = from_sin, -from_cos
    elif facet == 1:
        along, across = -upto_sin, upto_cos
    else:
        along, across = from_sin - upto_sin, upto_cos - from_cos
    nx = along * data[1, 0] + across * data[2, 0]
    ny = along * data[1, 1] + across * data[2, 1]
    nz = along * data[1, 2] + across * data[2, 2]
    px, py, pz = data[0, 0], data[0, 1], data[0, 2]
    beyond = least_along(nx, ny, nz, lx - px, ly - py, lz - pz, hx - px, hy - py, hz - pz)
    margin = max(abs(lx - px), abs(hx - px)) + max(abs(ly - py), abs(hy - py)) + max(abs(lz - pz), abs(hz - pz))
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return beyond > dilation * length * (1.0 + ROUNDING) + ROUNDING * (margin + dilation)
