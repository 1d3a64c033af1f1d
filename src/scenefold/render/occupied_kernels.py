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
def _mark_triangle(occupied, low, per_voxel, p, dilation):
    """p f64[3, 3]: its corners. It is cut into pieces of about a voxel, and the box of each piece counts."""
    longest = 0.0
    for axis in range(3):
        side = max(p[0, axis], max(p[1, axis], p[2, axis])) - min(p[0, axis], min(p[1, axis], p[2, axis]))
        longest = max(longest, side * per_voxel[axis])
    cuts = int(min(max(math.ceil(longest), 1.0), float(_CUTS_MAX)))
    x0, y0, z0 = p[0, 0], p[0, 1], p[0, 2]
    ux, uy, uz = (p[1, 0] - x0) / cuts, (p[1, 1] - y0) / cuts, (p[1, 2] - z0) / cuts
    vx, vy, vz = (p[2, 0] - x0) / cuts, (p[2, 1] - y0) / cuts, (p[2, 2] - z0) / cuts
    for i in range(cuts):
        for j in range(cuts - i):
            # Two triangles that are a parallelogram; at the long edge only the first of them, whose box is the same or less.
            ax, ay, az = x0 + i * ux + j * vx, y0 + i * uy + j * vy, z0 + i * uz + j * vz
            bx, by, bz = ax + ux, ay + uy, az + uz
            cx, cy, cz = ax + vx, ay + vy, az + vz
            lx, hx = min(ax, min(bx, cx)), max(ax, max(bx, cx))
            ly, hy = min(ay, min(by, cy)), max(ay, max(by, cy))
            lz, hz = min(az, min(bz, cz)), max(az, max(bz, cz))
            if j < cuts - i - 1:
                dx, dy, dz = bx + vx, by + vy, bz + vz
                lx, hx, ly, hy, lz, hz = min(lx, dx), max(hx, dx), min(ly, dy), max(hy, dy), min(lz, dz), max(hz, dz)
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
