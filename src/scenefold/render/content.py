"""From a scene's records to the arrays of one node: which groups it holds, and the arrays that kernels read.

A node holds every (instance, group) pair whose world box meets its cell, grown by two steps of t_done: so it
finds every hit up to the step to which it certifies a ray (specs/07-rays.md). Textures are held where a held
triangle wears them, emissive ones of lamps on every node. Pure: payloads come in, arrays go out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.base.rays import T_DONE_STEPS
from scenefold.partition import Partition
from scenefold.render.arrays import F32, F64, I64, U8, MaterialColumn, SceneArrays
from scenefold.render.emitter_reach import emitter_reach
from scenefold.render.environment_kernels import fill_tables
from scenefold.render.material_rows import material_rows
from scenefold.render.numbers import diagonal_of, job_box, punctual_rows
from scenefold.render.setup_kernels import linear_of_srgb
from scenefold.render.texture_levels import fill_levels, hiding_textures, levels_of, texture_rows
from scenefold.scene.payloads.geometry import HAS_COLORS, HAS_TANGENTS, HAS_UVS2, GeometryAtom
from scenefold.scene.payloads.light_table import NO_MATERIAL
from scenefold.scene.payloads.tiles import TextureTile
from scenefold.scene.tables import SceneTables, instance_groups

_DILATION_STEPS = 2.0
_ROUNDING = 1e-6
"""Of the box's diagonal: what single precision may move a hit."""


@dataclass(frozen=True, slots=True)
class Share:
    """What one node holds: groups in ascending order, and instances other than 0."""

    groups: tuple[int, ...]
    instances: tuple[int, ...]
    pairs: int
    """(instance, group) pairs that meet the cell."""
    instanced_triangles: int
    """Triangles of those pairs."""


def pair_boxes(tables: SceneTables) -> tuple[I64, I64, F64, F64]:
    """All (instance, group) pairs and their world boxes: instances, groups, low f64[m, 3], high f64[m, 3]."""
    instances, groups = instance_groups(tables.groups, tables.instances)
    low, high = tables.groups.low[groups].astype(np.float64), tables.groups.high[groups].astype(np.float64)
    matrices = tables.instances.matrices[instances].astype(np.float64)
    centre, half = (low + high) * 0.5, (high - low) * 0.5
    turned = (matrices[:, :, :3] * centre[:, None, :]).sum(axis=2) + matrices[:, :, 3]
    reach = (np.abs(matrices[:, :, :3]) * half[:, None, :]).sum(axis=2)
    slack = 1e-6 * (np.abs(turned) + reach)
    return instances, groups, turned - reach - slack, turned + reach + slack


def cell_margin(tables: SceneTables) -> float:
    """By how much a cell is grown, on all sides, to what its node must hold."""
    return diagonal_of(*job_box(tables)) * (_DILATION_STEPS / T_DONE_STEPS + _ROUNDING)


def share_of(tables: SceneTables, partition: Partition, me: int) -> Share:
    """What node `me` of a partition must hold."""
    return shares_of(tables, partition, (me,))[0]


def shares_of(tables: SceneTables, partition: Partition, nodes: Sequence[int]) -> list[Share]:
    """What each of these nodes of a partition must hold."""
    instances, groups, low, high = pair_boxes(tables)
    overlaps = partition.overlaps(low, high, cell_margin(tables))
    return [_share(tables, instances, groups, overlaps[node]) for node in nodes]


def pairs_of(tables: SceneTables, partition: Partition, me: int) -> tuple[I64, I64]:
    """The (instance, group) pairs that node `me` of a partition must hold: instances and groups, int64[k] each."""
    instances, groups, low, high = pair_boxes(tables)
    mine = partition.overlaps(low, high, cell_margin(tables))[me]
    return instances[mine], groups[mine]


def _share(tables: SceneTables, instances: I64, groups: I64, mine: npt.NDArray[np.bool_]) -> Share:
    return Share(
        tuple(int(group) for group in np.unique(groups[mine])),
        tuple(int(instance) for instance in np.unique(instances[mine]) if instance != 0),
        int(mine.sum()),
        int(tables.groups.triangles[groups[mine]].sum()),
    )


def scene_arrays(
    tables: SceneTables,
    atoms: Mapping[int, Sequence[GeometryAtom]],
    tiles: Mapping[int, Sequence[TextureTile]],
) -> SceneArrays:
    """The kernels' arrays over the held groups' atoms and the held textures' tiles."""
    vertex_count = sum(len(atom.positions) for group in atoms.values() for atom in group)
    triangle_count = sum(len(atom.triangles) for group in atoms.values() for atom in group)
    # Embree reads four floats per vertex, so one row follows the last vertex.
    vertices = np.zeros((vertex_count + 1, 3), np.float32)[:vertex_count]
    normals = np.zeros((vertex_count, 3), np.float32)
    uvs = np.zeros((vertex_count, 2), np.float32)
    triangles = np.empty((triangle_count, 3), np.uint32)
    triangle_material = np.empty(triangle_count, np.uint16)
    group_first = np.full(len(tables.groups), -1, np.int64)
    vertex = triangle = 0
    for group in sorted(atoms):
        group_first[group] = triangle
        for atom in atoms[group]:
            vertex_end, triangle_end = vertex + len(atom.positions), triangle + len(atom.triangles)
            vertices[vertex:vertex_end] = atom.positions
            if atom.normals is not None:
                normals[vertex:vertex_end] = atom.normals
            if atom.uvs is not None:
                uvs[vertex:vertex_end] = atom.uvs
            triangles[triangle:triangle_end] = atom.triangles + np.uint32(vertex)
            triangle_material[triangle:triangle_end] = atom.materials
            vertex, triangle = vertex_end, triangle_end
    matrices = tables.instances.matrices.astype(np.float64)
    texture_rows, texels = _textures(tables, tiles)
    lights = tables.lights
    materials, uses = material_rows(tables)
    emitter_uses, emitter_emissive, emitter_uvs, has_emitter_maps = _emitter_maps(tables, materials)
    return SceneArrays(
        vertices,
        normals,
        uvs,
        triangles,
        triangle_material,
        group_first,
        matrices,
        _normal_matrices(matrices),
        materials.astype(np.float32),
        texture_rows,
        texels,
        linear_of_srgb(),
        np.ascontiguousarray(lights.corners),
        np.ascontiguousarray(lights.emission),
        lights.two_sided.astype(np.uint8),
        np.ascontiguousarray(lights.threshold),
        np.ascontiguousarray(lights.alias),
        punctual_rows(tables),
        uses,
        *_rarer_attributes([atom for group in sorted(atoms) for atom in atoms[group]], vertex_count),
        *_environment(tables),
        emitter_uses=emitter_uses,
        emitter_emissive=emitter_emissive,
        emitter_uvs=emitter_uvs,
        has_emitter_maps=has_emitter_maps,
        emitter_reach=emitter_reach(tables, matrices),
    )


def _rarer_attributes(held: Sequence[GeometryAtom], vertices: int) -> tuple[F32, F32, F32, bool, bool, bool]:
    """`uvs2`, `colors`, `tangents` of `SceneArrays`, and whether anything held has them: few scenes do, so what none has is one row."""
    flags = 0
    for atom in held:
        flags |= atom.flags
    has_uvs2, has_colors, has_tangents = (bool(flags & flag) for flag in (HAS_UVS2, HAS_COLORS, HAS_TANGENTS))
    uvs2 = np.zeros((vertices if has_uvs2 else 1, 2), np.float32)
    colors = np.ones((vertices if has_colors else 1, 4), np.float32)
    tangents = np.zeros((vertices if has_tangents else 1, 4), np.float32)
    first = 0
    for atom in held:
        place = slice(first, first + len(atom.positions))
        if atom.uvs2 is not None:
            uvs2[place] = atom.uvs2
        if atom.colors is not None:
            colors[place] = atom.colors
        if atom.tangents is not None:
            tangents[place] = atom.tangents
        first = place.stop
    return uvs2, colors, tangents, has_uvs2, has_colors, has_tangents


def _environment(tables: SceneTables) -> tuple[F32, F32, F32]:
    """`environment`, `environment_rows`, `environment_columns` of `SceneArrays`."""
    texels = tables.environment.radiance if len(tables.environment) else np.zeros((1, 1, 3), np.float32)
    height, width = texels.shape[:2]
    rows, columns = np.empty(height + 1, np.float32), np.empty((height, width + 1), np.float32)
    fill_tables(texels, np.empty(height), rows, columns)
    return texels, rows, columns


def _emitter_maps(tables: SceneTables, materials: F64) -> tuple[F32, F32, F32, bool]:
    """`emitter_uses`, `emitter_emissive`, `emitter_uvs`, `has_emitter_maps` of `SceneArrays`."""
    worn = tables.lights.materials
    mapped = worn != NO_MATERIAL
    if not mapped.any():
        return np.full(1, -1.0, np.float32), np.zeros((1, 3), np.float32), np.zeros((1, 3, 2), np.float32), False
    rows = materials[np.where(mapped, worn, 0)].astype(np.float32)
    uses = np.where(mapped, rows[:, MaterialColumn.EMISSIVE_USE], np.float32(-1.0))
    emissive = np.ascontiguousarray(rows[:, MaterialColumn.EMISSIVE : MaterialColumn.EMISSIVE + 3])
    return uses, emissive, np.ascontiguousarray(tables.lights.coordinates), True


def held_textures(tables: SceneTables, atoms: Mapping[int, Sequence[GeometryAtom]]) -> list[int]:
    """What a node must hold of textures, ascending: those that its triangles wear, and those of all lamps, which light samples read."""
    named = tables.lights.materials
    lamps = (tables.materials[number].emissive_texture for number in np.unique(named[named != NO_MATERIAL]))
    return sorted({*worn_textures(tables, atoms), *(use.texture for use in lamps if use is not None)})


def worn_textures(tables: SceneTables, atoms: Mapping[int, Sequence[GeometryAtom]]) -> list[int]:
    """The textures that the held triangles wear, ascending."""
    used: set[int] = set()
    for group in atoms.values():
        for atom in group:
            used.update(int(material) for material in np.unique(atom.materials))
    return textures_of_materials(tables, used)


def textures_of_materials(tables: SceneTables, materials: Iterable[int]) -> list[int]:
    """The textures that these materials use, ascending."""
    return sorted({use.texture for number in materials for _, use in tables.materials[number].uses()})


def _normal_matrices(matrices: F64) -> F64:
    """Cofactor matrices f64[n, 3, 3] of the rotations: inverse transposes up to scale, with the sign of the determinant."""
    a = matrices[:, :, :3]
    rows = np.empty_like(a)
    for row in range(3):
        rows[:, row] = np.cross(a[:, (row + 1) % 3], a[:, (row + 2) % 3])
    determinant = (a[:, 0] * rows[:, 0]).sum(axis=1)
    # Scaled, so that the normals of very small and very large instances stay far from the ends of the range.
    size = np.maximum(np.abs(rows).max(axis=(1, 2)), 1e-300)
    rows *= (np.where(determinant < 0.0, -1.0, 1.0) / size)[:, None, None]
    return np.ascontiguousarray(rows)


def _textures(tables: SceneTables, tiles: Mapping[int, Sequence[TextureTile]]) -> tuple[I64, U8]:
    """`SceneArrays.textures` and `texels` of the held images."""
    rows, size_bytes = texture_rows(tables, sorted(tiles))
    hiding = hiding_textures(tables)
    texels: npt.NDArray[np.uint8] = np.zeros(size_bytes, np.uint8)
    for number in sorted(tiles):
        levels = levels_of(tables, number, rows, texels)
        for tile in tiles[number]:
            left, upper, right, lower = tables.textures[number].tile_box(tile.tile)
            levels[0][upper:lower, left:right] = tile.pixels
        fill_levels(tables, number, levels, by_alpha=number in hiding)
    return rows, texels
