"""Surfaces that let rays pass: alpha (mask, blend) and smooth thin transmission (specs/07-rays.md, See-through).

What rough walls and solid glass let through is scattered, and is the shader's (transmission_kernels.py).

A ray passes such a surface, unchanged, with a probability that follows from the surface and the angle alone: the
caster's filter draws a number from (path, bounce, kind, instance, group, primitive) and skips the candidate, so a
window costs no bounce, lets shadow rays through, and origin and density of the ray still weigh lights rightly.

Only the grey part of a tint can be skipped that way, for a skipped candidate leaves no trace in the record. What
a coloured glass adds in its stronger channels is a lobe of the shader: straight on, by a ray of its own.
With opacity a, transmission q (after Fresnel) and tint c:

    passes in the filter    1 - a + a q min(c)
    shaded                  a (1 - q min(c)), of which straight on with tint  a q (c - min(c))

No other ray finds a punctual light, though, so a shadow ray towards one must carry the tint itself: of its three
channels those pass for which the number drawn is below 1 - a + a q c, and the others are set to 0 in the record.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.arrays import Feature, MaterialColumn
from scenefold.render.bsdf_kernels import dielectric_reflection
from scenefold.render.clear_coat_kernels import coat_share
from scenefold.render.energy_kernels import albedo_of, bounced, left_of, rough_of
from scenefold.render.ggx_albedo import ALPHA_MIN
from scenefold.render.precise_kernels import mix64
from scenefold.render.texture_kernels import sample_use

ALPHA_MASK = 1.0
ALPHA_BLEND = 2.0

_BASE, _METALLIC, _ROUGHNESS, _TRANSMISSION, _IOR = (
    MaterialColumn.BASE,
    MaterialColumn.METALLIC,
    MaterialColumn.ROUGHNESS,
    MaterialColumn.TRANSMISSION,
    MaterialColumn.IOR,
)
_ALPHA_MODE, _ALPHA_CUTOFF = MaterialColumn.ALPHA_MODE, MaterialColumn.ALPHA_CUTOFF
_BASE_USE, _MR_USE = MaterialColumn.BASE_USE, MaterialColumn.METALLIC_ROUGHNESS_USE
_TRANSMISSION_USE, _SPECULAR_USE, _SPECULAR_COLOR_USE = (
    MaterialColumn.TRANSMISSION_USE,
    MaterialColumn.SPECULAR_USE,
    MaterialColumn.SPECULAR_COLOR_USE,
)
_CLEARCOAT, _CLEARCOAT_USE = MaterialColumn.CLEARCOAT, MaterialColumn.CLEARCOAT_USE
_SPECULAR, _SPECULAR_COLOR = MaterialColumn.SPECULAR, MaterialColumn.SPECULAR_COLOR
_FEATURES, _SCATTERS = MaterialColumn.FEATURES, Feature.ROUGH_TRANSMISSION | Feature.SOLID


@njit(error_model="numpy", _nrt=False, forceinline=True)
def is_see_through(row):  # type: ignore[no-untyped-def]
    """Whether anything can pass a material: float32[MaterialColumn.WIDTH]."""
    # A texture may take back what the factor says of metal.
    transmits = row[_TRANSMISSION] > 0.0 and (int(row[_FEATURES]) & _SCATTERS) == 0
    return row[_ALPHA_MODE] != 0.0 or (transmits and (row[_METALLIC] < 1.0 or row[_MR_USE] >= 0.0))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def opacity(row, alpha):  # type: ignore[no-untyped-def]
    """Of a material whose base colour has this alpha."""
    if row[_ALPHA_MODE] == ALPHA_MASK:
        return 1.0 if alpha >= row[_ALPHA_CUTOFF] else 0.0
    if row[_ALPHA_MODE] == ALPHA_BLEND:
        return min(max(alpha, 0.0), 1.0)
    return 1.0


@njit(error_model="numpy", _nrt=False, forceinline=True)
def is_surely_opaque(mode, cutoff, alpha, base_use, vertex_alpha):  # type: ignore[no-untyped-def]
    """Whether alpha hides nothing of a material anywhere (lanes, or numbers); next-event estimation asks no other emitters.

    It would have to know alpha at the point that it samples, and the texels and vertices there are held elsewhere.
    """
    whole = ((mode == ALPHA_MASK) & (alpha >= cutoff)) | ((mode == ALPHA_BLEND) & (alpha >= 1.0))
    return (mode == 0.0) | ((base_use < 0.0) & (vertex_alpha == 0.0) & whole)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def passed_share(transmission, reflection, metallic, alpha, coat, cosine):  # type: ignore[no-untyped-def]
    """q: how much of the light that meets the surface at this cosine passes straight on, before tint (lanes, or numbers)."""
    strongest, f90, rough = max(reflection[0], max(reflection[1], reflection[2])), reflection[3], rough_of(alpha)
    missing, grazing = albedo_of(rough, cosine)
    left = left_of(strongest, f90, bounced(strongest, f90, rough), missing, grazing)
    return transmission * (1.0 - metallic) * left * (1.0 - coat_share(coat, cosine))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def cosine_at(scene, triangle, matrix, normal_matrix, dx, dy, dz):  # type: ignore[no-untyped-def]
    """The cosine, in the world, at which a ray along d meets a triangle; d is in the triangle's own space.

    matrix f64[3, 4] and normal_matrix f64[3, 3] are its instance's: angles change where scales differ.
    """
    i0, i1, i2 = scene.triangles[triangle, 0], scene.triangles[triangle, 1], scene.triangles[triangle, 2]
    p, m, k = scene.vertices, matrix, normal_matrix
    x0, y0, z0 = float(p[i0, 0]), float(p[i0, 1]), float(p[i0, 2])
    ux, uy, uz = p[i1, 0] - x0, p[i1, 1] - y0, p[i1, 2] - z0
    vx, vy, vz = p[i2, 0] - x0, p[i2, 1] - y0, p[i2, 2] - z0
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nx, ny, nz = (
        k[0, 0] * nx + k[0, 1] * ny + k[0, 2] * nz,
        k[1, 0] * nx + k[1, 1] * ny + k[1, 2] * nz,
        k[2, 0] * nx + k[2, 1] * ny + k[2, 2] * nz,
    )
    dx, dy, dz = (
        m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz,
        m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz,
        m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz,
    )
    squared = (nx * nx + ny * ny + nz * nz) * (dx * dx + dy * dy + dz * dz)
    return abs(nx * dx + ny * dy + nz * dz) / math.sqrt(max(squared, 1e-60))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def pass_shares(scene, triangle, u, v, cosine):  # type: ignore[no-untyped-def]
    """Which shares (red, green, blue) of light that meets a triangle at barycentric (u, v) pass straight on.

    The least of the three is the chance with which a ray that carries all channels passes unchanged.
    """
    row = scene.materials[int(scene.triangle_material[triangle])]
    if not is_see_through(row):
        return 0.0, 0.0, 0.0
    i0, i1, i2 = scene.triangles[triangle, 0], scene.triangles[triangle, 1], scene.triangles[triangle, 2]
    r, g, b, alpha, metallic = row[_BASE], row[_BASE + 1], row[_BASE + 2], row[_BASE + 3], row[_METALLIC]
    w = 1.0 - u - v
    base, rough, clear = int(row[_BASE_USE]), int(row[_MR_USE]), int(row[_TRANSMISSION_USE])
    weights, tints = int(row[_SPECULAR_USE]), int(row[_SPECULAR_COLOR_USE])
    coats, coat = int(row[_CLEARCOAT_USE]), float(row[_CLEARCOAT])
    roughness = float(row[_ROUGHNESS])
    transmission, weight = float(row[_TRANSMISSION]), float(row[_SPECULAR])
    sr, sg, sb = float(row[_SPECULAR_COLOR]), float(row[_SPECULAR_COLOR + 1]), float(row[_SPECULAR_COLOR + 2])
    if base >= 0 or rough >= 0 or clear >= 0 or weights >= 0 or tints >= 0 or coats >= 0:
        tu = w * scene.uvs[i0, 0] + u * scene.uvs[i1, 0] + v * scene.uvs[i2, 0]
        tv = w * scene.uvs[i0, 1] + u * scene.uvs[i1, 1] + v * scene.uvs[i2, 1]
        tu2, tv2 = tu, tv
        if scene.has_uvs2:
            tu2 = w * scene.uvs2[i0, 0] + u * scene.uvs2[i1, 0] + v * scene.uvs2[i2, 0]
            tv2 = w * scene.uvs2[i0, 1] + u * scene.uvs2[i1, 1] + v * scene.uvs2[i2, 1]
        if base >= 0:
            tr, tg, tb, ta = sample_use(scene, base, tu, tv, tu2, tv2)
            r, g, b, alpha = r * tr, g * tg, b * tb, alpha * ta
        if rough >= 0:
            _, tg, tb, _ = sample_use(scene, rough, tu, tv, tu2, tv2)
            roughness, metallic = roughness * tg, metallic * tb
        if clear >= 0:
            tr, _, _, _ = sample_use(scene, clear, tu, tv, tu2, tv2)
            transmission *= tr
        if coats >= 0:
            tr, _, _, _ = sample_use(scene, coats, tu, tv, tu2, tv2)
            coat *= tr
        if weights >= 0:
            _, _, _, ta = sample_use(scene, weights, tu, tv, tu2, tv2)
            weight *= ta
        if tints >= 0:
            tr, tg, tb, _ = sample_use(scene, tints, tu, tv, tu2, tv2)
            sr, sg, sb = sr * tr, sg * tg, sb * tb
    if scene.has_colors:
        c = scene.colors
        r *= w * c[i0, 0] + u * c[i1, 0] + v * c[i2, 0]
        g *= w * c[i0, 1] + u * c[i1, 1] + v * c[i2, 1]
        b *= w * c[i0, 2] + u * c[i1, 2] + v * c[i2, 2]
        alpha *= w * c[i0, 3] + u * c[i1, 3] + v * c[i2, 3]
    a = opacity(row, alpha)
    if not transmission > 0.0 or (int(row[_FEATURES]) & _SCATTERS) != 0:
        return 1.0 - a, 1.0 - a, 1.0 - a
    reflection = dielectric_reflection(float(row[_IOR]), weight, sr, sg, sb)
    passed = a * passed_share(transmission, reflection, metallic, max(roughness * roughness, ALPHA_MIN), coat, cosine)
    return 1.0 - a + passed * r, 1.0 - a + passed * g, 1.0 - a + passed * b


@njit(error_model="numpy", _nrt=False, forceinline=True)
def skip_draw(key, bounce_and_kind, instance, group, primitive):  # type: ignore[no-untyped-def]
    """A number in [0, 1) for one candidate of one ray; equal wherever and however often it is asked for."""
    name = mix64((np.uint64(instance) << np.uint64(32)) ^ np.uint64(primitive))
    name = mix64(name + (np.uint64(group) << np.uint64(16)) + np.uint64(bounce_and_kind) + np.uint64(1))
    return float(mix64(key ^ name) >> np.uint64(11)) * (1.0 / 9007199254740992.0)
