"""Small repairs that a mesh gets when it is read: unused vertices, corners, normals and coordinates that are none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.matrices import move_vectors
from scenefold.scene.importers.source import MeshPart, NotCarried


def compact(part: MeshPart) -> MeshPart:
    """Without the vertices that no triangle uses: files share one large array among many primitives."""
    used = used_vertices(part)
    if used.all():
        return part
    new_number = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    arrays = {name: getattr(part, name) for name in ("positions", "normals", "uvs", "uvs2", "colors", "tangents")}
    kept: dict[str, Any] = {name: None if array is None else array[used] for name, array in arrays.items()}
    return replace(part, **kept, triangles=new_number[part.triangles])


def drop_lost_triangles(part: MeshPart, left: NotCarried) -> MeshPart:
    """Without the triangles that have a corner whose position is not finite: where they would lie, nobody can say."""
    finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(part.positions), axis=1)
    if finite.all():
        return part
    whole: NDArray[np.bool_] = np.logical_and.reduce(finite[part.triangles], axis=1)
    left.note("triangles with a corner that is not finite, left out", int(len(whole) - np.count_nonzero(whole)))
    return replace(part, triangles=part.triangles[whole])


def used_vertices(part: MeshPart) -> NDArray[np.bool_]:
    """bool[nv]: what `compact` keeps."""
    used = np.zeros(len(part.positions), bool)
    used[part.triangles.ravel()] = True
    return used


def mend_normals(part: MeshPart, left: NotCarried) -> MeshPart:
    """A normal that is 0 or not finite becomes that of the faces around it."""
    if part.normals is None:
        return part
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.abs(part.normals).sum(axis=1)
        bad = ~((sizes > 1e-12) & (sizes < 1e12))
    if not bad.any():
        return part
    left.note("normals that were none, made anew", int(bad.sum()))
    normals = np.array(part.normals)
    normals[bad] = _vertex_normals(part)[bad]
    return replace(part, normals=normals)


def face_crosses(positions: NDArray[np.floating], triangles: NDArray[np.uint32]) -> NDArray[np.float64]:
    """f64[nt, 3]: the cross product of two edges, twice the area long, outwards."""
    corners = positions.astype(np.float64)[triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.cross(first, second)


def _vertex_normals(part: MeshPart) -> NDArray[np.float32]:
    crosses = face_crosses(part.positions, part.triangles)
    sums = np.zeros((len(part.positions), 3))
    for axis in range(3):
        weights = np.repeat(crosses[:, axis], 3)
        sums[:, axis] = np.bincount(part.triangles.ravel(), weights, len(part.positions))
    lengths = np.sqrt((sums**2).sum(axis=1))
    # Where faces cancel out, any unit vector is as good.
    sums[lengths < 1e-30] = (0.0, 0.0, 1.0)
    lengths[lengths < 1e-30] = 1.0
    normals: NDArray[np.float32] = (sums / lengths[:, None]).astype(np.float32)
    return normals


def mend_uvs(part: MeshPart, left: NotCarried) -> MeshPart:
    """Texture coordinates that are not finite become 0."""
    mended: dict[str, Any] = {}
    for name in ("uvs", "uvs2"):
        uvs = getattr(part, name)
        if uvs is not None and not np.isfinite(uvs).all():
            left.note("meshes with texture coordinates that were not finite")
            mended[name] = np.where(np.isfinite(uvs), uvs, np.float32(0))
    return replace(part, **mended) if mended else part


def mend_colors(part: MeshPart, left: NotCarried) -> MeshPart:
    """Vertex colours outside 0 to 1 are moved there, and what is not finite becomes 1. White ones, which change nothing, go."""
    colors = part.colors
    if colors is None:
        return part
    bad = ~((colors >= 0) & (colors <= 1)).all(axis=1)
    if bad.any():
        left.note("vertex colours outside 0 to 1, moved to its end", int(bad.sum()))
        colors = np.where(np.isfinite(colors), np.clip(colors, 0, 1), 1).astype(np.float32)
    return replace(part, colors=None if (colors == 1).all() else colors)


def mend_tangents(part: MeshPart, left: NotCarried) -> MeshPart:
    """Where a tangent is 0, or not finite, the mesh does without: they follow from the texture coordinates."""
    if part.tangents is None:
        return part
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.abs(part.tangents[:, :3]).sum(axis=1)
        good = (sizes > 1e-12) & (sizes < 1e12) & np.isfinite(part.tangents[:, 3])
    if good.all():
        return part
    left.note("meshes with tangents that were none")
    return replace(part, tangents=None)


def move_normals(cofactor: NDArray[np.float64], mirrored: bool, normals: NDArray[np.floating]) -> NDArray[np.float64]:
    """Normals (of any length) under a transform with these cofactors; outside stays outside."""
    # The inverse transpose is the cofactors over the determinant; lengths do not matter, its sign does.
    return move_vectors(-cofactor if mirrored else cofactor, normals)
