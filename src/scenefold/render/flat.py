"""What a node holds as one list of triangles in the world's space, for renderers that know no groups and no instances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import F32, U16, U32, SceneArrays
from scenefold.render.contract import HeldScene

FLAT_TRIANGLES_MAX = 20_000_000
"""Some 2.5 GiB."""


class FlatTriangles(NamedTuple):
    """Corners stand in the order in which the front is seen counter-clockwise, mirrored instances included."""

    positions: F32
    """[n, 3, 3]"""
    normals: F32
    """[n, 3, 3], unit; zero where the file has none."""
    uvs: F32
    """[n, 3, 2]"""
    materials: U16
    """[n]"""
    uvs2: F32
    """[n, 3, 2]"""
    colors: F32
    """[n, 3, 4]; 1 where the file has none."""


def flat_triangles(held: HeldScene) -> FlatTriangles:
    """All triangles of all instances; LocalFault if there are too many to have each by itself."""
    arrays = held.arrays
    pieces: list[FlatTriangles] = []
    total = 0
    for instance, prototype in ((0, 0), *held.instances):
        for group in held.groups:
            if group.prototype == prototype:
                total += group.triangles
                if total > FLAT_TRIANGLES_MAX:
                    raise LocalFault(
                        f"the scene has more than {FLAT_TRIANGLES_MAX:,} triangles with its instances",
                        remedy="choose a renderer that keeps instances, as embree",
                    )
                first = int(arrays.group_first[group.group])
                rows = slice(first, first + group.triangles)
                pieces.append(_in_world(arrays, arrays.triangles[rows], arrays.triangle_material[rows], instance))
    if not pieces:
        pieces.append(_in_world(arrays, arrays.triangles[:0], arrays.triangle_material[:0], 0))
    return FlatTriangles(*(np.concatenate(columns) for columns in zip(*pieces, strict=True)))


def _in_world(arrays: SceneArrays, triangles: U32, materials: U16, instance: int) -> FlatTriangles:
    positions, normals, uvs = arrays.vertices[triangles], arrays.normals[triangles], arrays.uvs[triangles]
    uvs2 = arrays.uvs2[triangles] if arrays.has_uvs2 else np.zeros_like(uvs)
    colors = arrays.colors[triangles] if arrays.has_colors else np.ones((*triangles.shape, 4), np.float32)
    if instance == 0:
        return FlatTriangles(positions, normals, uvs, materials, uvs2, colors)
    matrix = arrays.instance_matrices[instance]
    turn = matrix[:, :3]
    placed = positions.astype(np.float64) @ turn.T + matrix[:, 3]
    turned = normals.astype(np.float64) @ np.linalg.inv(turn)
    lengths = np.sqrt((turned**2).sum(axis=2, keepdims=True))
    turned = np.where(lengths > 0, turned / np.maximum(lengths, 1e-300), 0.0)
    # A mirror turns the winding, and the front stays the front (glTF 2.0, 3.7.4).
    order = [2, 1, 0] if np.linalg.det(turn) < 0 else [0, 1, 2]
    return FlatTriangles(
        placed[:, order].astype(np.float32), turned[:, order].astype(np.float32), uvs[:, order], materials, uvs2[:, order], colors[:, order]
    )
