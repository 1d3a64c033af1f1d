"""What every reader of scene files hands over: meshes, where they stand, and all that they need.

Readers check what the file says (indices, finiteness, sizes) before they build these values; planning
(plan.py) then only computes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.environment import Environment
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """Triangles of one material in the mesh's own space. All corners index vertices; positions are finite."""

    positions: NDArray[np.float32]
    normals: NDArray[np.float32] | None
    uvs: NDArray[np.float32] | None
    triangles: NDArray[np.uint32]
    material: int
    uvs2: NDArray[np.float32] | None = None
    """f32[nv, 2], for textures that read a second set of coordinates."""
    colors: NDArray[np.float32] | None = None
    """f32[nv, 4] within 0 to 1, linear."""
    tangents: NDArray[np.float32] | None = None
    """f32[nv, 4]: vectors that are not 0, and a sign."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceTexture:
    """An image as a material uses it; `pixels()` decodes it anew, so that one at a time is in memory."""

    name: str
    width: int
    height: int
    srgb: bool
    has_alpha: bool
    pixels: Callable[[], Pixels]


@dataclass(frozen=True, slots=True, eq=False)
class SourceScene:
    name: str
    """The file's name, for the scene document."""
    meshes: list[list[MeshPart]]
    placed_meshes: NDArray[np.int64]
    """i64[np]: the mesh of each placement."""
    placed_matrices: NDArray[np.float64]
    """f64[np, 4, 4], mesh -> world."""
    materials: list[Material]
    textures: list[SourceTexture] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    punctual: list[PunctualLight] = field(default_factory=list)
    not_carried: list[str] = field(default_factory=list)
    as_instances: NDArray[np.bool_] | None = None
    """bool[np]: placements that the file itself calls instances, which stay instances however small. None: there is none."""
    environment: Environment = field(default_factory=Environment)
    """What lies infinitely far; usually nothing."""


class NotCarried:
    """Counts what an importer leaves behind, and says it in words, in one order."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def note(self, what: str, count: int = 1) -> None:
        """`count` more of `what`, for example "normal maps"."""
        if count:
            self._counts[what] = self._counts.get(what, 0) + count

    def lines(self) -> list[str]:
        return [f"{what} ({count})" for what, count in sorted(self._counts.items())]
