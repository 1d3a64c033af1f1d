"""What the vertices of a glTF primitive have beside their places: normals, coordinates, colours and tangents.

Only what a material makes use of is read: coordinates that no texture reads would only make atoms larger.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_materials import GltfMaterials
from scenefold.scene.importers.gltf_vertices import Vertices
from scenefold.scene.importers.repair import mend_colors, mend_normals, mend_tangents, mend_uvs
from scenefold.scene.importers.source import MeshPart, NotCarried
from scenefold.scene.payloads.materials import AlphaMode

_KNOWN = re.compile(r"(POSITION|NORMAL|TANGENT|COLOR_0|(TEXCOORD|JOINTS|WEIGHTS)_\d+)$")
"""Joints and weights are said with the skin; coordinates that no texture reads are no loss."""
_NAME_LETTERS_MAX = 40


class GltfAttributes:
    """Reads the attributes of one file's primitives."""

    def __init__(self, accessors: Accessors, materials: GltfMaterials, left: NotCarried) -> None:
        self._accessors = accessors
        self._materials = materials
        self._left = left

    def dressed(self, part: MeshPart, attributes: JsonMap, vertices: Vertices) -> MeshPart:
        """A part of bare triangles over these vertices with all that its material makes use of."""
        for name in attributes.keys():  # noqa: SIM118, a JsonMap is no dict
            if not _KNOWN.match(name):
                self._left.note(f"the vertex attribute {name[:_NAME_LETTERS_MAX]}")
        material = self._materials.materials[part.material]
        sets = [self._uvs(attributes, part.material, place, vertices) for place in (0, 1)]
        normals = self._read(attributes, "NORMAL", "VEC3", vertices)
        bent = material.normal_texture is not None or material.clearcoat_normal_texture is not None
        return replace(
            part,
            normals=normals,
            uvs=sets[0],
            uvs2=sets[1],
            colors=self._colors(attributes, vertices),
            tangents=self._read(attributes, "TANGENT", "VEC4", vertices) if bent and normals is not None else None,
        )

    def mended(self, part: MeshPart) -> MeshPart:
        """The part with what is no normal, coordinate, colour or tangent made good and counted."""
        for mend in (mend_normals, mend_uvs, mend_colors, mend_tangents):
            part = mend(part, self._left)
        hides = self._materials.materials[part.material].alpha_mode != AlphaMode.OPAQUE
        if hides and part.colors is not None and bool((part.colors[:, 3] < 1).any()):
            self._materials.let_vertices_hide(part.material)
        return part

    def _read(self, attributes: JsonMap, name: str, kind: str, vertices: Vertices) -> NDArray[np.float32] | None:
        where = self._accessors.of_vertices(attributes, name, vertices)
        return None if where < 0 else self._accessors.floats(where, kind, vertices.rows)

    def _uvs(self, attributes: JsonMap, material: int, place: int, vertices: Vertices) -> NDArray[np.float32] | None:
        sets = self._materials.coordinates[material]
        if place >= len(sets):
            return None
        uvs = self._read(attributes, f"TEXCOORD_{sets[place].number}", "VEC2", vertices)
        if uvs is None:
            self._left.note("textures on meshes without texture coordinates")
            return None
        return sets[place].apply(uvs)

    def _colors(self, attributes: JsonMap, vertices: Vertices) -> NDArray[np.float32] | None:
        where = self._accessors.of_vertices(attributes, "COLOR_0", vertices)
        if where < 0:
            return None
        values = self._accessors.shares(where, ("VEC3", "VEC4"), vertices.rows)
        if values.shape[1] == 4:
            return values
        return np.concatenate([values, np.ones((len(vertices), 1), np.float32)], axis=1)
