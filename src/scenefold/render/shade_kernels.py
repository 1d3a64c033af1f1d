"""The shader: what happens where a cast ray ended.

One batch in, at most two rays a hit out (a bounce and a shadow ray), contributions into integer sums per path.
Every number depends on the record, the scene and the job alone, never on the batch (rendering.md, Bits).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, KIND_POINT_SHADOW, KIND_SHADOW, PDF_DELTA
from scenefold.render.arrays import MaterialColumn
from scenefold.render.bsdf_kernels import (
    ALPHA_MIN,
    coat_probability,
    evaluate,
    frame_of,
    luminance,
    sample_cosine,
    sample_visible_normal,
)
from scenefold.render.generate_kernels import depth_of
from scenefold.render.light_kernels import emitter_pdf, sample_light, sky_pdf
from scenefold.render.math_kernels import (
    decode_color,
    decode_direction,
    decode_pdf,
    encode_color,
    encode_direction,
    encode_pdf,
    path_key,
    uniform,
)
from scenefold.render.record_kernels import (
    bounce_of,
    color_code_of,
    is_shadow_ray,
    kind_of,
    origin_of,
    path_of,
    pdf_code_of,
    write_path_ray,
    write_shadow_ray,
)
from scenefold.render.see_through_kernels import is_surely_opaque, passed_share
from scenefold.render.space_kernels import diagonal_of_box, offset_origin
from scenefold.render.texture_kernels import sample_texture

STATUS_FORWARD = 0
"""Nothing hit in this cell; the ray goes on elsewhere."""
STATUS_HIT = 1
STATUS_FREE = 2
"""Left the job's box (path ray) or reached its end (shadow ray)."""
STATUS_DEAD = 3
"""A shadow ray that met something."""

SUM_UNIT = 4294967296.0
"""Sums count units of 2^-32."""
SUM_MAX = 16777216.0
"""Contributions at or above this radiance are clamped and counted: a path's 64 at most cannot overflow its sum."""
AOV_COLUMNS = 8
"""albedo 3, normal 3, depth as a share of the box's diagonal, hit: all times AOV_UNIT."""
AOV_UNIT = 16777216.0

COUNT_SHADOW_RAYS = 0
COUNT_NOT_FINITE = 1
COUNT_CLAMPED = 2

DIMENSION_BSDF_U = 0
DIMENSION_BSDF_V = 1
DIMENSION_LOBE = 2
DIMENSION_ROULETTE = 7
DIMENSION_THROUGHPUT = 8
DIMENSION_CONTRIBUTION = 12
ROULETTE_FROM = 3

_BASE, _METALLIC, _ROUGHNESS, _EMISSION = (
    MaterialColumn.BASE,
    MaterialColumn.METALLIC,
    MaterialColumn.ROUGHNESS,
    MaterialColumn.EMISSION,
)
_TRANSMISSION, _IOR, _DOUBLE_SIDED = MaterialColumn.TRANSMISSION, MaterialColumn.IOR, MaterialColumn.DOUBLE_SIDED
_BASE_TEXTURE, _MR_TEXTURE = MaterialColumn.BASE_TEXTURE, MaterialColumn.METALLIC_ROUGHNESS_TEXTURE
_WRAP_S, _WRAP_T, _NEAREST = MaterialColumn.WRAP_S, MaterialColumn.WRAP_T, MaterialColumn.NEAREST


@njit(error_model="numpy", _nrt=False)
def _add(sums, counters, path, r, g, b):  # type: ignore[no-untyped-def]
    """Add a contribution to its path, in whole units of 2^-32, so that any order gives the same sum."""
    total = r + g + b
    if not (total >= 0.0 and total < math.inf):
        counters[COUNT_NOT_FINITE] += 1
        return
    if max(r, max(g, b)) >= SUM_MAX:
        counters[COUNT_CLAMPED] += 1
        r, g, b = min(r, SUM_MAX), min(g, SUM_MAX), min(b, SUM_MAX)
    sums[path, 0] += np.int64(r * SUM_UNIT + 0.5)
    sums[path, 1] += np.int64(g * SUM_UNIT + 0.5)
    sums[path, 2] += np.int64(b * SUM_UNIT + 0.5)


@njit(error_model="numpy", _nrt=False)
def _surface(scene, triangle, instance, u, v):  # type: ignore[no-untyped-def]
    """World point, geometric normal by winding, shading normal, and texture coordinates of a hit."""
    i0, i1, i2 = scene.triangles[triangle, 0], scene.triangles[triangle, 1], scene.triangles[triangle, 2]
    w = 1.0 - u - v
    p, n, t = scene.vertices, scene.normals, scene.uvs
    x0, y0, z0 = float(p[i0, 0]), float(p[i0, 1]), float(p[i0, 2])
    e1x, e1y, e1z = p[i1, 0] - x0, p[i1, 1] - y0, p[i1, 2] - z0
    e2x, e2y, e2z = p[i2, 0] - x0, p[i2, 1] - y0, p[i2, 2] - z0
    px, py, pz = x0 + u * e1x + v * e2x, y0 + u * e1y + v * e2y, z0 + u * e1z + v * e2z
    gx, gy, gz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    sx = w * n[i0, 0] + u * n[i1, 0] + v * n[i2, 0]
    sy = w * n[i0, 1] + u * n[i1, 1] + v * n[i2, 1]
    sz = w * n[i0, 2] + u * n[i1, 2] + v * n[i2, 2]
    if instance != 0:
        m, k = scene.instance_matrices[instance], scene.instance_normals[instance]
        px, py, pz = (
            m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3],
            m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3],
            m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3],
        )
        gx, gy, gz = (
            k[0, 0] * gx + k[0, 1] * gy + k[0, 2] * gz,
            k[1, 0] * gx + k[1, 1] * gy + k[1, 2] * gz,
            k[2, 0] * gx + k[2, 1] * gy + k[2, 2] * gz,
        )
        sx, sy, sz = (
            k[0, 0] * sx + k[0, 1] * sy + k[0, 2] * sz,
            k[1, 0] * sx + k[1, 1] * sy + k[1, 2] * sz,
            k[2, 0] * sx + k[2, 1] * sy + k[2, 2] * sz,
        )
    scale = 1.0 / math.sqrt(max(gx * gx + gy * gy + gz * gz, 1e-60))
    gx, gy, gz = gx * scale, gy * scale, gz * scale
    squared = sx * sx + sy * sy + sz * sz
    if squared > 1e-12:
        scale = 1.0 / math.sqrt(squared)
        sx, sy, sz = sx * scale, sy * scale, sz * scale
    else:
        sx, sy, sz = gx, gy, gz
    tu = w * t[i0, 0] + u * t[i1, 0] + v * t[i2, 0]
    tv = w * t[i0, 1] + u * t[i1, 1] + v * t[i2, 1]
    return px, py, pz, gx, gy, gz, sx, sy, sz, tu, tv


@njit(error_model="numpy", _nrt=False)
def _material(scene, material, tu, tv):  # type: ignore[no-untyped-def]
    """Base colour, metallic and roughness with their textures applied."""
    row = scene.materials[material]
    r, g, b, metallic, roughness = row[_BASE], row[_BASE + 1], row[_BASE + 2], row[_METALLIC], row[_ROUGHNESS]
    wrap_s, wrap_t, nearest = int(row[_WRAP_S]), int(row[_WRAP_T]), row[_NEAREST] != 0.0
    texture = int(row[_BASE_TEXTURE])
    if texture >= 0:
        tr, tg, tb, _ = sample_texture(scene.textures, scene.texels, scene.linear_of_srgb, texture, tu, tv, wrap_s, wrap_t, nearest)
        r, g, b = r * tr, g * tg, b * tb
    texture = int(row[_MR_TEXTURE])
    if texture >= 0:
        _, tg, tb, _ = sample_texture(scene.textures, scene.texels, scene.linear_of_srgb, texture, tu, tv, wrap_s, wrap_t, nearest)
        roughness, metallic = roughness * tg, metallic * tb
    return r, g, b, metallic, max(roughness * roughness, ALPHA_MIN)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def shade_batch(rays, status, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, out):  # type: ignore[no-untyped-def]
    """Shade a cast batch; returns how many new rays were written to `out`.

    rays uint32[n, 9]; status uint8[n]; hit_uv float32[n, 2]; hit_ids uint32[n, 3]: instance, group, primitive;
    first_path: global number of the pass's path 0; sums int64[paths, 3]; aovs int32[paths, AOV_COLUMNS];
    counters int64[COUNTERS]; out uint32[>= 2 n, 9], rays with t_done 0.
    """
    made = 0
    for i in range(rays.shape[0]):
        shadow = is_shadow_ray(rays, i)
        if shadow:
            counters[COUNT_SHADOW_RAYS] += 1
        if status[i] == STATUS_FORWARD or status[i] == STATUS_DEAD:
            continue
        path = path_of(rays, i)
        r, g, b = decode_color(color_code_of(rays, i))
        if shadow:
            _add(sums, counters, path, r, g, b)
            continue
        pdf_code = pdf_code_of(rays, i)
        if status[i] == STATUS_FREE:
            weight = 1.0
            if pdf_code != PDF_DELTA:
                pdf, other = decode_pdf(pdf_code), sky_pdf(job)
                weight = pdf * pdf / (pdf * pdf + other * other)
            _add(sums, counters, path, r * job.sky[0] * weight, g * job.sky[1] * weight, b * job.sky[2] * weight)
            continue
        made = _shade_hit(rays, i, hit_uv, hit_ids, scene, job, first_path + path, path, r, g, b, pdf_code, sums, aovs, counters, out, made)
    return made


@njit(error_model="numpy", _nrt=False)
def _shade_hit(rays, i, hit_uv, hit_ids, scene, job, number, path, r, g, b, pdf_code, sums, aovs, counters, out, made):  # type: ignore[no-untyped-def]
    bounce = bounce_of(rays, i)
    ox, oy, oz = origin_of(rays, i)
    dx, dy, dz = decode_direction(rays[i, 3], rays[i, 4])
    instance = int(hit_ids[i, 0])
    triangle = scene.group_first[hit_ids[i, 1]] + int(hit_ids[i, 2])
    px, py, pz, gx, gy, gz, sx, sy, sz, tu, tv = _surface(scene, triangle, instance, float(hit_uv[i, 0]), float(hit_uv[i, 1]))
    material = int(scene.triangle_material[triangle])
    row = scene.materials[material]
    base_r, base_g, base_b, metallic, alpha = _material(scene, material, tu, tv)
    facing = -(dx * gx + dy * gy + dz * gz)
    front = facing > 0.0
    if not front:
        gx, gy, gz, facing = -gx, -gy, -gz, -facing
    if sx * gx + sy * gy + sz * gz < 0.0:
        sx, sy, sz = -sx, -sy, -sz
    if -(dx * sx + dy * sy + dz * sz) <= 1e-4:
        sx, sy, sz = gx, gy, gz
    qx, qy, qz = px - ox, py - oy, pz - oz
    squared = qx * qx + qy * qy + qz * qz

    diagonal = diagonal_of_box(job.box_low, job.box_high)

    if kind_of(rays, i) == KIND_CAMERA:
        aovs[path, 0] = np.int32(min(base_r, 100.0) * AOV_UNIT + 0.5)
        aovs[path, 1] = np.int32(min(base_g, 100.0) * AOV_UNIT + 0.5)
        aovs[path, 2] = np.int32(min(base_b, 100.0) * AOV_UNIT + 0.5)
        aovs[path, 3] = np.int32(math.floor(sx * AOV_UNIT + 0.5))
        aovs[path, 4] = np.int32(math.floor(sy * AOV_UNIT + 0.5))
        aovs[path, 5] = np.int32(math.floor(sz * AOV_UNIT + 0.5))
        aovs[path, 6] = np.int32(min(depth_of(job, px, py, pz) / diagonal, 100.0) * AOV_UNIT + 0.5)
        aovs[path, 7] = np.int32(1)

    # What the caster's filter lets pass is not shaded; what is shaded stands for the rest (see_through_kernels).
    through, tint_r, tint_g, tint_b = 0.0, 0.0, 0.0, 0.0
    if row[_TRANSMISSION] > 0.0 and metallic < 1.0:
        share = passed_share(row, metallic, facing)
        least, most = min(base_r, min(base_g, base_b)), max(base_r, max(base_g, base_b))
        left = 1.0 - share * least
        if not left > 1e-9:
            return made
        r, g, b = r / left, g / left, b / left
        if most > least:
            through = share * (most - least)
            tint_r, tint_g, tint_b = (base_r - least) / (most - least), (base_g - least) / (most - least), (base_b - least) / (most - least)
    emission_r, emission_g, emission_b = row[_EMISSION], row[_EMISSION + 1], row[_EMISSION + 2]
    if (front or row[_DOUBLE_SIDED] != 0.0) and emission_r + emission_g + emission_b > 0.0:
        weight = 1.0
        if pdf_code != PDF_DELTA and facing > 1e-6 and is_surely_opaque(row):
            pdf, other = decode_pdf(pdf_code), emitter_pdf(job, emission_r, emission_g, emission_b, squared, facing)
            weight = pdf * pdf / (pdf * pdf + other * other)
        _add(sums, counters, path, r * emission_r * weight, g * emission_g * weight, b * emission_b * weight)
    if bounce + 1 >= job.depth:
        return made

    pixels = job.width * job.height
    key = path_key(job.seed, job.frame, (number % pixels) * job.stride % pixels, number // pixels)
    transmission = row[_TRANSMISSION]
    ratio = (row[_IOR] - 1.0) / (row[_IOR] + 1.0)
    f0 = ratio * ratio
    ax, ay, az, bx, by, bz = frame_of(sx, sy, sz)
    wox = -(dx * ax + dy * ay + dz * az)
    woy = -(dx * bx + dy * by + dz * bz)
    woz = -(dx * sx + dy * sy + dz * sz)
    coat = coat_probability(woz, base_r, base_g, base_b, metallic, f0, transmission)
    fx, fy, fz = offset_origin(px, py, pz, gx, gy, gz, diagonal)

    # A shadow ray towards one light sample.
    found, wx, wy, wz, ex, ey, ez, lr, lg, lb, light_pdf = sample_light(
        scene, job, key, bounce, float(fx), float(fy), float(fz), gx, gy, gz
    )
    if found and wx * gx + wy * gy + wz * gz > 0.0:
        wix, wiy, wiz = wx * ax + wy * ay + wz * az, wx * bx + wy * by + wz * bz, wx * sx + wy * sy + wz * sz
        vr, vg, vb, pdf = evaluate(wox, woy, woz, wix, wiy, wiz, base_r, base_g, base_b, metallic, alpha, f0, transmission, coat)
        weight = wiz
        if light_pdf > 0.0:
            quantised = decode_pdf(encode_pdf(pdf * (1.0 - through)))
            weight *= light_pdf * light_pdf / (light_pdf * light_pdf + quantised * quantised)
        cr, cg, cb = r * vr * lr * weight, g * vg * lg * weight, b * vb * lb * weight
        if not cr + cg + cb < math.inf:
            counters[COUNT_NOT_FINITE] += 1
        elif cr + cg + cb > 0.0:
            code = encode_color(cr, cg, cb, key, bounce, DIMENSION_CONTRIBUTION)
            kind = KIND_SHADOW if light_pdf > 0.0 else KIND_POINT_SHADOW
            write_shadow_ray(out, made, fx, fy, fz, np.float32(ex), np.float32(ey), np.float32(ez), code, path, kind, bounce)
            made += 1

    # The path goes on: straight through, off the coat, or off the diffuse body.
    lobe = uniform(key, bounce, DIMENSION_LOBE)
    u, v = uniform(key, bounce, DIMENSION_BSDF_U), uniform(key, bounce, DIMENSION_BSDF_V)
    if lobe < through:
        r, g, b = r * tint_r, g * tint_g, b * tint_b
        fx, fy, fz = offset_origin(px, py, pz, -gx, -gy, -gz, diagonal)
        code_u, code_v, next_pdf = rays[i, 3], rays[i, 4], PDF_DELTA
    else:
        if (lobe - through) < coat * (1.0 - through):
            hx, hy, hz = sample_visible_normal(wox, woy, woz, alpha, u, v)
            cosine = 2.0 * (wox * hx + woy * hy + woz * hz)
            wix, wiy, wiz = cosine * hx - wox, cosine * hy - woy, cosine * hz - woz
        else:
            wix, wiy, wiz = sample_cosine(u, v)
        if wiz <= 0.0:
            return made
        code_u, code_v = encode_direction(wix * ax + wiy * bx + wiz * sx, wix * ay + wiy * by + wiz * sy, wix * az + wiy * bz + wiz * sz)
        # From here on the direction is what its code says: the density too is that of the coded direction.
        wx, wy, wz = decode_direction(code_u, code_v)
        if wx * gx + wy * gy + wz * gz <= 0.0:
            return made
        wix, wiy, wiz = wx * ax + wy * ay + wz * az, wx * bx + wy * by + wz * bz, wx * sx + wy * sy + wz * sz
        vr, vg, vb, pdf = evaluate(wox, woy, woz, wix, wiy, wiz, base_r, base_g, base_b, metallic, alpha, f0, transmission, coat)
        pdf *= 1.0 - through
        if not pdf > 0.0:
            return made
        weight = wiz / pdf
        r, g, b = r * vr * weight, g * vg * weight, b * vb * weight
        next_pdf = encode_pdf(pdf)
    if not r + g + b < math.inf:
        counters[COUNT_NOT_FINITE] += 1
        return made
    if bounce + 1 >= ROULETTE_FROM:
        survive = min(max(r, max(g, b)), 0.95)
        if uniform(key, bounce, DIMENSION_ROULETTE) >= survive:
            return made
        r, g, b = r / survive, g / survive, b / survive
    code = encode_color(r, g, b, key, bounce, DIMENSION_THROUGHPUT)
    if code != np.uint64(0) and luminance(r, g, b) > 0.0:
        write_path_ray(out, made, fx, fy, fz, code_u, code_v, next_pdf, code, path, KIND_BOUNCE, bounce + 1, 0)
        made += 1
    return made
