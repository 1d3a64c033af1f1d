"""A scene for rehearsals without light: a small square in each place of a lattice, so that whoever answers for a place holds the square there.

The squares are instances of a few prototypes. So nodes of a pool hold different squares, and different groups, of a scene of a few records.
"""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F64, I64
from scenefold.scene.importers.source import MeshPart, SourceScene
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.materials import Material

SIDE = 4
SQUARES = SIDE**3
PROTOTYPES = 16
_HALF = 0.125
"""Of a square's side; places are 1 apart."""
_CORNERS = np.array([[-_HALF, -_HALF, 0.0], [_HALF, -_HALF, 0.0], [_HALF, _HALF, 0.0], [-_HALF, _HALF, 0.0]], np.float32)
_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def places_of(squares: I64) -> F64:
    """The middles of squares 0 .. SQUARES - 1, f64[n, 3]: every number is exact."""
    return np.stack([squares % SIDE, squares // SIDE % SIDE, squares // SIDE**2], axis=1).astype(np.float64) + 0.5


def squares_at(places: F64) -> I64:
    """Which square a place on one belongs to, i64[n]."""
    column, row, layer = np.floor(places).astype(np.int64).T
    squares: I64 = column + row * SIDE + layer * SIDE**2
    return squares


def lattice() -> SourceScene:
    """As a reader of files would hand it over."""
    squares = np.arange(SQUARES)
    matrices = np.tile(np.eye(4), (SQUARES, 1, 1))
    matrices[:, :3, 3] = places_of(squares)
    view = np.eye(4)
    view[:3, 3] = SIDE / 2, SIDE / 2, 3.0 * SIDE
    # No two of the prototypes are equal.
    meshes = [[MeshPart(_CORNERS * np.float32(1.0 + number / 64.0), None, None, _TRIANGLES, 0)] for number in range(PROTOTYPES)]
    return SourceScene(
        "lattice",
        meshes,
        squares % PROTOTYPES,
        matrices,
        [Material()],
        cameras=[Camera("before it", view, yfov=0.6)],
        as_instances=np.ones(SQUARES, np.bool_),
    )
