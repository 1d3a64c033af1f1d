"""Skins of a glTF: where their joints carry a mesh, and which joints hold each vertex."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.importers.deforming import Influences
from scenefold.scene.importers.gltf_accessors import Accessors
from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_vertices import Vertices
from scenefold.scene.importers.matrices import Matrix, product
from scenefold.scene.importers.source import NotCarried

_JOINTS_MAX = 1_000_000
"""In all skins that a file's nodes wear: 128 MB of matrices."""
_SETS_MAX = 8
"""Of four joints each."""


class GltfSkins:
    """Reads the skins of one file, whose nodes stand at `worlds`."""

    def __init__(self, file: GltfFile, accessors: Accessors, worlds: Mapping[int, Matrix], left: NotCarried) -> None:
        self._entries = file.json.maps("skins")
        self._nodes = len(file.json.maps("nodes"))
        self._accessors = accessors
        self._worlds = worlds
        self._left = left
        self._joints_read = 0
        self._joints: dict[int, NDArray[np.float64] | None] = {}

    def joints(self, skin: int) -> NDArray[np.float64] | None:
        """f64[nj, 4, 4] from the mesh's bind pose to the world, for each joint; None if the scene does not show all joints."""
        if skin not in self._joints:
            self._joints[skin] = self._carried(self._entries[skin])
        return self._joints[skin]

    def _carried(self, skin: JsonMap) -> NDArray[np.float64] | None:
        joints = skin.indices("joints", self._nodes, "node")
        if not joints:
            raise skin.fault("has no joints")
        self._joints_read += len(joints)
        if self._joints_read > _JOINTS_MAX:
            raise skin.fault(f"brings the file to more than {_JOINTS_MAX} joints", "joints")
        if not all(joint in self._worlds for joint in joints):
            return None
        result = np.array([self._worlds[joint] for joint in joints])
        where = skin.index("inverseBindMatrices", len(self._accessors), "accessor")
        if where >= 0:
            if self._accessors.count(where) < len(joints):
                raise skin.fault("has fewer matrices than joints", "inverseBindMatrices")
            # Stored column by column.
            inverse = self._accessors.doubles(where, "MAT4").reshape(-1, 4, 4).transpose(0, 2, 1)
            if not (np.abs(inverse[: len(joints)]) <= COORDINATE_ABS_MAX).all():
                raise skin.fault("has a matrix that is not finite or beyond measure", "inverseBindMatrices")
            for number, world in enumerate(result):
                result[number] = product(world, inverse[number])
        return result

    def influences(self, attributes: JsonMap, vertices: Vertices, joints: int) -> Influences:
        """Of these vertices of a primitive, under a skin of so many joints."""
        numbers: list[NDArray[np.generic]] = []
        weights: list[NDArray[np.float32]] = []
        for place in range(_SETS_MAX):
            if not (attributes.has(f"JOINTS_{place}") and attributes.has(f"WEIGHTS_{place}")):
                break
            joint, weight = (self._accessors.of_vertices(attributes, f"{name}_{place}", vertices) for name in ("JOINTS", "WEIGHTS"))
            numbers.append(self._accessors.numbers(joint, "VEC4", vertices.rows))
            weights.append(self._accessors.shares(weight, ("VEC4",), vertices.rows))
        if not numbers:
            self._left.note("skinned primitives without joints, which follow their node")
            return Influences(np.zeros((len(vertices), 1), np.int64), np.zeros((len(vertices), 1)))
        which = np.concatenate(numbers, axis=1).astype(np.int64)
        given = np.concatenate(weights, axis=1)
        good = (given >= 0.0) & (given <= COORDINATE_ABS_MAX)
        self._left.note("joint weights that were none, taken for 0", int((~good).sum()))
        firm = np.where(good, given, np.float32(0)).astype(np.float64)
        # What does not count may name any joint.
        which[firm == 0.0] = 0
        if which.size and int(which.max()) >= joints:
            raise attributes.fault(f"names the joint {int(which.max())}, but the skin has {joints}", "JOINTS_0")
        totals = firm.sum(axis=1, keepdims=True)
        self._left.note("vertices that no joint holds, which follow their node", int((totals == 0.0).sum()))
        return Influences(which, firm / np.where(totals == 0.0, 1.0, totals))
