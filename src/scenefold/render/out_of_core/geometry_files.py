"""A scene's geometry and texels in files, as the arrays that kernels read: streamed there, a few groups at a time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import DamagedData
from scenefold.render.arrays import I64, U8, SceneArrays
from scenefold.render.content import scene_arrays, textures_of_materials
from scenefold.render.out_of_core.spill import Spill
from scenefold.render.pool.share import LANE, SceneReader
from scenefold.render.texture_levels import fill_levels, hiding_textures, levels_of, texture_rows
from scenefold.scene.layout import GEOMETRY, TEXTURES
from scenefold.scene.payloads.geometry import HAS_COLORS, HAS_TANGENTS, HAS_UVS2, GeometryAtom
from scenefold.scene.payloads.tiles import decode_tile
from scenefold.scene.tables import SceneTables
from scenefold.world import Workers

_GROUPS_AT_A_TIME = 16
_TILES_AT_A_TIME = 64


async def arrays_on_disk(tables: SceneTables, reader: SceneReader, workers: Workers, spill: Spill) -> SceneArrays:
    """The arrays of the whole scene, with the same values as if they lay in memory; LocalFault where the disk is full, DamagedData if a record is not there."""
    files = _GeometryFiles(tables, spill)
    for first in range(0, len(tables.groups), _GROUPS_AT_A_TIME):
        groups = range(first, min(first + _GROUPS_AT_A_TIME, len(tables.groups)))
        payloads = await reader.get_many(GEOMETRY, [place for group in groups for place in tables.groups.locations(group)])
        await workers.run(LANE, files.append, groups, payloads)
    textures = textures_of_materials(tables, np.flatnonzero(files.worn).tolist())
    rows, size_bytes = texture_rows(tables, textures)
    hiding = await workers.run(LANE, hiding_textures, tables)
    texels: npt.NDArray[np.uint8] = spill.zeros(np.uint8, (size_bytes,))
    for number in textures:
        tiles = tables.textures[number].tiles
        for first in range(0, len(tiles), _TILES_AT_A_TIME):
            payloads = await reader.get_many(TEXTURES, tiles[first : first + _TILES_AT_A_TIME])
            await workers.run(LANE, _fill, tables, number, first, payloads, rows, texels)
        fill = partial(fill_levels, by_alpha=number in hiding)
        await workers.run(LANE, fill, tables, number, levels_of(tables, number, rows, texels))
    return files.arrays()._replace(textures=rows, texels=texels)


class _GeometryFiles:
    """Columns of vertices and triangles, appended to group by group, in ascending order."""

    def __init__(self, tables: SceneTables, spill: Spill) -> None:
        self._tables = tables
        self.worn = np.zeros(len(tables.materials), np.bool_)
        """Materials that some triangle wears."""
        flags = int(np.bitwise_or.reduce(tables.groups.flags)) if len(tables.groups) else 0
        self._has = {name: bool(flags & flag) for name, flag in (("uvs2", HAS_UVS2), ("colors", HAS_COLORS), ("tangents", HAS_TANGENTS))}
        self._widths = {"vertices": 3, "normals": 3, "uvs": 2}
        self._widths |= {name: width for name, width in (("uvs2", 2), ("colors", 4), ("tangents", 4)) if self._has[name]}
        self._files = {name: spill.file() for name in self._widths}
        self._corners, self._materials = spill.file(), spill.file()
        self._vertex = self._triangle = 0
        self._group_first = np.full(len(tables.groups), -1, np.int64)

    def append(self, groups: Sequence[int], payloads: Sequence[bytes | None]) -> None:
        """These groups, from the payloads of all their atoms. In a worker."""
        at = 0
        for group in groups:
            count = int(self._tables.groups.first_atom[group + 1] - self._tables.groups.first_atom[group])
            atoms = self._tables.group_atoms(group, payloads[at : at + count])
            at += count
            self._group_first[group] = self._triangle
            for atom in atoms:
                self._append(atom)

    def arrays(self) -> SceneArrays:
        """All arrays but those of textures, which are as of a scene that holds none."""
        columns: dict[str, Any] = {
            name: self._files[name].mapped(np.float32, (self._vertex, width)) for name, width in self._widths.items()
        }
        columns |= {f"has_{name}": has for name, has in self._has.items()}
        return scene_arrays(self._tables, {}, {})._replace(
            triangles=self._corners.mapped(np.uint32, (self._triangle, 3)),
            triangle_material=self._materials.mapped(np.uint16, (self._triangle,)),
            group_first=self._group_first,
            **columns,
        )

    def _append(self, atom: GeometryAtom) -> None:
        count = len(atom.positions)
        values = {
            "vertices": atom.positions, "normals": atom.normals, "uvs": atom.uvs,
            "uvs2": atom.uvs2, "colors": atom.colors, "tangents": atom.tangents,
        }  # fmt: skip
        for name, width in self._widths.items():
            own = values[name]
            if own is None:
                own = np.full((count, width), 1.0 if name == "colors" else 0.0, np.float32)
            self._files[name].append(np.asarray(own, np.float32))
        self._corners.append(atom.triangles.astype(np.uint32) + np.uint32(self._vertex))
        self._materials.append(np.broadcast_to(np.asarray(atom.materials, np.uint16), len(atom.triangles)))
        self.worn[np.unique(atom.materials)] = True
        self._vertex += count
        self._triangle += len(atom.triangles)


def _fill(tables: SceneTables, number: int, first: int, payloads: Sequence[bytes | None], rows: I64, texels: U8) -> None:
    texture = tables.textures[number]
    image = levels_of(tables, number, rows, texels)[0]
    for index, payload in enumerate(payloads, first):
        if payload is None:
            raise DamagedData(f"tile {index} of texture {number} is missing")
        tile = decode_tile(payload)
        left, upper, right, lower = texture.tile_box(index)
        if (tile.texture, tile.tile) != (number, index) or tile.pixels.shape != (lower - upper, right - left, 4):
            raise DamagedData(f"tile {index} of texture {number} is not the one that the table speaks of")
        image[upper:lower, left:right] = tile.pixels
