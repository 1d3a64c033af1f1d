"""Builds the light table: emissive triangles of all instances in the world, with an alias table on power.

Walker's alias method as Vose builds it, in f64 and in one fixed order, so that the same file gives the same
table. A triangle's power is luminance x area; one without power is no row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.atoms import CutAtom
from scenefold.scene.importers.matrices import determinant, move_points
from scenefold.scene.payloads.light_table import LIGHT_ROW, NO_MATERIAL, light_rows
from scenefold.scene.payloads.materials import Material

LUMINANCE = (0.2126, 0.7152, 0.0722)
_SHINING = np.dtype(
    [("group", "<u4"), ("triangle", "<u4"), ("material", "<u2"), ("corners", "<f4", (3, 3)), ("coordinates", "<f4", (3, 2))]
)
_NO_SET = -1


class Emitters:
    """Collects emissive triangles while atoms are cut, prototype by prototype."""

    def __init__(self, materials: Sequence[Material]) -> None:
        self.shines = np.array([material.is_sampled_light for material in materials], bool)
        self._emission = np.array([material.mean_emissive for material in materials], np.float32).reshape(-1, 3)
        self._sides = np.array([material.double_sided for material in materials], np.uint32)
        uses = [material.emissive_texture for material in materials]
        self._uv_sets = np.array([_NO_SET if use is None else use.uv_set for use in uses], np.int8)
        self._found: dict[int, list[NDArray[np.void]]] = {}

    @property
    def mapped(self) -> bool:
        """Whether a material that shines has an emissive texture."""
        return bool((self._uv_sets[self.shines] != _NO_SET).any())

    def add(self, prototype: int, first: int, atom: CutAtom) -> None:
        """Triangles of an atom, of which the first is number `first` of its group."""
        where = np.flatnonzero(self.shines[atom.materials])
        if len(where) == 0:
            return
        rows = np.zeros(len(where), _SHINING)
        rows["group"], rows["triangle"] = atom.group, where + first
        rows["material"], rows["corners"] = atom.materials[where], atom.corners[where]
        for uv_set, places in enumerate((atom.attributes.uvs, atom.attributes.uvs2)):
            read = self._uv_sets[rows["material"]] == uv_set
            if places is not None and read.any():
                rows["coordinates"][read] = places[atom.triangles[where[read]]]
        self._found.setdefault(prototype, []).append(rows)

    def table(self, instances: NDArray[np.void]) -> NDArray[np.void]:
        """LIGHT_ROW of all, ordered by instance, group, triangle."""
        joined = {prototype: np.concatenate(pieces) for prototype, pieces in self._found.items()}
        parts = [
            self._placed(number, row["matrix"].astype(np.float64), joined[int(row["prototype"])])
            for number, row in enumerate(instances)
            if int(row["prototype"]) in joined
        ]
        rows = np.concatenate([np.empty(0, LIGHT_ROW), *parts])
        power = _areas(rows) * (rows["emission"].astype(np.float64) * LUMINANCE).sum(axis=1)
        shining: NDArray[np.void] = rows[power > 0]
        power = power[power > 0]
        if len(shining):
            shining["probability"] = power / math.fsum(power)
            shining["threshold"], shining["alias"] = alias_table(power)
        return shining

    def _placed(self, instance: int, matrix: NDArray[np.float64], shining: NDArray[np.void]) -> NDArray[np.void]:
        rows = light_rows(len(shining))
        rows["instance"] = instance
        rows["group"], rows["triangle"] = shining["group"], shining["triangle"]
        corners, coordinates = shining["corners"], shining["coordinates"]
        if instance:
            corners = move_points(matrix, corners.reshape(-1, 3)).astype(np.float32).reshape(-1, 3, 3)
        if instance and determinant(matrix) < 0:
            # The side that shines stays outside under a mirror.
            corners, coordinates = corners[:, [0, 2, 1]], coordinates[:, [0, 2, 1]]
        rows["corners"], rows["coordinates"] = corners, coordinates
        rows["material"] = np.where(self._uv_sets[shining["material"]] == _NO_SET, np.uint32(NO_MATERIAL), shining["material"])
        rows["emission"], rows["two_sided"] = self._emission[shining["material"]], self._sides[shining["material"]]
        return rows


def _areas(rows: NDArray[np.void]) -> NDArray[np.float64]:
    corners = rows["corners"].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas: NDArray[np.float64] = np.sqrt((crosses**2).sum(axis=1)) / 2
    return areas


def alias_table(weights: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Threshold and alias of each column, for weights > 0."""
    count = len(weights)
    share = (weights * (count / math.fsum(weights))).tolist()
    alias = list(range(count))
    threshold = [1.0] * count
    small = [column for column in range(count) if share[column] < 1.0]
    large = [column for column in range(count) if share[column] >= 1.0]
    while small and large:
        poor, rich = small.pop(), large[-1]
        threshold[poor], alias[poor] = share[poor], rich
        share[rich] -= 1.0 - share[poor]
        if share[rich] < 1.0:
            small.append(large.pop())
    # What is left over in either list is 1 but for rounding, and stays 1.
    return np.array(threshold, np.float32), np.array(alias, np.uint32)
