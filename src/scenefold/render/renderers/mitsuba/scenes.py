"""What a node holds as a Mitsuba scene: one mesh a material, in the world's space, instances flattened."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import F32, U32, JobNumbers, SceneArrays
from scenefold.render.contract import HeldScene
from scenefold.render.renderers.mitsuba.gltf_bsdf import gltf_bsdf
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.lights import punctual_light, surface_light
from scenefold.render.renderers.mitsuba.looks import Looks

FLAT_TRIANGLES_MAX = 20_000_000
"""Some 2 GiB of meshes and trees."""


class Soup(NamedTuple):
    """Triangles of one material in the world: three vertices each, that nobody shares."""

    positions: F32
    """[3 n, 3]"""
    normals: F32
    """[3 n, 3]; zero where the file has none."""
    uvs: F32
    """[3 n, 2]"""


def scene_of(mitsuba: Mitsuba, held: HeldScene, numbers: JobNumbers) -> Any:
    """The `mi.Scene`; LocalFault if it would not fit."""
    mi = mitsuba.mi
    parts: dict[str, Any] = {"type": "scene"}
    for material, soup in soups(held).items():
        looks = Looks(mitsuba, held.arrays, material)
        # Mitsuba weighs points of an area light by the shading normal; without one, by the geometric normal, as it must be.
        is_smooth = (
            np.zeros(len(soup.positions) // 3, np.bool_)
            if looks.shines
            else (np.abs(soup.normals).max(axis=1) > 0).reshape(-1, 3).all(axis=1)
        )
        bsdf = gltf_bsdf(mitsuba, looks)
        for smooth in (False, True):
            chosen = np.repeat(is_smooth == smooth, 3)
            if chosen.any():
                mesh = _mesh(mitsuba, f"material {material}", Soup(*(column[chosen] for column in soup)), looks, bsdf, smooth)
                parts[f"mesh_{material}_{int(smooth)}"] = mesh
    for number, row in enumerate(held.arrays.punctual_lights):
        parts[f"light_{number}"] = punctual_light(mitsuba, row)
    if float(numbers.sky.max()) > 0.0:
        parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": numbers.sky.tolist()}}
    return mi.load_dict(parts)


def soups(held: HeldScene) -> dict[int, Soup]:
    """By material, all triangles of the scene."""
    arrays = held.arrays
    pieces: dict[int, list[Soup]] = {}
    total = 0
    for triangles, materials, instance in _placed(held):
        total += len(triangles)
        if total > FLAT_TRIANGLES_MAX:
            raise LocalFault(
                f"the scene has more than {FLAT_TRIANGLES_MAX:,} triangles with its instances, which mitsuba gets one by one",
                remedy="render it with embree",
            )
        for material in np.unique(materials):
            pieces.setdefault(int(material), []).append(_in_world(arrays, triangles[materials == material], instance))
    return {material: Soup(*(np.concatenate(columns) for columns in zip(*soup, strict=True))) for material, soup in sorted(pieces.items())}


def _placed(held: HeldScene) -> Iterator[tuple[U32, npt.NDArray[np.uint16], int]]:
    """(triangles uint32[n, 3], material of each, instance) of every instance's every group."""
    arrays = held.arrays
    for instance, prototype in ((0, 0), *held.instances):
        for group in held.groups:
            if group.prototype == prototype:
                first = int(arrays.group_first[group.group])
                rows = slice(first, first + group.triangles)
                yield arrays.triangles[rows], arrays.triangle_material[rows], instance


def _in_world(arrays: SceneArrays, triangles: U32, instance: int) -> Soup:
    corners = triangles.reshape(-1)
    positions = arrays.vertices[corners].astype(np.float64)
    normals = arrays.normals[corners].astype(np.float64)
    uvs = arrays.uvs[corners]
    if instance:
        matrix = arrays.instance_matrices[instance]
        positions = positions @ matrix[:, :3].T + matrix[:, 3]
        normals = normals @ np.linalg.inv(matrix[:, :3])
        lengths = np.sqrt((normals**2).sum(axis=1, keepdims=True))
        normals = np.where(lengths > 0, normals / np.maximum(lengths, 1e-300), 0.0)
        if np.linalg.det(matrix[:, :3]) < 0:  # glTF 2.0, 3.7.4: a mirror turns the winding
            positions, normals, uvs = (
                each.reshape(-1, 3, each.shape[1])[:, ::-1].reshape(each.shape) for each in (positions, normals, uvs)
            )
    return Soup(positions.astype(np.float32), normals.astype(np.float32), uvs.astype(np.float32))


def _mesh(mitsuba: Mitsuba, name: str, soup: Soup, looks: Looks, bsdf: Any, smooth: bool) -> Any:
    mi = mitsuba.mi
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    if looks.shines:
        properties["mesh_emitter"] = surface_light(mitsuba, looks)
    count = len(soup.positions)
    mesh = mi.Mesh(name, count, count // 3, properties, has_vertex_normals=smooth, has_vertex_texcoords=looks.textured)
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = soup.positions.ravel()
    buffers["faces"] = np.arange(count, dtype=np.uint32)
    if smooth:
        buffers["vertex_normals"] = soup.normals.ravel()
    if looks.textured:
        buffers["vertex_texcoords"] = soup.uvs.ravel()
    buffers.update()
    return mesh
