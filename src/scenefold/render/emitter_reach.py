"""How far emitters reach: what the end of a shadow ray is held off by (specs/07-rays.md)."""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F32, F64
from scenefold.scene.tables import SceneTables


def emitter_reach(tables: SceneTables, matrices: F64) -> F32:
    """f32[emitters]: as `surface_kernels.reach_at` has it of a hit. `matrices`: f64[instances, 3, 4], of all instances.

    The longest edge along an axis; within an instance that, or how far the first corner lies from where the prototype is placed, in the
    prototype's space, times how much the matrix makes of that, since the caster carries rays there. All nodes get the same bits.
    """
    lights, groups = tables.lights, tables.groups
    corners = lights.corners
    reach: F32 = np.abs(corners[:, 1:] - corners[:, :1]).max(axis=(1, 2), initial=np.float32(0.0))
    placed = np.flatnonzero(lights.instances != 0)
    if not len(placed):
        return reach
    matrix, group = matrices[lights.instances[placed]], lights.groups[placed]
    local = _in_prototype(corners[placed], matrix)
    # Where an instance is as good as flat, its inverse is anything, and the corners are somewhere in their group.
    local = np.clip(local, groups.low[group].astype(np.float64)[:, None], groups.high[group].astype(np.float64)[:, None])
    far = np.maximum(np.abs(local[:, 1:] - local[:, :1]).max(axis=(1, 2)), np.abs(local[:, 0]).max(axis=1))
    sides = np.abs(matrix[:, :, :3])
    grown = ((sides[:, :, 0] + sides[:, :, 1]) + sides[:, :, 2]).max(axis=1)
    reach[placed] = np.maximum(reach[placed], (far * grown).astype(np.float32))
    return reach


def _in_prototype(corners: F32, matrix: F64) -> F64:
    """f64[n, 3, 3]: corners in the world, f32[n, 3, 3], as those of their instances' prototypes."""
    moved, a = corners.astype(np.float64) - matrix[:, None, :, 3], matrix[:, :, :3]
    cofactors = np.stack([np.cross(a[:, (row + 1) % 3], a[:, (row + 2) % 3]) for row in range(3)], axis=1)
    determinant = _sum_of_three(a[:, 0] * cofactors[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = cofactors / determinant[:, None, None]
        return np.nan_to_num(_sum_of_three(moved[:, :, :, None] * inverse[:, None, :, :], axis=2))


def _sum_of_three(values: F64, axis: int = -1) -> F64:
    """In one order, on every machine."""
    x, y, z = (np.take(values, index, axis=axis) for index in range(3))
    found: F64 = (x + y) + z
    return found
