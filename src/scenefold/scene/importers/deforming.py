"""Vertices moved by joints and by morph targets, in f64, rounded to f32 once (glTF 2.0, *Skins* and *Morph targets*)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.matrices import determinants
from scenefold.scene.importers.source import MeshPart

_BLOCK = 1 << 16
"""Vertices at a time: each has a matrix of its own in between."""


@dataclass(frozen=True, slots=True, eq=False)
class Influences:
    """Which joints hold the vertices of a part, and how firmly."""

    joints: NDArray[np.int64]
    """i64[nv, k], rows of the joints' matrices."""
    weights: NDArray[np.float64]
    """f64[nv, k], not below 0; each row sums to 1, or to 0 where no joint holds the vertex."""


def skinned(part: MeshPart, influences: Influences, joints: NDArray[np.float64], unheld: NDArray[np.float64]) -> MeshPart:
    """The part in the world. `joints`: f64[nj, 4, 4], mesh -> world as each joint carries it; `unheld`: f64[4, 4] for vertices of no joint.

    What is left without direction, or overflows, is for the caller to find.
    """
    positions = np.empty((len(part.positions), 3), np.float32)
    normals = None if part.normals is None else np.empty_like(positions)
    tangents = None if part.tangents is None else np.empty((len(positions), 4), np.float32)
    mirrored = np.empty(len(positions), bool)
    with np.errstate(over="ignore", invalid="ignore"):
        for start in range(0, len(positions), _BLOCK):
            rows = slice(start, start + _BLOCK)
            matrices = _blended(influences.joints[rows], influences.weights[rows], joints, unheld)
            mirrored[rows] = determinants(matrices) < 0
            positions[rows] = _moved(matrices, part.positions[rows]) + matrices[:, :, 3]
            if normals is not None and part.normals is not None:
                normals[rows] = _moved_normals(matrices, mirrored[rows], part.normals[rows])
            if tangents is not None and part.tangents is not None:
                tangents[rows, :3] = _moved(matrices, part.tangents[rows, :3])
                tangents[rows, 3] = np.where(mirrored[rows], -part.tangents[rows, 3], part.tangents[rows, 3])
    triangles = part.triangles
    inside_out = mirrored[triangles[:, 0]]
    if inside_out.any():
        triangles = np.where(inside_out[:, None], triangles[:, [0, 2, 1]], triangles)
    return replace(part, positions=positions, normals=normals, tangents=tangents, triangles=triangles)


def _blended(
    joints: NDArray[np.int64], weights: NDArray[np.float64], matrices: NDArray[np.float64], unheld: NDArray[np.float64]
) -> NDArray[np.float64]:
    """f64[n, 3, 4], summed in the order of the influences."""
    total = np.zeros((len(joints), 3, 4))
    for column in range(joints.shape[1]):
        total += weights[:, column, None, None] * matrices[joints[:, column], :3]
    total[weights.sum(axis=1) == 0.0] = unheld[:3]
    return total


def _moved(matrices: NDArray[np.float64], vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = vectors[:, 0, None] * matrices[:, :, 0]
    for axis in (1, 2):
        moved = moved + vectors[:, axis, None] * matrices[:, :, axis]
    return moved


def _moved_normals(matrices: NDArray[np.float64], mirrored: NDArray[np.bool_], normals: NDArray[np.floating]) -> NDArray[np.float64]:
    """f64[n, 3] under the inverse transposes, the largest coordinate 1; outside stays outside."""
    moved = np.empty(normals.shape)
    for axis in range(3):
        cofactors = np.cross(matrices[:, (axis + 1) % 3, :3], matrices[:, (axis + 2) % 3, :3])
        moved[:, axis] = (cofactors * normals).sum(axis=1)
    moved[mirrored] *= -1.0
    moved /= np.maximum(np.abs(moved).max(axis=1, keepdims=True), 1e-300)
    return moved


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """What one morph target adds to the vertices of a part, at its weight."""

    weight: float
    positions: NDArray[np.float32] | None
    """f32[nv, 3], as the others; None: nothing."""
    normals: NDArray[np.float32] | None
    tangents: NDArray[np.float32] | None


def morphed(part: MeshPart, targets: Sequence[Target]) -> MeshPart:
    """The part with its targets added, in their order. What overflows is for the caller to find."""
    with np.errstate(over="ignore", invalid="ignore"):
        positions = part.positions.astype(np.float64)
        normals = None if part.normals is None else part.normals.astype(np.float64)
        tangents = None if part.tangents is None else part.tangents.astype(np.float64)
        for target in targets:
            if target.positions is not None:
                positions += target.weight * target.positions.astype(np.float64)
            if normals is not None and target.normals is not None:
                normals += target.weight * target.normals.astype(np.float64)
            if tangents is not None and target.tangents is not None:
                tangents[:, :3] += target.weight * target.tangents.astype(np.float64)
        return replace(
            part,
            positions=positions.astype(np.float32),
            normals=None if normals is None else normals.astype(np.float32),
            tangents=None if tangents is None else tangents.astype(np.float32),
        )
