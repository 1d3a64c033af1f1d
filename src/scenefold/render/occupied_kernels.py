"""Which voxels of the job's box a node's triangles lie in, in loops over arrays, compiled (specs/28-rebalancing.md, Empty space)."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.partition.empty_walk_kernels import mark_box

_CUTS_MAX = 128
"""Of a triangle's edges: it spans 64 voxels at most, unless it lies outside of the box."""


@njit(error_model="numpy", _nrt=False)
def _voxels_along(p, a, b, per_voxel):
    """Of the edge between two corners of p f64[3, 3]: how many parts of a voxel at most it has."""
    longest = 0.0
    for axis in range(3):
        longest = max(longest, abs(p[b, axis] - p[a, axis]) * per_voxel[axis])
    return int(min(max(math.ceil(longest), 1.0), float(_CUTS_MAX)))


@njit(error_model="numpy", _nrt=False)
def _mark_triangle(occupied, low, per_voxel, p, dilation):
    """p f64[3, 3]: its corners. It is cut along its two shorter edges into pieces of about a voxel, and the box of each piece counts."""
    n01, n12, n20 = _voxels_along(p, 0, 1, per_voxel), _voxels_along(p, 1, 2, per_voxel), _voxels_along(p, 2, 0, per_voxel)
    # From the corner across from the longest edge.
    a = 2 if n01 >= n12 and n01 >= n20 else 0 if n12 >= n20 else 1
    b, c = (a + 1) % 3, (a + 2) % 3
    cuts_u, cuts_v = _voxels_along(p, a, b, per_voxel), _voxels_along(p, a, c, per_voxel)
    x0, y0, z0 = p[a, 0], p[a, 1], p[a, 2]
    ux, uy, uz = (p[b, 0] - x0) / cuts_u, (p[b, 1] - y0) / cuts_u, (p[b, 2] - z0) / cuts_u
    vx, vy, vz = (p[c, 0] - x0) / cuts_v, (p[c, 1] - y0) / cuts_v, (p[c, 2] - z0) / cuts_v
    for i in range(cuts_u):
        # Of the last parallelogram of a row a part lies beyond the long edge.
        for j in range(int(math.ceil((1.0 - i / cuts_u) * cuts_v))):
            ax, ay, az = x0 + i * ux + j * vx, y0 + i * uy + j * vy, z0 + i * uz + j * vz
            bx, by, bz = ax + ux, ay + uy, az + uz
            cx, cy, cz = ax + vx, ay + vy, az + vz
            dx, dy, dz = bx + vx, by + vy, bz + vz
            lx, hx = min(min(ax, bx), min(cx, dx)), max(max(ax, bx), max(cx, dx))
            ly, hy = min(min(ay, by), min(cy, dy)), max(max(ay, by), max(cy, dy))
            lz, hz = min(min(az, bz), min(cz, dz)), max(max(az, bz), max(cz, dz))
            mark_box(occupied, low, per_voxel, lx - dilation, ly - dilation, lz - dilation, hx + dilation, hy + dilation, hz + dilation)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark_triangles(occupied, low, per_voxel, vertices, triangles, first, counts, matrices, dilations, corners):
    """Set the voxels that the triangles of pairs of an instance and a group meet, grown by the pair's dilation, f64[k] >= 0.

    occupied uint8[64, 64, 64], low and per_voxel f64[3]: see `mark_box`. vertices f32[n, 3] in the space of prototypes, triangles
    uint32[m, 3]. Of each pair: first and counts int64[k], its triangles, and matrices f64[k, 3, 4] to the world. To work in: corners f64[3, 3].
    """
    for pair in range(first.shape[0]):
        for triangle in range(first[pair], first[pair] + counts[pair]):
            for corner in range(3):
                vertex = triangles[triangle, corner]
                x, y, z = np.float64(vertices[vertex, 0]), np.float64(vertices[vertex, 1]), np.float64(vertices[vertex, 2])
                for axis in range(3):
                    row = matrices[pair, axis]
                    corners[corner, axis] = row[0] * x + row[1] * y + row[2] * z + row[3]
            _mark_triangle(occupied, low, per_voxel, corners, dilations[pair])
