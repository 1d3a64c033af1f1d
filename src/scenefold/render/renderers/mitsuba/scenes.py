"""What a node holds as a Mitsuba scene: one mesh a material, in the world's space, instances flattened."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.arrays import JobNumbers
from scenefold.render.contract import HeldScene
from scenefold.render.flat import FlatTriangles, flat_triangles
from scenefold.render.renderers.mitsuba.gltf_bsdf import gltf_bsdf
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.lights import environment_light, punctual_light, surface_light
from scenefold.render.renderers.mitsuba.looks import Looks


def scene_of(mitsuba: Mitsuba, held: HeldScene, numbers: JobNumbers) -> Any:
    """The `mi.Scene`; LocalFault if it would not fit."""
    mi = mitsuba.mi
    parts: dict[str, Any] = {"type": "scene"}
    flat = flat_triangles(held)
    for material in np.unique(flat.materials):
        looks = Looks(mitsuba, held.arrays, int(material))
        mine = flat.materials == material
        # Mitsuba weighs points of an area light by the shading normal; without one, by the geometric normal, as it must be.
        smooth = mine & (np.abs(flat.normals).max(axis=2) > 0).all(axis=1) & (not looks.shines)
        bsdf = gltf_bsdf(mitsuba, looks)
        for name, chosen in (("flat", mine & ~smooth), ("smooth", smooth)):
            if chosen.any():
                triangles = FlatTriangles(*(column[chosen] for column in flat))
                parts[f"mesh_{material}_{name}"] = _mesh(mitsuba, triangles, looks, bsdf, name == "smooth")
    for number, row in enumerate(held.arrays.punctual_lights):
        parts[f"light_{number}"] = punctual_light(mitsuba, row)
    if numbers.has_environment:
        parts["sky"] = environment_light(mitsuba, held.arrays.environment, numbers)
    elif float(numbers.sky.max()) > 0.0:
        parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": numbers.sky.tolist()}}
    return mi.load_dict(parts)


def _mesh(mitsuba: Mitsuba, triangles: FlatTriangles, looks: Looks, bsdf: Any, smooth: bool) -> Any:
    mi = mitsuba.mi
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    if looks.shines:
        properties["mesh_emitter"] = surface_light(mitsuba, looks)
    count = 3 * len(triangles.materials)
    mesh = mi.Mesh(
        f"material {looks.number}", count, count // 3, properties, has_vertex_normals=smooth, has_vertex_texcoords=looks.textured
    )
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = triangles.positions.ravel()
    buffers["faces"] = np.arange(count, dtype=np.uint32)
    if smooth:
        buffers["vertex_normals"] = triangles.normals.ravel()
    if looks.textured:
        buffers["vertex_texcoords"] = triangles.uvs.ravel()
    buffers.update()
    if looks.reads_second_set:
        mesh.add_attribute("vertex_second", 3, np.pad(triangles.uvs2.reshape(-1, 2), ((0, 0), (0, 1))).ravel())
    if looks.coloured:
        mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(triangles.colors[..., :3]).ravel())
        mesh.add_attribute("vertex_alpha", 1, np.ascontiguousarray(triangles.colors[..., 3]).ravel())
    return mesh
