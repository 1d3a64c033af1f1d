"""A scene of flat triangles that all reflect their base colour evenly, for us and for Mitsuba, by what each is quickest with.

Mitsuba's own area lights shine to one side; lamps with two are those of the renderer `mitsuba`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from scenefold.render.arrays import Feature, JobNumbers, MaterialColumn
from scenefold.render.contract import HeldScene
from scenefold.render.flat import FlatTriangles, flat_triangles
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.lights import punctual_light, surface_light
from scenefold.render.renderers.mitsuba.looks import Looks

_PLAIN = {
    MaterialColumn.METALLIC: 0.0,
    MaterialColumn.ROUGHNESS: 1.0,
    MaterialColumn.TRANSMISSION: 0.0,
    MaterialColumn.IOR: 1.0,
    MaterialColumn.SPECULAR: 0.0,
    MaterialColumn.ALPHA_MODE: 0.0,
    MaterialColumn.CLEARCOAT: 0.0,
    MaterialColumn.UNLIT: 0.0,
    MaterialColumn.FEATURES: float(Feature.REFLECTION),
}
"""A dielectric of index 1 and without a weight reflects nothing, also at grazing angles, so that the body beneath is all there is. The
weight is looked at only where the features say so."""
_USES = slice(MaterialColumn.BASE_USE, MaterialColumn.SPECULAR_COLOR_USE + 1)


def all_diffuse(held: HeldScene) -> HeldScene:
    """The same scene, with other materials, and without the normals of its vertices.

    Where those and a triangle's own disagree renderers do: Mitsuba turns a shading normal that looks away from the viewer, and lets light pass
    to the other side of the triangle if it comes from the side of the shading normal; ours does neither.
    """
    materials = held.arrays.materials.copy()
    for column, value in _PLAIN.items():
        materials[:, column] = value
    materials[:, _USES] = -1.0
    # Lamps shine evenly, too: what samples of their light have must be what is seen of them.
    uses = np.full_like(held.arrays.emitter_uses, -1.0)
    flat = np.zeros_like(held.arrays.normals)
    return replace(held, arrays=held.arrays._replace(materials=materials, emitter_uses=uses, normals=flat))


def mitsuba_scene(mitsuba: Mitsuba, held: HeldScene, numbers: JobNumbers) -> Any:
    """The `mi.Scene`, of Mitsuba's own `diffuse` and `area`, with the scene's points, spots and suns."""
    mi = mitsuba.mi
    parts: dict[str, Any] = {"type": "scene"}
    flat = flat_triangles(held)
    for material in np.unique(flat.materials):
        row = held.arrays.materials[int(material)]
        radiance = row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3]
        triangles = FlatTriangles(*(column[flat.materials == material] for column in flat))
        lamp = _lamp(mitsuba, held, int(material)) if radiance.max() > 0.0 else None
        parts[f"mesh_{material}"] = _mesh(mi, triangles, row, lamp)
    for number, light in enumerate(held.arrays.punctual_lights):
        parts[f"light_{number}"] = punctual_light(mitsuba, light)
    if float(numbers.sky.max()) > 0.0:
        parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": numbers.sky.tolist()}}
    return mi.load_dict(parts)


def _lamp(mitsuba: Mitsuba, held: HeldScene, material: int) -> Any:
    row = held.arrays.materials[material]
    if row[MaterialColumn.DOUBLE_SIDED]:
        return surface_light(mitsuba, Looks(mitsuba, held.arrays, material))
    radiance = [float(one) for one in row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3]]
    return mitsuba.mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": radiance}})


def _mesh(mi: Any, triangles: FlatTriangles, row: Any, lamp: Any) -> Any:
    properties = mi.Properties()
    color = [float(value) for value in row[MaterialColumn.BASE : MaterialColumn.BASE + 3]]
    properties["mesh_bsdf"] = mi.load_dict(
        {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}}
    )
    if lamp is not None:
        properties["mesh_emitter"] = lamp
    count = 3 * len(triangles.materials)
    mesh = mi.Mesh("plain", count, count // 3, properties)
    buffers = mi.traverse(mesh)
    buffers["vertex_positions"] = triangles.positions.ravel()
    buffers["faces"] = np.arange(count, dtype=np.uint32)
    buffers.update()
    return mesh
