"""The shader: what happens where a cast ray ended.

One batch in, at most two rays a hit out (a bounce and a shadow ray), contributions into integer sums per path.
Every number depends on the record, the scene and the job alone, never on the batch (rendering.md, Bits).

What ended without a hit is dealt with ray by ray. Hits go through the surface in lanes, four at a time, whichever
they are: what one of them does not need is computed and left.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, KIND_POINT_SHADOW, KIND_SHADOW, PDF_DELTA
from scenefold.render.arrays import MaterialColumn
from scenefold.render.bsdf_kernels import (
    coat_probability,
    evaluate,
    frame_of,
    luminance,
    sample_cosine,
    sample_visible_normal,
)
from scenefold.render.generate_kernels import depth_of
from scenefold.render.lane_values_kernels import (
    alike,
    any_lane,
    gather,
    lane_of,
    no_flags,
    no_words,
    opposite,
    real_of_word,
    select,
    with_lane,
)
from scenefold.render.lanes_kernels import LANES
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
    color_code_of,
    is_shadow_ray,
    path_of,
    pdf_code_of,
    read_hit_rays,
    write_path_ray,
    write_shadow_ray,
)
from scenefold.render.see_through_kernels import is_surely_opaque, passed_share
from scenefold.render.space_kernels import diagonal_of_box, offset_origin
from scenefold.render.surface_kernels import material_at, surface_at

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
_BASE_TEXTURE = MaterialColumn.BASE_TEXTURE
_ALPHA_MODE, _ALPHA_CUTOFF = MaterialColumn.ALPHA_MODE, MaterialColumn.ALPHA_CUTOFF


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


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def shade_batch(rays, status, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, hits, out):  # type: ignore[no-untyped-def]
    """Shade a cast batch; returns how many new rays were written to `out`.

    rays uint32[n, 9]; status uint8[n]; hit_uv float32[n, 2]; hit_ids uint32[n, 3]: instance, group, primitive;
    first_path: global number of the pass's path 0; sums int64[paths, 3]; aovs int32[paths, AOV_COLUMNS];
    counters int64[COUNTERS]; hits int64[>= n], scratch; out uint32[>= 2 n, 9], rays with t_done 0.
    """
    count = 0
    for i in range(rays.shape[0]):
        if status[i] == STATUS_HIT:
            hits[count] = i
            count += 1
            # Shadow rays that hit are dead: the caster says so.
            continue
        shadow = is_shadow_ray(rays, i)
        if shadow:
            counters[COUNT_SHADOW_RAYS] += 1
        if status[i] != STATUS_FREE:
            continue
        path = path_of(rays, i)
        r, g, b = decode_color(color_code_of(rays, i))
        if shadow:
            _add(sums, counters, path, r, g, b)
            continue
        pdf_code = pdf_code_of(rays, i)
        weight = 1.0
        if pdf_code != PDF_DELTA:
            pdf, other = decode_pdf(pdf_code), sky_pdf(job)
            weight = pdf * pdf / (pdf * pdf + other * other)
        _add(sums, counters, path, r * job.sky[0] * weight, g * job.sky[1] * weight, b * job.sky[2] * weight)
    made = 0
    for first in range(0, count, LANES):
        made = _shade_hits(rays, hits, first, count, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, out, made)
    return made


@njit(error_model="numpy", _nrt=False)
def _shade_hits(rays, hits, first, count, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, out, made):  # type: ignore[no-untyped-def]
    """Hits first .. first + LANES - 1; where there are fewer, lanes that are left shade the last one again, and nothing comes of them."""
    at, live = no_words(), no_flags()
    for k in range(LANES):
        at = with_lane(at, k, hits[min(first + k, count - 1)])
        live = with_lane(live, k, first + k < count)
    ray = read_hit_rays(rays, at)
    instance = gather(hit_ids, (at, 0))
    triangle = gather(scene.group_first, (gather(hit_ids, (at, 1)),)) + gather(hit_ids, (at, 2))
    u, v = gather(hit_uv, (at, 0)), gather(hit_uv, (at, 1))
    px, py, pz, gx, gy, gz, sx, sy, sz, tu, tv = surface_at(scene, triangle, instance, u, v)
    rows = scene.materials
    material = gather(scene.triangle_material, (triangle,))
    base_r, base_g, base_b, metallic, alpha = material_at(scene, material, tu, tv)
    dx, dy, dz = decode_direction(ray.code_u, ray.code_v)
    facing = -(dx * gx + dy * gy + dz * gz)
    front = facing > 0.0
    gx, gy, gz, facing = select(front, gx, -gx), select(front, gy, -gy), select(front, gz, -gz), select(front, facing, -facing)
    inwards = sx * gx + sy * gy + sz * gz < 0.0
    sx, sy, sz = select(inwards, -sx, sx), select(inwards, -sy, sy), select(inwards, -sz, sz)
    hidden = -(dx * sx + dy * sy + dz * sz) <= 1e-4
    sx, sy, sz = select(hidden, gx, sx), select(hidden, gy, sy), select(hidden, gz, sz)
    qx, qy, qz = px - ray.x, py - ray.y, pz - ray.z
    squared = qx * qx + qy * qy + qz * qz

    diagonal = diagonal_of_box(job.box_low, job.box_high)
    _note_first_hits(live & (ray.kind == np.uint64(KIND_CAMERA)), ray, job, diagonal, base_r, base_g, base_b, sx, sy, sz, px, py, pz, aovs)

    # What the caster's filter lets pass is not shaded; what is shaded stands for the rest (see_through_kernels).
    r, g, b = decode_color(ray.color)
    through, tint_r, tint_g, tint_b = alike(0.0, px), alike(0.0, px), alike(0.0, px), alike(0.0, px)
    transmission, ior = gather(rows, (material, _TRANSMISSION)), gather(rows, (material, _IOR))
    clear = (transmission > 0.0) & (metallic < 1.0)
    if any_lane(clear):
        share = passed_share(transmission, ior, metallic, facing)
        least, most = min(base_r, min(base_g, base_b)), max(base_r, max(base_g, base_b))
        left = 1.0 - share * least
        live = live & (opposite(clear) | (left > 1e-9))
        r, g, b = select(clear, r / left, r), select(clear, g / left, g), select(clear, b / left, b)
        tinted = clear & (most > least)
        range_ = select(tinted, most - least, 1.0)
        through = select(tinted, share * (most - least), 0.0)
        tint_r, tint_g, tint_b = (base_r - least) / range_, (base_g - least) / range_, (base_b - least) / range_
    emission_r, emission_g, emission_b = (
        gather(rows, (material, _EMISSION)),
        gather(rows, (material, _EMISSION + 1)),
        gather(rows, (material, _EMISSION + 2)),
    )
    shines = live & (front | (gather(rows, (material, _DOUBLE_SIDED)) != 0.0)) & (emission_r + emission_g + emission_b > 0.0)
    if any_lane(shines):
        opaque = is_surely_opaque(
            gather(rows, (material, _ALPHA_MODE)), gather(rows, (material, _ALPHA_CUTOFF)),
            gather(rows, (material, _BASE + 3)), gather(rows, (material, _BASE_TEXTURE)),
        )  # fmt: skip
        pdf, other = decode_pdf(ray.pdf), emitter_pdf(job, emission_r, emission_g, emission_b, squared, facing)
        weight = select((ray.pdf != np.uint64(PDF_DELTA)) & (facing > 1e-6) & opaque, pdf * pdf / (pdf * pdf + other * other), 1.0)
        for k in range(LANES):
            if lane_of(shines, k):
                w = lane_of(weight, k)
                _add(
                    sums, counters, lane_of(ray.path, k),
                    lane_of(r, k) * lane_of(emission_r, k) * w,
                    lane_of(g, k) * lane_of(emission_g, k) * w,
                    lane_of(b, k) * lane_of(emission_b, k) * w,
                )  # fmt: skip
    live = live & (real_of_word(ray.bounce) + 1.0 < job.depth)
    if not any_lane(live):
        return made

    pixels = np.uint64(job.width * job.height)
    number = ray.path + np.uint64(first_path)
    sample = number // pixels
    key = path_key(job.seed, job.frame, (number - sample * pixels) * np.uint64(job.stride) % pixels, sample)
    ratio = (ior - 1.0) / (ior + 1.0)
    f0 = ratio * ratio
    ax, ay, az, bx, by, bz = frame_of(sx, sy, sz)
    wox = -(dx * ax + dy * ay + dz * az)
    woy = -(dx * bx + dy * by + dz * bz)
    woz = -(dx * sx + dy * sy + dz * sz)
    coat = coat_probability(woz, base_r, base_g, base_b, metallic, f0, transmission)
    fx, fy, fz = offset_origin(px, py, pz, gx, gy, gz, diagonal)

    # A shadow ray towards one light sample.
    found, wx, wy, wz, ex, ey, ez, lr, lg, lb, light_pdf = sample_light(scene, job, key, ray.bounce, fx, fy, fz, gx, gy, gz)
    found = live & found & (wx * gx + wy * gy + wz * gz > 0.0)
    if any_lane(found):
        wix, wiy, wiz = wx * ax + wy * ay + wz * az, wx * bx + wy * by + wz * bz, wx * sx + wy * sy + wz * sz
        vr, vg, vb, pdf = evaluate(wox, woy, woz, wix, wiy, wiz, base_r, base_g, base_b, metallic, alpha, f0, transmission, coat)
        quantised = decode_pdf(encode_pdf(pdf * (1.0 - through)))
        finite = light_pdf > 0.0
        weight = wiz * select(finite, light_pdf * light_pdf / (light_pdf * light_pdf + quantised * quantised), 1.0)
        cr, cg, cb = r * vr * lr * weight, g * vg * lg * weight, b * vb * lb * weight
        code = encode_color(cr, cg, cb, key, ray.bounce, DIMENSION_CONTRIBUTION)
        total = cr + cg + cb
        for k in range(LANES):
            if not lane_of(found, k):
                continue
            if not lane_of(total, k) < math.inf:
                counters[COUNT_NOT_FINITE] += 1
            elif lane_of(total, k) > 0.0:
                write_shadow_ray(
                    out, made, np.float32(lane_of(fx, k)), np.float32(lane_of(fy, k)), np.float32(lane_of(fz, k)),
                    np.float32(lane_of(ex, k)), np.float32(lane_of(ey, k)), np.float32(lane_of(ez, k)),
                    lane_of(code, k), lane_of(ray.path, k), KIND_SHADOW if lane_of(finite, k) else KIND_POINT_SHADOW, lane_of(ray.bounce, k),
                )  # fmt: skip
                made += 1

    # The path goes on: straight through, off the coat, or off the diffuse body.
    lobe = uniform(key, ray.bounce, DIMENSION_LOBE)
    u, v = uniform(key, ray.bounce, DIMENSION_BSDF_U), uniform(key, ray.bounce, DIMENSION_BSDF_V)
    straight = lobe < through
    glossy = (lobe - through) < coat * (1.0 - through)
    wix, wiy, wiz = sample_cosine(u, v)
    if any_lane(glossy):
        hx, hy, hz = sample_visible_normal(wox, woy, woz, alpha, u, v)
        cosine = 2.0 * (wox * hx + woy * hy + woz * hz)
        wix, wiy, wiz = (
            select(glossy, cosine * hx - wox, wix),
            select(glossy, cosine * hy - woy, wiy),
            select(glossy, cosine * hz - woz, wiz),
        )
    above = wiz > 0.0
    code_u, code_v = encode_direction(wix * ax + wiy * bx + wiz * sx, wix * ay + wiy * by + wiz * sy, wix * az + wiy * bz + wiz * sz)
    # From here on the direction is what its code says: the density too is that of the coded direction.
    wx, wy, wz = decode_direction(code_u, code_v)
    wix, wiy, wiz = wx * ax + wy * ay + wz * az, wx * bx + wy * by + wz * bz, wx * sx + wy * sy + wz * sz
    vr, vg, vb, pdf = evaluate(wox, woy, woz, wix, wiy, wiz, base_r, base_g, base_b, metallic, alpha, f0, transmission, coat)
    pdf = pdf * (1.0 - through)
    live = live & (straight | (above & (wx * gx + wy * gy + wz * gz > 0.0) & (pdf > 0.0)))
    weight = wiz / pdf
    next_pdf = select(straight, np.uint64(PDF_DELTA), encode_pdf(pdf))
    r, g, b = (
        select(straight, r * tint_r, r * vr * weight),
        select(straight, g * tint_g, g * vg * weight),
        select(straight, b * tint_b, b * vb * weight),
    )
    if any_lane(live & straight):
        ox, oy, oz = offset_origin(px, py, pz, -gx, -gy, -gz, diagonal)
        fx, fy, fz = select(straight, ox, fx), select(straight, oy, fy), select(straight, oz, fz)
        code_u, code_v = select(straight, ray.code_u, code_u), select(straight, ray.code_v, code_v)
    finite = r + g + b < math.inf
    lost = live & opposite(finite)
    if any_lane(lost):
        for k in range(LANES):
            counters[COUNT_NOT_FINITE] += np.int64(lane_of(lost, k))
    live = live & finite
    gambles = real_of_word(ray.bounce) + 1.0 >= ROULETTE_FROM
    if any_lane(gambles):
        survive = select(gambles, min(max(r, max(g, b)), 0.95), 1.0)
        live = live & (uniform(key, ray.bounce, DIMENSION_ROULETTE) < survive)
        r, g, b = r / survive, g / survive, b / survive
    code = encode_color(r, g, b, key, ray.bounce, DIMENSION_THROUGHPUT)
    live = live & (code != np.uint64(0)) & (luminance(r, g, b) > 0.0)
    for k in range(LANES):
        if lane_of(live, k):
            write_path_ray(
                out, made, np.float32(lane_of(fx, k)), np.float32(lane_of(fy, k)), np.float32(lane_of(fz, k)),
                lane_of(code_u, k), lane_of(code_v, k), lane_of(next_pdf, k),
                lane_of(code, k), lane_of(ray.path, k), KIND_BOUNCE, lane_of(ray.bounce, k) + np.uint64(1), 0,
            )  # fmt: skip
            made += 1
    return made


@njit(error_model="numpy", _nrt=False)
def _note_first_hits(first, ray, job, diagonal, base_r, base_g, base_b, sx, sy, sz, px, py, pz, aovs):  # type: ignore[no-untyped-def]
    if not any_lane(first):
        return
    depth = min(depth_of(job, px, py, pz) / diagonal, 100.0)
    for k in range(LANES):
        if lane_of(first, k):
            path = lane_of(ray.path, k)
            aovs[path, 0] = np.int32(min(lane_of(base_r, k), 100.0) * AOV_UNIT + 0.5)
            aovs[path, 1] = np.int32(min(lane_of(base_g, k), 100.0) * AOV_UNIT + 0.5)
            aovs[path, 2] = np.int32(min(lane_of(base_b, k), 100.0) * AOV_UNIT + 0.5)
            aovs[path, 3] = np.int32(math.floor(lane_of(sx, k) * AOV_UNIT + 0.5))
            aovs[path, 4] = np.int32(math.floor(lane_of(sy, k) * AOV_UNIT + 0.5))
            aovs[path, 5] = np.int32(math.floor(lane_of(sz, k) * AOV_UNIT + 0.5))
            aovs[path, 6] = np.int32(lane_of(depth, k) * AOV_UNIT + 0.5)
            aovs[path, 7] = np.int32(1)
