"""What lies at a hit: its place, normals and texture coordinates, and its material with textures applied. In lanes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.render.arrays import Feature, MaterialColumn
from scenefold.render.bsdf_kernels import dielectric_reflection
from scenefold.render.ggx_albedo import ALPHA_MIN
from scenefold.render.lane_values_kernels import alike, any_lane, gather, put, select, take, whole_of_real
from scenefold.render.lanes_kernels import LANES
from scenefold.render.space_kernels import longest_side
from scenefold.render.texture_kernels import sample_use_over

_BASE, _METALLIC, _ROUGHNESS = MaterialColumn.BASE, MaterialColumn.METALLIC, MaterialColumn.ROUGHNESS
_BASE_USE, _MR_USE = MaterialColumn.BASE_USE, MaterialColumn.METALLIC_ROUGHNESS_USE
_REFLECTION, _COAT, _SOLID = np.uint32(Feature.REFLECTION), np.uint32(Feature.COAT), np.uint32(Feature.SOLID)
_CLEARCOAT, _CLEARCOAT_USE, _CLEARCOAT_ROUGHNESS, _CLEARCOAT_ROUGHNESS_USE = (
    MaterialColumn.CLEARCOAT,
    MaterialColumn.CLEARCOAT_USE,
    MaterialColumn.CLEARCOAT_ROUGHNESS,
    MaterialColumn.CLEARCOAT_ROUGHNESS_USE,
)
_IOR, _FEATURES = MaterialColumn.IOR, MaterialColumn.FEATURES
_TRANSMISSION, _TRANSMISSION_USE = MaterialColumn.TRANSMISSION, MaterialColumn.TRANSMISSION_USE
_SPECULAR, _SPECULAR_COLOR, _SPECULAR_USE, _SPECULAR_COLOR_USE = (
    MaterialColumn.SPECULAR,
    MaterialColumn.SPECULAR_COLOR,
    MaterialColumn.SPECULAR_USE,
    MaterialColumn.SPECULAR_COLOR_USE,
)


class Surface(NamedTuple):
    """A material at a point, in lanes."""

    r: Any
    """Base colour, linear."""
    g: Any
    b: Any
    metallic: Any
    alpha: Any
    """Of GGX: roughness squared."""
    reflection: Any
    """Reflectance of the dielectric at normal incidence, three colours, and at grazing angles."""
    transmission: Any
    features: Any
    """Words: bits of `Feature`."""
    coat: Any
    """Strength of the clear coat."""
    coat_alpha: Any
    glass: Any
    """How much of it is solid glass; `transmission` is 0 there, and `metallic` of the rest."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def blend(w, u, v, array, i0, i1, i2, column):  # type: ignore[no-untyped-def]
    """A column of an array of vertices, between three corners."""
    return w * gather(array, (i0, column)) + u * gather(array, (i1, column)) + v * gather(array, (i2, column))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def turned(matrices, instance, x, y, z):  # type: ignore[no-untyped-def]
    """A vector through the left 3 x 3 of each lane's matrix."""
    return (
        gather(matrices, (instance, 0, 0)) * x + gather(matrices, (instance, 0, 1)) * y + gather(matrices, (instance, 0, 2)) * z,
        gather(matrices, (instance, 1, 0)) * x + gather(matrices, (instance, 1, 1)) * y + gather(matrices, (instance, 1, 2)) * z,
        gather(matrices, (instance, 2, 0)) * x + gather(matrices, (instance, 2, 1)) * y + gather(matrices, (instance, 2, 2)) * z,
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def surface_at(scene, triangle, instance, u, v):  # type: ignore[no-untyped-def]
    """World point, geometric normal by winding, shading normal, and texture coordinates of hits."""
    i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
    w = 1.0 - u - v
    p, n, t = scene.vertices, scene.normals, scene.uvs
    x0, y0, z0 = gather(p, (i0, 0)), gather(p, (i0, 1)), gather(p, (i0, 2))
    e1x, e1y, e1z = gather(p, (i1, 0)) - x0, gather(p, (i1, 1)) - y0, gather(p, (i1, 2)) - z0
    e2x, e2y, e2z = gather(p, (i2, 0)) - x0, gather(p, (i2, 1)) - y0, gather(p, (i2, 2)) - z0
    px, py, pz = x0 + (u * e1x + v * e2x), y0 + (u * e1y + v * e2y), z0 + (u * e1z + v * e2z)
    # By the longest side, so that the products of tiny and of huge triangles stay far from the ends of the range.
    size = 1.0 / max(max(max(abs(e1x), abs(e1y)), max(abs(e1z), abs(e2x))), max(max(abs(e2y), abs(e2z)), 1e-30))
    e1x, e1y, e1z, e2x, e2y, e2z = e1x * size, e1y * size, e1z * size, e2x * size, e2y * size, e2z * size
    gx, gy, gz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    sx, sy, sz = blend(w, u, v, n, i0, i1, i2, 0), blend(w, u, v, n, i0, i1, i2, 1), blend(w, u, v, n, i0, i1, i2, 2)
    placed = instance != np.uint32(0)
    if any_lane(placed):
        m, k = scene.instance_matrices, scene.instance_normals
        qx, qy, qz = turned(m, instance, px, py, pz)
        px, py, pz = (
            select(placed, qx + gather(m, (instance, 0, 3)), px),
            select(placed, qy + gather(m, (instance, 1, 3)), py),
            select(placed, qz + gather(m, (instance, 2, 3)), pz),
        )
        qx, qy, qz = turned(k, instance, gx, gy, gz)
        gx, gy, gz = select(placed, qx, gx), select(placed, qy, gy), select(placed, qz, gz)
        qx, qy, qz = turned(k, instance, sx, sy, sz)
        sx, sy, sz = select(placed, qx, sx), select(placed, qy, sy), select(placed, qz, sz)
    scale = 1.0 / math.sqrt(max(gx * gx + gy * gy + gz * gz, 1e-36))
    gx, gy, gz = gx * scale, gy * scale, gz * scale
    squared = sx * sx + sy * sy + sz * sz
    smooth = squared > 1e-12
    scale = 1.0 / math.sqrt(select(smooth, squared, 1.0))
    sx, sy, sz = select(smooth, sx * scale, gx), select(smooth, sy * scale, gy), select(smooth, sz * scale, gz)
    return px, py, pz, gx, gy, gz, sx, sy, sz, blend(w, u, v, t, i0, i1, i2, 0), blend(w, u, v, t, i0, i1, i2, 1)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def reach_at(scene, triangle, instance):  # type: ignore[no-untyped-def]
    """How far a hit's triangle reaches, in the world: along an axis, its longest edge. Within an instance also how far its corners lie
    from where that is placed, since the caster carries rays there."""
    i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
    p = scene.vertices
    x0, y0, z0 = gather(p, (i0, 0)), gather(p, (i0, 1)), gather(p, (i0, 2))
    x1, y1, z1 = gather(p, (i1, 0)), gather(p, (i1, 1)), gather(p, (i1, 2))
    x2, y2, z2 = gather(p, (i2, 0)), gather(p, (i2, 1)), gather(p, (i2, 2))
    reach = longest_side(x1 - x0, y1 - y0, z1 - z0, x2 - x0, y2 - y0, z2 - z0)
    placed = instance != np.uint32(0)
    if any_lane(placed):
        m, far = scene.instance_matrices, max(reach, max(abs(x0), max(abs(y0), abs(z0))))
        grown = alike(0.0, reach)
        for axis in range(3):
            row = abs(gather(m, (instance, axis, 0))) + abs(gather(m, (instance, axis, 1))) + abs(gather(m, (instance, axis, 2)))
            grown = max(grown, row)
        reach = select(placed, far * grown, reach)
    return reach


@njit(error_model="numpy", _nrt=False, forceinline=True)
def coordinates_at(scene, triangle, u, v, tu, tv):  # type: ignore[no-untyped-def]
    """Both sets of texture coordinates, four lanes; the first one, (tu, tv), again where nothing has a second."""
    tu2, tv2 = tu, tv
    if scene.has_uvs2:
        i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
        w = 1.0 - u - v
        tu2, tv2 = blend(w, u, v, scene.uvs2, i0, i1, i2, 0), blend(w, u, v, scene.uvs2, i0, i1, i2, 1)
    return tu, tv, tu2, tv2


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _vertex_color(scene, triangle, u, v):  # type: ignore[no-untyped-def]
    """Red, green and blue of the vertices' colours, in a scene that has some."""
    i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
    w, c = 1.0 - u - v, scene.colors
    return blend(w, u, v, c, i0, i1, i2, 0), blend(w, u, v, c, i0, i1, i2, 1), blend(w, u, v, c, i0, i1, i2, 2)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def texture_of(scene, material, column, places, scratch):  # type: ignore[no-untyped-def]
    """Linear red, green, blue and alpha of the texture use that a column of the materials names; 1 where there is none.

    places: both sets of coordinates and the squared footprints in both, four lanes. Lane by lane: almost all that it does is to look up
    texels.
    """
    return texture_of_uses(scene, gather(scene.materials, (material, column)), places, scratch)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def texture_of_uses(scene, uses, places, scratch):  # type: ignore[no-untyped-def]
    """The same of texture uses by their numbers, as reals; -1: none."""
    reals = scratch.view(np.float32)
    one = alike(1.0, places[0])
    if not any_lane(uses >= 0.0):
        return one, one, one, one
    put(reals, 0, uses)
    put(reals, LANES, places[0])
    put(reals, 2 * LANES, places[1])
    put(reals, 3 * LANES, places[2])
    put(reals, 4 * LANES, places[3])
    put(reals, 9 * LANES, places[4])
    put(reals, 10 * LANES, places[5])
    for k in range(LANES):
        use = int(reals[k])
        r = g = b = a = 1.0
        if use >= 0:
            r, g, b, a = sample_use_over(
                scene, use, reals[LANES + k], reals[2 * LANES + k], reals[3 * LANES + k], reals[4 * LANES + k],
                reals[9 * LANES + k], reals[10 * LANES + k],
            )  # fmt: skip
        reals[5 * LANES + k], reals[6 * LANES + k], reals[7 * LANES + k] = np.float32(r), np.float32(g), np.float32(b)
        reals[8 * LANES + k] = np.float32(a)
    return take(reals, 5 * LANES), take(reals, 6 * LANES), take(reals, 7 * LANES), take(reals, 8 * LANES)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def material_at(scene, material, triangle, u, v, places, scratch):  # type: ignore[no-untyped-def]
    """The `Surface` at barycentric (u, v) of a triangle, with textures and vertex colours applied; places: as in `texture_of`."""
    rows = scene.materials
    tr, tg, tb, _ = texture_of(scene, material, _BASE_USE, places, scratch)
    r, g, b = gather(rows, (material, _BASE)) * tr, gather(rows, (material, _BASE + 1)) * tg, gather(rows, (material, _BASE + 2)) * tb
    if scene.has_colors:
        cr, cg, cb = _vertex_color(scene, triangle, u, v)
        r, g, b = r * cr, g * cg, b * cb
    _, tg, tb, _ = texture_of(scene, material, _MR_USE, places, scratch)
    roughness, metallic = gather(rows, (material, _ROUGHNESS)) * tg, gather(rows, (material, _METALLIC)) * tb
    features = whole_of_real(gather(rows, (material, _FEATURES)))
    one = alike(1.0, u)
    reflection = dielectric_reflection(gather(rows, (material, _IOR)), one, one, one, one)
    if any_lane((features & _REFLECTION) != np.uint32(0)):
        _, _, _, weight = texture_of(scene, material, _SPECULAR_USE, places, scratch)
        tr, tg, tb, _ = texture_of(scene, material, _SPECULAR_COLOR_USE, places, scratch)
        reflection = dielectric_reflection(
            gather(rows, (material, _IOR)), weight * gather(rows, (material, _SPECULAR)), tr * gather(rows, (material, _SPECULAR_COLOR)),
            tg * gather(rows, (material, _SPECULAR_COLOR + 1)), tb * gather(rows, (material, _SPECULAR_COLOR + 2)),
        )  # fmt: skip
    coat = coat_alpha = alike(0.0, u)
    if any_lane((features & _COAT) != np.uint32(0)):
        tr, _, _, _ = texture_of(scene, material, _CLEARCOAT_USE, places, scratch)
        coat = gather(rows, (material, _CLEARCOAT)) * tr
        _, tg, _, _ = texture_of(scene, material, _CLEARCOAT_ROUGHNESS_USE, places, scratch)
        coat_alpha = gather(rows, (material, _CLEARCOAT_ROUGHNESS)) * tg
        coat_alpha = max(coat_alpha * coat_alpha, ALPHA_MIN)
    transmission = gather(rows, (material, _TRANSMISSION))
    if any_lane(transmission > 0.0):
        tr, _, _, _ = texture_of(scene, material, _TRANSMISSION_USE, places, scratch)
        transmission = transmission * tr
    glass, solid = alike(0.0, u), (features & _SOLID) != np.uint32(0)
    if any_lane(solid):
        glass = select(solid, transmission * (1.0 - metallic), 0.0)
        transmission = select(solid, 0.0, transmission)
        metallic = select(glass < 1.0, min(metallic / (1.0 - glass), 1.0), metallic)
    return Surface(r, g, b, metallic, max(roughness * roughness, ALPHA_MIN), reflection, transmission, features, coat, coat_alpha, glass)
