"""Grids of occupied voxels, compiled: marking boxes and triangles (specs/28-rebalancing.md, Empty space).

What marks is grown by `SLACK` of a voxel on every side. That is far more than all rounding here, and than what a walk (leap_kernels.py)
jumps over, so neither has to be exact.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIDE = 128
"""Voxels on each side of a grid."""
SLACK = 2.0**-10
"""Of a voxel: by how much what marks it is grown."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False, forceinline=True)
def voxel(at):
    """The index of the voxel in which a coordinate lies; of what lies outside, the outermost one's."""
    return min(max(int(math.floor(at)), 0), SIDE - 1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark(grids, low, per_voxel, shift, boxes_low, boxes_high, dilation):
    """Set the voxels of both grids, uint64[2, 128, 128, 2], that boxes f64[m, 3] grown by `dilation` meet.

    `per_voxel` f64[3] is voxels a unit; grid g begins `shift[g]` voxels below `low` f64[3]. What lies outside of a grid counts
    for its outermost voxels.
    """
    for box in range(boxes_low.shape[0]):
        for grid in range(grids.shape[0]):
            words = grids[grid]
            i0 = voxel((boxes_low[box, 0] - dilation - low[0]) * per_voxel[0] + shift[grid] - SLACK)
            i1 = voxel((boxes_high[box, 0] + dilation - low[0]) * per_voxel[0] + shift[grid] + SLACK)
            j0 = voxel((boxes_low[box, 1] - dilation - low[1]) * per_voxel[1] + shift[grid] - SLACK)
            j1 = voxel((boxes_high[box, 1] + dilation - low[1]) * per_voxel[1] + shift[grid] + SLACK)
            k0 = voxel((boxes_low[box, 2] - dilation - low[2]) * per_voxel[2] + shift[grid] - SLACK)
            k1 = voxel((boxes_high[box, 2] + dilation - low[2]) * per_voxel[2] + shift[grid] + SLACK)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    for k in range(k0, k1 + 1):
                        words[i, j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _is_beside(ax, ay, bx, by, cx, cy, turn, x, y, hx, hy):
    """Whether a rectangle around (x, y) of half sides hx, hy lies beyond an edge of a triangle in a plane, in which it has the sense of `turn`."""
    if turn == 0.0:
        return False
    sign = 1.0 if turn > 0.0 else -1.0
    for edge in range(3):
        px, py, qx, qy = (ax, ay, bx, by) if edge == 0 else (bx, by, cx, cy) if edge == 1 else (cx, cy, ax, ay)
        # Inwards, across the edge.
        nx, ny = -(qy - py) * sign, (qx - px) * sign
        if nx * (x - px) + ny * (y - py) + abs(nx) * hx + abs(ny) * hy < 0.0:
            return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def mark_triangle(words, corners, gx, gy, gz):
    """Set the voxels of one grid, uint64[128, 128, 2], that a triangle f64[3, 3], in voxels, comes nearer to than gx, gy, gz along each axis.

    By the triangle's box, its plane, and its edges seen along each axis: a voxel that lies beyond any of these is apart
    (Schwarz and Seidel, Fast parallel surface and solid voxelization on GPUs, 2010).
    """
    ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
    bx, by, bz = corners[1, 0], corners[1, 1], corners[1, 2]
    cx, cy, cz = corners[2, 0], corners[2, 1], corners[2, 2]
    i0, i1 = voxel(min(ax, min(bx, cx)) - gx), voxel(max(ax, max(bx, cx)) + gx)
    j0, j1 = voxel(min(ay, min(by, cy)) - gy), voxel(max(ay, max(by, cy)) + gy)
    k0, k1 = voxel(min(az, min(bz, cz)) - gz), voxel(max(az, max(bz, cz)) + gz)
    nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
    ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
    nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    hx, hy, hz = 0.5 + gx, 0.5 + gy, 0.5 + gz
    reach = abs(nx) * hx + abs(ny) * hy + abs(nz) * hz
    whole = (i1 - i0 + 1) * (j1 - j0 + 1) * (k1 - k0 + 1) <= 8
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if not whole and _is_beside(ax, ay, bx, by, cx, cy, nz, i + 0.5, j + 0.5, hx, hy):
                continue
            for k in range(k0, k1 + 1):
                if not whole:
                    x, y, z = i + 0.5, j + 0.5, k + 0.5
                    if abs(nx * (x - ax) + ny * (y - ay) + nz * (z - az)) > reach:
                        continue
                    if _is_beside(ay, az, by, bz, cy, cz, nx, y, z, hy, hz) or _is_beside(az, ax, bz, bx, cz, cx, ny, z, x, hz, hx):
                        continue
                words[i, j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)
