"""What a node makes of its mesh: as it lies in the file, with morph targets added, bent by a skin, or both in this order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.deforming import Target, morphed, skinned
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_skins import GltfSkins
from scenefold.scene.importers.gltf_vertices import Vertices
from scenefold.scene.importers.matrices import Matrix
from scenefold.scene.importers.source import MeshPart, NotCarried

_MORPHED_MAX = 200_000_000
"""Vertices times targets in a file: more take minutes."""
_MORPHS = ("POSITION", "NORMAL", "TANGENT")
_NAME_LETTERS_MAX = 40


@dataclass(frozen=True, slots=True, order=True)
class Shape:
    """A mesh as a node shows it; nodes with equal shapes share their triangles."""

    mesh: int
    weights: tuple[float, ...] = ()
    """Of the morph targets; empty if none of them counts."""
    skin: int = -1
    node: int = -1
    """The node that the skin bends it for; -1 without a skin."""

    @property
    def is_own(self) -> bool:
        """Whether it is made for the occasion, and not as it lies in the file."""
        return self.skin >= 0 or bool(self.weights)


class GltfShapes:
    """Bends the parts of one file's meshes."""

    def __init__(self, file: GltfFile, accessors: Accessors, worlds: Mapping[int, Matrix], left: NotCarried) -> None:
        self._accessors = accessors
        self._skins = GltfSkins(file, accessors, worlds, left)
        self._worlds = worlds
        self._left = left
        self._morphed = 0

    def can_bend(self, skin: int) -> bool:
        """Whether the scene shows all joints of a skin."""
        return self._skins.joints(skin) is not None

    def shaped(self, part: MeshPart, primitive: JsonMap, vertices: Vertices, shape: Shape) -> MeshPart:
        """A part, which has these vertices of its primitive in their order, in this shape; in world space under a skin."""
        if shape.weights:
            part = morphed(part, self._targets(primitive, vertices, shape.weights))
        joints = self._skins.joints(shape.skin) if shape.skin >= 0 else None
        if joints is None:
            return part
        influences = self._skins.influences(primitive.inner("attributes"), vertices, len(joints))
        return skinned(part, influences, joints, self._worlds[shape.node])

    def _targets(self, primitive: JsonMap, vertices: Vertices, weights: tuple[float, ...]) -> list[Target]:
        entries = primitive.maps("targets")
        if entries and len(entries) != len(weights):
            raise primitive.fault(f"has {len(entries)} morph targets, but {len(weights)} weights", "targets")
        result = []
        for entry, weight in zip(entries, weights, strict=False):
            for name in entry.keys():  # noqa: SIM118, a JsonMap is no dict
                if name not in _MORPHS:
                    self._left.note(f"the morph attribute {name[:_NAME_LETTERS_MAX]}")
            if weight != 0.0:
                self._morphed += len(vertices)
                if self._morphed > _MORPHED_MAX:
                    raise primitive.fault(f"brings the file to more than {_MORPHED_MAX} morphed vertices", "targets")
                result.append(Target(weight, *(self._deltas(entry, name, vertices) for name in _MORPHS)))
        return result

    def _deltas(self, target: JsonMap, name: str, vertices: Vertices) -> NDArray[np.float32] | None:
        where = self._accessors.of_vertices(target, name, vertices)
        return None if where < 0 else self._accessors.floats(where, "VEC3", vertices.rows)
