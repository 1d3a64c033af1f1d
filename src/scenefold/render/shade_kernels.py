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
from scenefold.render.absorption_kernels import absorbed
from scenefold.render.arrays import Feature, MaterialColumn
from scenefold.render.clamp_kernels import clamped
from scenefold.render.dice_kernels import NOISE_CONTRIBUTION, NOISE_THROUGHPUT, PAIR_LOBE_ROULETTE, PAIR_SCATTER, dice_of, noise, pair
from scenefold.render.footprint_kernels import footprints_at
from scenefold.render.generate_kernels import depth_of
from scenefold.render.hit_kernels import Hit
from scenefold.render.lane_values_kernels import (
    alike,
    any_lane,
    bits_of,
    bits_of_flags,
    gather,
    lane_numbers,
    opposite,
    prefetch_row,
    put,
    select,
    take,
)
from scenefold.render.lanes_kernels import LANES
from scenefold.render.light_kernels import emitter_pdf, sample_light, sky_at
from scenefold.render.math_kernels import decode_color, decode_direction, decode_pdf, encode_color, encode_direction, encode_pdf
from scenefold.render.normal_map_kernels import mapped_normal
from scenefold.render.pixel_kernels import pixels_of
from scenefold.render.record_kernels import is_shadow_ray, kind_of, path_of, read_rays, write_rays
from scenefold.render.scattering_kernels import draw, seen, value
from scenefold.render.see_through_kernels import is_surely_opaque, passed_share
from scenefold.render.space_kernels import diagonal_of_box, offset_origin
from scenefold.render.sum_columns import ALL_AOVS, AOV_UNIT, CHANNELS, DEPTH, DEPTH_END, HIT, MATERIAL, OBJECT, POSITION, RADIANCE_UNIT
from scenefold.render.surface_kernels import coordinates_at, material_at, reach_at, surface_at, texture_of
from scenefold.render.transmission_kernels import scatters_through

STATUS_FORWARD = 0
"""Nothing hit in this cell; the ray goes on elsewhere."""
STATUS_HIT = 1
STATUS_FREE = 2
"""Left the job's box (path ray) or reached its end (shadow ray)."""
STATUS_DEAD = 3
"""A shadow ray that met something."""

SUM_MAX = 16777216.0
"""Contributions at or above this radiance are clamped and counted: a path's 64 at most cannot overflow its sum."""

COUNT_SHADOW_RAYS = 0
COUNT_NOT_FINITE = 1
COUNT_CLAMPED = 2

_UNLIT, _NORMAL_MAP, _SOLID = np.uint32(Feature.UNLIT), np.uint32(Feature.NORMAL_MAP), np.uint32(Feature.SOLID)
_EMISSIVE_MAP, _EMISSIVE, _EMISSIVE_USE = np.uint32(Feature.EMISSIVE_MAP), MaterialColumn.EMISSIVE, MaterialColumn.EMISSIVE_USE

_BASE, _METALLIC, _ROUGHNESS, _EMISSION = (
    MaterialColumn.BASE,
    MaterialColumn.METALLIC,
    MaterialColumn.ROUGHNESS,
    MaterialColumn.EMISSION,
)
_DOUBLE_SIDED = MaterialColumn.DOUBLE_SIDED
_NORMAL_USE, _NORMAL_SCALE = MaterialColumn.NORMAL_USE, MaterialColumn.NORMAL_SCALE
_BASE_USE, _VERTEX_ALPHA = MaterialColumn.BASE_USE, MaterialColumn.VERTEX_ALPHA
_ALPHA_MODE, _ALPHA_CUTOFF = MaterialColumn.ALPHA_MODE, MaterialColumn.ALPHA_CUTOFF


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _add(sums, counters, path, column, r, g, b):  # type: ignore[no-untyped-def]
    """Add a contribution to its path, from this column on, in whole units of 2^-32, so that any order gives the same sum."""
    total = r + g + b
    if not (total >= 0.0 and total < math.inf):
        counters[COUNT_NOT_FINITE] += 1
        return
    if max(r, max(g, b)) >= SUM_MAX:
        counters[COUNT_CLAMPED] += 1
        r, g, b = min(r, SUM_MAX), min(g, SUM_MAX), min(b, SUM_MAX)
    sums[path, column] += np.int64(r * RADIANCE_UNIT + 0.5)
    sums[path, column + 1] += np.int64(g * RADIANCE_UNIT + 0.5)
    sums[path, column + 2] += np.int64(b * RADIANCE_UNIT + 0.5)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _add_lanes(job, sums, counters, scratch, flags, path, scatterings, r, g, b):  # type: ignore[no-untyped-def]
    """Contributions of the flagged lanes; `scatterings`, words: how often their light was reflected (sum_columns.py)."""
    r, g, b = clamped(job, scatterings, r, g, b)
    reals = scratch.view(np.float32)
    put(scratch, 0, path)
    put(reals, LANES, r)
    put(reals, 2 * LANES, g)
    put(reals, 3 * LANES, b)
    put(scratch, 4 * LANES, scatterings)
    last = sums.shape[1] // CHANNELS - 1
    left = bits_of_flags(flags)
    for k in range(LANES):
        if (left >> k) & 1:
            _add(
                sums, counters, np.int64(scratch[k]), min(np.int64(scratch[4 * LANES + k]), last) * CHANNELS,
                np.float64(reals[LANES + k]), np.float64(reals[2 * LANES + k]), np.float64(reals[3 * LANES + k]),
            )  # fmt: skip


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _count_lanes(counters, counter, flags):  # type: ignore[no-untyped-def]
    left = bits_of_flags(flags)
    for k in range(LANES):
        counters[counter] += (left >> k) & 1


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _power_weight(pdf, other):  # type: ignore[no-untyped-def]
    """The power heuristic, beta = 2, of a technique beside another one; of densities whose squares single precision has not, too."""
    ratio = other / pdf
    return 1.0 / (1.0 + ratio * ratio)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _places(listed, first, count, scratch):  # type: ignore[no-untyped-def]
    """(places, live): listed[first : first + LANES]; where there are fewer, the last one again, and not live."""
    for k in range(LANES):
        scratch[k] = np.uint32(listed[min(first + k, count - 1)])
    return take(scratch, 0), lane_numbers() < np.uint32(min(count - first, LANES))


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def shade_batch(rays, status, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, listed, scratch, out):  # type: ignore[no-untyped-def]
    """Shade a cast batch; returns how many new rays were written to `out`.

    rays uint32[n, 9]; status uint8[n]; hit_uv float32[n, 2]; hit_ids uint32[n, 3]: instance, group, primitive;
    first_path: global number of the pass's path 0; sums int64[paths, 3 or 9]; aovs int32[paths, 8 or 13] (sum_columns.py);
    counters int64[COUNTERS]; listed int64[>= 2 n] and scratch uint32[SCRATCH_WORDS] to work in; out uint32[>= 2 n, 9], rays with t_done 0.
    """
    batch = rays.shape[0]
    hits, frees = listed[:batch], listed[batch:]
    hit_count = free_count = int(np.int64(0))  # of no literal type, for which all that is called with it would be compiled as well
    for i in range(batch):
        counters[COUNT_SHADOW_RAYS] += np.int64(is_shadow_ray(rays, i))
        # Shadow rays that hit are dead: the caster says so.
        if status[i] == STATUS_HIT:
            hits[hit_count] = i
            hit_count += 1
        elif status[i] == STATUS_FREE:
            frees[free_count] = i
            free_count += 1
    for first in range(0, free_count, LANES):
        for k in range(first + LANES, min(first + 2 * LANES, free_count)):
            prefetch_row(sums, path_of(rays, frees[k]))
        _deliver(rays, frees, first, free_count, scene, job, sums, counters, scratch)
    made = int(np.int64(0))
    for first in range(0, hit_count, LANES):
        for k in range(first + LANES, min(first + 2 * LANES, hit_count)):
            if kind_of(rays, hits[k]) == KIND_CAMERA:
                prefetch_row(aovs, path_of(rays, hits[k]))
        made = _shade_hits(
            rays, hits, first, hit_count, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, scratch, out, made
        )  # fmt: skip
    return made


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _deliver(rays, frees, first, count, scene, job, sums, counters, scratch):  # type: ignore[no-untyped-def]
    """Shadow rays that arrived bring their contribution, path rays that left the box that of the sky."""
    at, live = _places(frees, first, count, scratch)
    ray = read_rays(rays, at)
    r, g, b = decode_color(ray.color_low, ray.color_high)
    to_sky = (ray.kind != np.uint32(KIND_SHADOW)) & (ray.kind != np.uint32(KIND_POINT_SHADOW))
    sky_r, sky_g, sky_b, sky_pdf = sky_at(scene, job, ray.code_u, ray.code_v)
    weight = select(ray.pdf == np.uint32(PDF_DELTA), 1.0, _power_weight(decode_pdf(ray.pdf), sky_pdf))
    r, g, b = (
        select(to_sky, r * sky_r * weight, r),
        select(to_sky, g * sky_g * weight, g),
        select(to_sky, b * sky_b * weight, b),
    )
    _add_lanes(job, sums, counters, scratch, live, ray.path, ray.bounce + select(to_sky, np.uint32(0), np.uint32(1)), r, g, b)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _shade_hits(rays, hits, first, count, hit_uv, hit_ids, scene, job, first_path, sums, aovs, counters, scratch, out, made):  # type: ignore[no-untyped-def]
    """Hits first .. first + LANES - 1; where there are fewer, lanes that are left shade the last one again, and nothing comes of them."""
    at, live = _places(hits, first, count, scratch)
    ray = read_rays(rays, at)
    instance = gather(hit_ids, (at, 0))
    triangle = gather(scene.group_first, (gather(hit_ids, (at, 1)),)) + gather(hit_ids, (at, 2))
    u, v = gather(hit_uv, (at, 0)), gather(hit_uv, (at, 1))
    px, py, pz, gx, gy, gz, sx, sy, sz, tu, tv = surface_at(scene, triangle, instance, u, v)
    reach = reach_at(scene, triangle, instance)
    rows = scene.materials
    material = gather(scene.triangle_material, (triangle,))
    tu, tv, tu2, tv2 = coordinates_at(scene, triangle, u, v, tu, tv)
    covered, covered2 = footprints_at(scene, job, material, triangle, instance, px, py, pz)
    places = (tu, tv, tu2, tv2, covered, covered2)
    looks = material_at(scene, material, triangle, u, v, places, scratch)
    base_r, base_g, base_b, metallic, alpha, reflection, transmission, features, coat_strength, _, _ = looks
    scatters = scatters_through(looks)
    dx, dy, dz = decode_direction(ray.code_u, ray.code_v)
    facing = -(dx * gx + dy * gy + dz * gz)
    front = facing > 0.0
    gx, gy, gz, facing = select(front, gx, -gx), select(front, gy, -gy), select(front, gz, -gz), select(front, facing, -facing)
    inwards = sx * gx + sy * gy + sz * gz < 0.0
    sx, sy, sz = select(inwards, -sx, sx), select(inwards, -sy, sy), select(inwards, -sz, sz)
    hidden = -(dx * sx + dy * sy + dz * sz) <= 1e-4
    sx, sy, sz = select(hidden, gx, sx), select(hidden, gy, sy), select(hidden, gz, sz)
    below = (sx, sy, sz)
    if any_lane((features & _NORMAL_MAP) != np.uint32(0)):
        sx, sy, sz = mapped_normal(
            scene, material, triangle, instance, u, v, places, (sx, sy, sz), (gx, gy, gz), (dx, dy, dz), opposite(front), scratch,
            _NORMAL_USE, _NORMAL_SCALE,
        )  # fmt: skip
    qx, qy, qz = px - ray.x, py - ray.y, pz - ray.z
    squared = qx * qx + qy * qy + qz * qz

    diagonal = diagonal_of_box(job.box_low, job.box_high)
    seen_first = live & (ray.kind == np.uint32(KIND_CAMERA))
    if any_lane(seen_first):
        _note_first_hits(
            seen_first, ray.path, job, diagonal, base_r, base_g, base_b, sx, sy, sz, px, py, pz, instance, material, aovs, scratch
        )

    # What the caster's filter lets pass is not shaded; what is shaded stands for the rest (see_through_kernels).
    r, g, b = decode_color(ray.color_low, ray.color_high)
    through, tint_r, tint_g, tint_b = alike(0.0, px), alike(0.0, px), alike(0.0, px), alike(0.0, px)
    clear = (transmission > 0.0) & (metallic < 1.0) & opposite(scatters)
    if any_lane(clear):
        share = passed_share(transmission, reflection, metallic, alpha, coat_strength, facing)
        least, most = min(base_r, min(base_g, base_b)), max(base_r, max(base_g, base_b))
        left = 1.0 - share * least
        live = live & (opposite(clear) | (left > 1e-6))
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
            gather(rows, (material, _BASE + 3)), gather(rows, (material, _BASE_USE)),
            gather(rows, (material, _VERTEX_ALPHA)),
        )  # fmt: skip
        found = (ray.pdf != np.uint32(PDF_DELTA)) & (facing > 1e-6) & opaque
        other = emitter_pdf(job, emission_r, emission_g, emission_b, squared, facing)
        weight = select(found, _power_weight(decode_pdf(ray.pdf), other), 1.0)
        mapped = (features & _EMISSIVE_MAP) != np.uint32(0)
        if any_lane(mapped):
            # The density above is of the mean, by which light samples choose; what is sent out is the texel, and of the finest level
            # where they might have found it, since that is the one that they read: both have shares of one light.
            finest = (tu, tv, tu2, tv2, select(found, 0.0, covered), select(found, 0.0, covered2))
            tr, tg, tb, _ = texture_of(scene, material, _EMISSIVE_USE, finest, scratch)
            emission_r = select(mapped, tr * gather(rows, (material, _EMISSIVE)), emission_r)
            emission_g = select(mapped, tg * gather(rows, (material, _EMISSIVE + 1)), emission_g)
            emission_b = select(mapped, tb * gather(rows, (material, _EMISSIVE + 2)), emission_b)
        _add_lanes(
            job,
            sums,
            counters,
            scratch,
            shines,
            ray.path,
            ray.bounce,
            r * emission_r * weight,
            g * emission_g * weight,
            b * emission_b * weight,
        )
    unlit = live & ((features & _UNLIT) != np.uint32(0))
    if any_lane(unlit):
        _add_lanes(job, sums, counters, scratch, unlit, ray.path, ray.bounce, r * base_r, g * base_g, b * base_b)
        live = live & opposite(unlit)
    live = live & (ray.bounce + np.uint32(1) < np.uint32(job.depth))
    if not any_lane(live):
        return made

    pixel, sample = pixels_of(job, first_path, ray.path, scratch)
    dice = dice_of(job, pixel, sample, ray.bounce)
    surface = seen(Hit(
        scene, material, triangle, instance, u, v, places, looks, (dx, dy, dz), (gx, gy, gz), below, (sx, sy, sz), opposite(front), scratch,
    ))  # fmt: skip
    fx, fy, fz = offset_origin(px, py, pz, gx, gy, gz, reach)
    inside = live & opposite(front) & ((features & _SOLID) != np.uint32(0))
    if any_lane(inside):
        # What is emitted into the body, or lies within, was reached unattenuated: so is what light samples find there.
        left_r, left_g, left_b = absorbed(scene, material, squared)
        r, g, b = select(inside, r * left_r, r), select(inside, g * left_g, g), select(inside, b * left_b, b)

    # A shadow ray towards one light sample.
    found, wx, wy, wz, ex, ey, ez, lr, lg, lb, light_pdf = sample_light(
        scene, job, dice, fx, fy, fz, gx, gy, gz, scatters, scratch
    )  # fmt: skip
    side = wx * gx + wy * gy + wz * gz
    found = live & found & ((side > 0.0) | (scatters & (side < 0.0)))
    if any_lane(found):
        vr, vg, vb, pdf, cosine = value(surface, wx, wy, wz)
        quantised = decode_pdf(encode_pdf(pdf * (1.0 - through)))
        finite = light_pdf > 0.0
        weight = cosine * select(finite, _power_weight(light_pdf, quantised), 1.0)
        cr, cg, cb = r * vr * lr * weight, g * vg * lg * weight, b * vb * lb * weight
        low, high = encode_color(cr, cg, cb, noise(dice, NOISE_CONTRIBUTION))
        total = cr + cg + cb
        sound = total < math.inf
        lost = found & opposite(sound)
        if any_lane(lost):
            _count_lanes(counters, COUNT_NOT_FINITE, lost)
        kind = select(finite, np.uint32(KIND_SHADOW), np.uint32(KIND_POINT_SHADOW))
        ox, oy, oz = fx, fy, fz
        if any_lane(scatters & (side < 0.0)):
            ox, oy, oz = _other_side(side < 0.0, (px, py, pz), (gx, gy, gz), reach, (fx, fy, fz))
        made = write_rays(
            out, made, found & sound & (total > 0.0), scratch, ox, oy, oz, bits_of(ex), bits_of(ey), bits_of(ez),
            low, high, ray.path, kind, ray.bounce,
        )  # fmt: skip

    # The path goes on: straight through, off one of the surface's layers, or scattered through them.
    lobe, gamble = pair(job, dice, PAIR_LOBE_ROULETTE)
    u, v = pair(job, dice, PAIR_SCATTER)
    straight = lobe < through
    wx, wy, wz, leaves = draw(surface, (lobe - through) / (1.0 - through), u, v)
    code_u, code_v = encode_direction(wx, wy, wz)
    # From here on the direction is what its code says: the density too is that of the coded direction.
    wx, wy, wz = decode_direction(code_u, code_v)
    vr, vg, vb, pdf, cosine = value(surface, wx, wy, wz)
    pdf = pdf * (1.0 - through)
    side = wx * gx + wy * gy + wz * gz
    live = live & (straight | (leaves & ((side > 0.0) | (scatters & (side < 0.0))) & (pdf > 0.0)))
    behind = straight | (side < 0.0)
    weight = cosine / pdf
    next_pdf = select(straight, np.uint32(PDF_DELTA), encode_pdf(pdf))
    r, g, b = (
        select(straight, r * tint_r, r * vr * weight),
        select(straight, g * tint_g, g * vg * weight),
        select(straight, b * tint_b, b * vb * weight),
    )
    if any_lane(live & behind):
        fx, fy, fz = _other_side(behind, (px, py, pz), (gx, gy, gz), reach, (fx, fy, fz))
        code_u, code_v = select(straight, ray.code_u, code_u), select(straight, ray.code_v, code_v)
    sound = r + g + b < math.inf
    lost = live & opposite(sound)
    if any_lane(lost):
        _count_lanes(counters, COUNT_NOT_FINITE, lost)
    live = live & sound
    gambles = ray.bounce + np.uint32(1) >= np.uint32(job.roulette_from)
    if any_lane(gambles):
        survive = select(gambles, min(max(r, max(g, b)), 0.95), 1.0)
        live = live & (gamble < survive)
        r, g, b = r / survive, g / survive, b / survive
    low, high = encode_color(r, g, b, noise(dice, NOISE_THROUGHPUT))
    live = live & ((low | high) != np.uint32(0))
    return write_rays(
        out, made, live, scratch, fx, fy, fz, code_u, code_v, next_pdf, low, high, ray.path,
        alike(np.uint32(KIND_BOUNCE), ray.path), ray.bounce + np.uint32(1),
    )  # fmt: skip


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _other_side(behind, point, normal, reach, origin):  # type: ignore[no-untyped-def]
    """The origin, or where the flag is set that of a ray that leaves to the side from which the normal looks away."""
    x, y, z = offset_origin(point[0], point[1], point[2], -normal[0], -normal[1], -normal[2], reach)
    return select(behind, x, origin[0]), select(behind, y, origin[1]), select(behind, z, origin[2])


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _note_first_hits(first, path, job, diagonal, base_r, base_g, base_b, sx, sy, sz, px, py, pz, instance, material, aovs, scratch):  # type: ignore[no-untyped-def]
    reals = scratch.view(np.float32)
    put(reals, 0 * LANES, min(base_r, 100.0))
    put(reals, 1 * LANES, min(base_g, 100.0))
    put(reals, 2 * LANES, min(base_b, 100.0))
    put(reals, 3 * LANES, sx)
    put(reals, 4 * LANES, sy)
    put(reals, 5 * LANES, sz)
    put(reals, DEPTH * LANES, min(max((depth_of(job, px, py, pz) - job.camera[17]) / diagonal, 0.0), DEPTH_END))
    put(scratch, HIT * LANES, path)
    left = bits_of_flags(first)
    for k in range(LANES):
        if (left >> k) & 1:
            row = scratch[HIT * LANES + k]
            for column in range(HIT):
                aovs[row, column] = np.int32(math.floor(reals[column * LANES + k] * AOV_UNIT + 0.5))
            aovs[row, HIT] = np.int32(1)
    if aovs.shape[1] < ALL_AOVS:
        return
    low, high = job.box_low, job.box_high
    put(reals, 0 * LANES, (px - low[0]) / (high[0] - low[0]))
    put(reals, 1 * LANES, (py - low[1]) / (high[1] - low[1]))
    put(reals, 2 * LANES, (pz - low[2]) / (high[2] - low[2]))
    put(scratch, 3 * LANES, instance)
    put(scratch, 4 * LANES, material)
    for k in range(LANES):
        if (left >> k) & 1:
            row = scratch[HIT * LANES + k]
            for axis in range(3):
                aovs[row, POSITION + axis] = np.int32(math.floor(reals[axis * LANES + k] * AOV_UNIT + 0.5))
            aovs[row, OBJECT], aovs[row, MATERIAL] = np.int32(scratch[3 * LANES + k]), np.int32(scratch[4 * LANES + k])
