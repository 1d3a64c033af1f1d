"""Runs: the triangles of one prototype that have the same attributes, walked along the Hilbert curve.

Triangles with and without normals, texture coordinates and the like stay apart, so that no atom pays for
attributes that it does not have, and all atoms of a group have the same. Memory: about 60 bytes a triangle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import TRIANGLE_DOUBLE_AREA_MIN
from scenefold.scene.importers.matrices import Matrix, cofactors, determinant, move_points, move_vectors
from scenefold.scene.importers.repair import face_crosses, move_normals
from scenefold.scene.importers.source import MeshPart
from scenefold.scene.payloads.vertex_attributes import (
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UVS,
    HAS_UVS2,
    VertexAttributes,
    encode_colors,
    encode_normals,
    encode_tangents,
)

_ORDER = (HAS_NORMALS, HAS_UVS, HAS_UVS2, HAS_COLORS, HAS_TANGENTS)
"""Runs without the first come first, and so on."""
_BLOCK = 1 << 18
"""Triangles at a time where f64 intermediates are needed."""


@dataclass(slots=True, eq=False)
class Run:
    prototype: int
    positions: NDArray[np.float32]
    attributes: VertexAttributes
    triangles: NDArray[np.uint32]
    materials: NDArray[np.uint16]

    def box(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Low and high corner of what the triangles use."""
        used = self.positions[self.triangles.ravel()]
        return used.min(axis=0), used.max(axis=0)


def make_runs(prototype: int, parts: Iterable[tuple[MeshPart, Matrix | None]]) -> tuple[list[Run], int]:
    """The runs of a prototype, one for each set of attributes, and the number of triangles without area that were dropped."""
    kinds: dict[tuple[bool, ...], list[Run]] = {}
    dropped = 0
    for part, matrix in parts:
        baked = _bake(prototype, part, matrix)
        dropped += len(part.triangles) - len(baked.triangles)
        if len(baked.triangles):
            flags = baked.attributes.flags
            kinds.setdefault(tuple(bool(flags & flag) for flag in _ORDER), []).append(baked)
    return [_along_curve(_joined(kinds.pop(kind))) for kind in sorted(kinds)], dropped


def _bake(prototype: int, part: MeshPart, matrix: Matrix | None) -> Run:
    positions, triangles = part.positions, part.triangles
    normals: NDArray[np.floating] | None = part.normals
    tangents: NDArray[np.floating] | None = part.tangents
    if matrix is not None:
        mirrored = determinant(matrix) < 0
        positions = move_points(matrix, positions).astype(np.float32)
        # A mirror turns triangles inside out; exchanging two corners turns them back.
        triangles = triangles[:, [0, 2, 1]] if mirrored else triangles
        # A flat scale leaves some normals and tangents without direction.
        if normals is not None:
            normals = _never_zero(move_normals(cofactors(matrix), mirrored, normals), (0.0, 0.0, 1.0))
        if tangents is not None:
            signs = tangents[:, 3:] * (-1.0 if mirrored else 1.0)
            moved = _never_zero(move_vectors(matrix[:3, :3], tangents[:, :3]), (1.0, 0.0, 0.0))
            tangents = np.concatenate([moved, signs], axis=1)
    attributes = VertexAttributes(
        normals=None if normals is None else encode_normals(normals),
        uvs=part.uvs,
        uvs2=part.uvs2,
        colors=None if part.colors is None else encode_colors(part.colors),
        tangents=None if tangents is None else encode_tangents(tangents),
    )
    whole = _with_area(positions, triangles)
    if not whole.all():
        triangles = triangles[whole]
    return Run(prototype, positions, attributes, triangles, np.full(len(triangles), part.material, np.uint16))


def _never_zero(vectors: NDArray[np.float64], instead: tuple[float, float, float]) -> NDArray[np.float64]:
    vectors[np.abs(vectors).sum(axis=1) < 1e-300] = instead
    return vectors


def _with_area(positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> NDArray[np.bool_]:
    whole = np.empty(len(triangles), bool)
    for start in range(0, len(triangles), _BLOCK):
        crosses = face_crosses(positions, triangles[start : start + _BLOCK])
        whole[start : start + _BLOCK] = (crosses**2).sum(axis=1) > TRIANGLE_DOUBLE_AREA_MIN**2
    return whole


def _joined(pieces: list[Run]) -> Run:
    if len(pieces) == 1:
        return pieces[0]
    before = np.cumsum([0] + [len(piece.positions) for piece in pieces])
    joined = Run(
        pieces[0].prototype,
        np.concatenate([piece.positions for piece in pieces]),
        VertexAttributes.joined([piece.attributes for piece in pieces]),
        np.concatenate([piece.triangles + np.uint32(start) for piece, start in zip(pieces, before[:-1], strict=True)]),
        np.concatenate([piece.materials for piece in pieces]),
    )
    pieces.clear()
    return joined


def _along_curve(run: Run) -> Run:
    """The run with its triangles in Hilbert order of their centres; equal places keep the file's order."""
    # Late: the curves load numba.
    from scenefold.curve import Curve, Lattice

    low, high = (corner.astype(np.float64) for corner in run.box())
    side = max(float((high - low).max()), 1e-30) * 1.001
    middle = (low + high) / 2
    curve = Curve("hilbert", 3)
    lattice = Lattice(curve, middle - side / 2, middle + side / 2)
    keys = np.empty(len(run.triangles), np.uint64)
    for start in range(0, len(keys), _BLOCK):
        centres = run.positions[run.triangles[start : start + _BLOCK]].astype(np.float64).mean(axis=1)
        locations = curve.encode(lattice.cells(centres))
        # 64 of the 160 bits tell 21 bits an axis apart, far below a triangle's size.
        letters = locations.view(np.uint8).reshape(len(centres), -1)
        keys[start : start + _BLOCK] = np.ascontiguousarray(letters[:, :8]).view(">u8")[:, 0]
    order = np.argsort(keys, kind="stable")
    run.triangles = run.triangles[order]
    run.materials = run.materials[order]
    return run
