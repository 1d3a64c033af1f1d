"""Primitives of glTF meshes as triangles of one material; every index and every position is checked here."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_attributes import GltfAttributes
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_materials import GltfMaterials
from scenefold.scene.importers.gltf_shapes import GltfShapes, Shape
from scenefold.scene.importers.gltf_vertices import used_by
from scenefold.scene.importers.repair import compact, drop_lost_triangles, used_vertices
from scenefold.scene.importers.source import MeshPart, NotCarried

_TRIANGLES_SPARE = 100_000
_SHAPED_TRIANGLES_MAX = 8_000_000
"""Triangles that are bent or morphed for single nodes, which may show one mesh in many poses."""
_POINTS, _LINES, _TRIANGLES, _STRIP, _FAN = 0, (1, 2, 3), 4, 5, 6


class GltfMeshes:
    """Reads the meshes that nodes place."""

    def __init__(self, file: GltfFile, accessors: Accessors, materials: GltfMaterials, shapes: GltfShapes, left: NotCarried) -> None:
        self._entries = file.json.maps("meshes")
        self._accessors = accessors
        self._attributes = GltfAttributes(accessors, materials, left)
        self._materials = materials
        self._shapes = shapes
        self._left = left
        self._file = file
        self._triangles_read = 0
        self._triangles_shaped = 0

    def read(self, shape: Shape) -> list[MeshPart]:
        """A mesh's parts as a node shows them."""
        parts = [self._part(primitive, shape) for primitive in self._entries[shape.mesh].maps("primitives")]
        return [part for part in parts if part is not None]

    def _part(self, primitive: JsonMap, shape: Shape) -> MeshPart | None:
        if primitive.extension("KHR_draco_mesh_compression") and not primitive.inner("attributes").has("POSITION"):
            raise primitive.fault("is compressed with Draco, which scenefold does not read")
        attributes = primitive.inner("attributes")
        mode = primitive.integer("mode", 0, 6, default=_TRIANGLES)
        if mode == _POINTS or mode in _LINES:
            self._left.note("points" if mode == _POINTS else "lines")
            return None
        where = attributes.index("POSITION", len(self._accessors), "accessor")
        if where < 0:
            self._left.note("primitives without positions")
            return None
        count = self._accessors.held(where, "VEC3")
        named = self._triangles(primitive, mode, count)
        self._count(primitive, len(named), shape)
        material = self._materials.worn_by(primitive)
        vertices, triangles = used_by(named, count)
        bare = MeshPart(self._accessors.floats(where, "VEC3", vertices.rows), None, None, triangles, material)
        whole = drop_lost_triangles(bare, self._left)
        if whole is not bare:
            vertices = vertices.among(used_vertices(whole))
        part = self._attributes.dressed(compact(whole), attributes, vertices)
        if shape.is_own:
            part = self._shapes.shaped(part, primitive, vertices, shape)
        # NaN fails this comparison too.
        if not (np.abs(part.positions) <= COORDINATE_ABS_MAX).all():
            raise primitive.fault("has a position that is not finite, or beyond 1e9")
        return self._attributes.mended(part)

    def _count(self, primitive: JsonMap, triangles: int, shape: Shape) -> None:
        """Primitives that share data thousands of times would fill any memory."""
        if shape.is_own:
            self._triangles_shaped += triangles
            if self._triangles_shaped > _SHAPED_TRIANGLES_MAX:
                raise primitive.fault(f"brings the file to more than {_SHAPED_TRIANGLES_MAX} triangles in poses of their own")
            return
        self._triangles_read += triangles
        if self._triangles_read > self._file.bytes_read + _TRIANGLES_SPARE:
            raise primitive.fault("brings the file to more triangles than it has bytes")

    def _triangles(self, primitive: JsonMap, mode: int, vertices: int) -> NDArray[np.uint32]:
        where = primitive.index("indices", len(self._accessors), "accessor")
        corners = self._accessors.indices(where) if where >= 0 else np.arange(vertices, dtype=np.uint32)
        if len(corners) and int(corners.max()) >= vertices:
            raise primitive.fault(f"has the index {int(corners.max())}, but {vertices} vertices")
        if mode == _TRIANGLES:
            self._left.note("incomplete triangles", int(len(corners) % 3 > 0))
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        if len(corners) < 3:
            return np.empty((0, 3), np.uint32)
        if mode == _FAN:
            first = np.broadcast_to(corners[0], len(corners) - 2)
            return np.stack([corners[1:-1], corners[2:], first], axis=1)
        strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        strip[1::2] = strip[1::2][:, [0, 2, 1]]
        return strip
