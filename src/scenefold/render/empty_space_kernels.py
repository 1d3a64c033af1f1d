"""Marking where the triangles of a node are, compiled (specs/32-empty-space.md)."""

from __future__ import annotations

import numpy as np
from numba import njit

from scenefold.partition.occupancy_kernels import SLACK, mark_triangle


@njit(nogil=True, cache=True, error_model="numpy")
def mark_pairs(grids, low, per_voxel, shift, dilation, vertices, triangles, matrices, pairs):  # type: ignore[no-untyped-def]
    """Set the voxels that triangles come near to, in the world.

    grids uint64[g, 128, 128, 2], which begin shift[g] voxels below low f64[3]; vertices float32[v, 3]; triangles uint32[t, 3]; matrices f64[i, 3, 4];
    pairs int64[m, 3]: an instance, a first triangle, and how many there are. All is grown by `dilation` in the world.
    """
    corners = np.empty((3, 3))
    placed = np.empty((3, 3))
    gx, gy, gz = dilation * per_voxel[0] + SLACK, dilation * per_voxel[1] + SLACK, dilation * per_voxel[2] + SLACK
    for pair in range(pairs.shape[0]):
        matrix = matrices[pairs[pair, 0]]
        for triangle in range(pairs[pair, 1], pairs[pair, 1] + pairs[pair, 2]):
            for corner in range(3):
                vertex = np.int64(triangles[triangle, corner])
                x, y, z = np.float64(vertices[vertex, 0]), np.float64(vertices[vertex, 1]), np.float64(vertices[vertex, 2])
                for axis in range(3):
                    at = matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z + matrix[axis, 3]
                    placed[corner, axis] = (at - low[axis]) * per_voxel[axis]
            for grid in range(grids.shape[0]):
                for corner in range(3):
                    for axis in range(3):
                        corners[corner, axis] = placed[corner, axis] + shift[grid]
                mark_triangle(grids[grid], corners, gx, gy, gz)
