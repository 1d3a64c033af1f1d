"""The caster: every ray of a batch against the geometry that this node holds, within this node's cell.

Embree is called once a ray, through its address. Which hit wins must not depend on what else a node holds,
and Embree leaves equal distances to the order of its tree; so a filter compares every candidate itself by
(t, instance, group, primitive), and keeps the search open a little behind the best, so that no candidate of
the same t is culled before it was compared. What only some trees find is refused (own_box_kernels.py); t is
never less than where the ray enters the triangle's box, for the boxes above are culled by that.

Memory layouts are Embree 4's (rtcore_ray.h, rtcore_common.h), in 32-bit words:
    RTCRayHit   0 org 3 | 3 tnear | 4 dir 3 | 7 time | 8 tfar | 9 mask | 10 id | 11 flags
                12 Ng 3 | 15 u | 16 v | 17 primID | 18 geomID | 19 instID | 20 instPrimID
    context     0 instID | 1 instPrimID | then ours: 4 best t | 5 instance | 6 group | 7 primitive
                8-9 path key | 10 bounce and kind | 11 pad of the search | 12-13 address of the table of array addresses
                14 channels that a shadow ray still carries | 15 Embree's id of instance 1 | 32-37 1 / direction, 3 x f64
    arguments   0 flags | 1 feature mask | 2-3 context | 4-5 filter | 6-7 function
    filter's    0-1 valid | 2-3 user data, 1 for groups with see-through triangles | 4-5 context | 6-7 ray | 8-9 hit | 10 N
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import carray, cfunc, njit, types

from scenefold.base.rays import KIND_POINT_SHADOW
from scenefold.partition.kernels import exit_after, owner_ahead
from scenefold.render.arrays import F32, F64, I64, U8, U16, U32, MaterialColumn, TextureColumn, TextureUseColumn
from scenefold.render.lanes_kernels import LANES
from scenefold.render.pixel_kernels import pixel_of
from scenefold.render.precise_kernels import path_key
from scenefold.render.record_kernels import (
    end_of,
    is_shadow_ray,
    keep_channels,
    origin_of,
    path_of,
    set_t_done,
    t_done_of,
    unpack_directions,
)
from scenefold.render.renderers.embree.memory_kernels import (
    call_with_3,
    f32_at,
    f64_at,
    i64_at,
    load_f32,
    load_i64,
    load_u32,
    store_f32,
    store_u32,
    u8_at,
    u16_at,
    u32_at,
)
from scenefold.render.renderers.embree.own_box_kernels import own_box_entry
from scenefold.render.see_through_kernels import cosine_at, pass_shares, skip_draw
from scenefold.render.shade_kernels import STATUS_DEAD, STATUS_FORWARD, STATUS_FREE, STATUS_HIT
from scenefold.render.space_kernels import box_span, step_after, t_of_step

WORKSPACE_WORDS = 80
"""uint32 words of a caster's workspace: ray and hit at 0, context at 32, arguments at 48 and 56, inverses at 64; 64-byte aligned."""
_CONTEXT = 32
_ARGUMENTS = 48
_SHADOW_ARGUMENTS = 56
_INVERSES = 64
_TO_INVERSES = 4 * (_INVERSES - _CONTEXT)
"""Bytes from the context."""
_NOBODY = np.uint32(0xFFFFFFFF)
_ALL_CHANNELS = 7
_INVOKE_ARGUMENT_FILTER = np.uint32(2)
_STILL_OPEN = np.float32(1.0 + 2.0**-21)
_PAD = 2.0**-20
"""Of the largest coordinate: by so much an instance's box in the world may be off its place by rounding."""


class FilterArrays(NamedTuple):
    """What a filter reads of `SceneArrays`, under the same names."""

    vertices: F32
    uvs: F32
    triangles: U32
    triangle_material: U16
    materials: F32
    textures: I64
    texels: U8
    linear_of_srgb: F64
    texture_uses: F64
    uvs2: F32
    colors: F32
    has_uvs2: bool
    has_colors: bool


TABLE = (
    "vertices", "uvs", "triangles", "triangle_material", "materials", "textures", "texels", "linear_of_srgb",
    "group_first", "instance_matrices", "instance_normals", "texture_uses", "uvs2", "colors",
)  # fmt: skip
"""Arrays of `SceneArrays` whose addresses the filters are given, in this order; 0 or 1 for has_uvs2 and for has_colors follow."""
TABLE_WORDS = len(TABLE) + 2
_MATERIAL_WIDTH, _TEXTURE_WIDTH, _USE_WIDTH = MaterialColumn.WIDTH, TextureColumn.WIDTH, TextureUseColumn.WIDTH


@njit(error_model="numpy")
def _passing_channels(context, ray, hit, instance, group, primitive):  # type: ignore[no-untyped-def]
    """In which channels (bits 0 to 2) the ray passes this candidate as if it were not there."""
    table = load_i64(context + 48)
    many = 1 << 40
    arrays = FilterArrays(
        carray(f32_at(load_i64(table)), (many, 3)),
        carray(f32_at(load_i64(table + 8)), (many, 2)),
        carray(u32_at(load_i64(table + 16)), (many, 3)),
        carray(u16_at(load_i64(table + 24)), (many,)),
        carray(f32_at(load_i64(table + 32)), (many, _MATERIAL_WIDTH)),
        carray(i64_at(load_i64(table + 40)), (many, _TEXTURE_WIDTH)),
        carray(u8_at(load_i64(table + 48)), (many,)),
        carray(f64_at(load_i64(table + 56)), (256,)),
        carray(f64_at(load_i64(table + 88)), (many, _USE_WIDTH)),
        carray(f32_at(load_i64(table + 96)), (many, 2)),
        carray(f32_at(load_i64(table + 104)), (many, 4)),
        load_i64(table + 112) != 0,
        load_i64(table + 120) != 0,
    )
    triangle = load_i64(load_i64(table + 64) + np.int64(8) * np.int64(group)) + np.int64(primitive)
    matrices = carray(f64_at(load_i64(table + 72)), (many, 3, 4))
    normals = carray(f64_at(load_i64(table + 80)), (many, 3, 3))
    number = np.int64(instance) - np.int64(load_u32(context + 60)) if instance != 0 else np.int64(0)
    dx, dy, dz = float(load_f32(ray + 16)), float(load_f32(ray + 20)), float(load_f32(ray + 24))
    cosine = cosine_at(arrays, triangle, matrices[number], normals[number], dx, dy, dz)
    r, g, b = pass_shares(arrays, triangle, float(load_f32(hit + 12)), float(load_f32(hit + 16)), cosine)
    if not max(r, max(g, b)) > 0.0:
        return 0
    key = np.uint64(load_i64(context + 32))
    drawn = skip_draw(key, load_u32(context + 40), instance, group, primitive)
    return (1 if drawn < r else 0) | (2 if drawn < g else 0) | (4 if drawn < b else 0)


@cfunc(types.void(types.int64), cache=True)
def nearest_filter(arguments):  # type: ignore[no-untyped-def]
    """Accept a candidate only if it precedes the best so far by (t, instance, group, primitive), and stops the ray."""
    context = load_i64(arguments + 16)
    ray = load_i64(arguments + 24)
    hit = load_i64(arguments + 32)
    best = load_f32(context + 16)
    t = load_f32(ray + 32)
    if t > best:
        store_u32(load_i64(arguments), np.uint32(0))
        return
    primitive, group, instance = load_u32(hit + 20), load_u32(hit + 24), load_u32(hit + 28)
    inverses = context + _TO_INVERSES if instance == _NOBODY else 0
    entry = own_box_entry(load_i64(context + 48), ray, group, primitive, inverses)
    t = max(t, np.float32(entry))
    # Geometry outside instances carries the largest id there is; adding one puts it first, as instance 0.
    mine = np.uint32(instance + np.uint32(1))
    wins = t < best
    if t == best:
        other, best_group = np.uint32(load_u32(context + 20) + np.uint32(1)), load_u32(context + 24)
        if mine != other:
            wins = mine < other
        elif group != best_group:
            wins = group < best_group
        else:
            wins = primitive < load_u32(context + 28)
    wins = wins and entry >= 0.0
    if wins and load_i64(arguments + 8) != 0 and _passing_channels(context, ray, hit, mine, group, primitive) == _ALL_CHANNELS:
        wins = False
    if wins:
        store_f32(context + 16, t)
        store_u32(context + 20, instance)
        store_u32(context + 24, group)
        store_u32(context + 28, primitive)
        store_f32(ray + 32, t * _STILL_OPEN + load_f32(context + 44))
    else:
        store_u32(load_i64(arguments), np.uint32(0))


@cfunc(types.void(types.int64), cache=True)
def shadow_filter(arguments):  # type: ignore[no-untyped-def]
    """Let a shadow ray pass what is see-through, or found in some trees only; anything else ends it."""
    context, ray, hit = load_i64(arguments + 16), load_i64(arguments + 24), load_i64(arguments + 32)
    primitive, group, instance = load_u32(hit + 20), load_u32(hit + 24), load_u32(hit + 28)
    inverses = context + _TO_INVERSES if instance == _NOBODY else 0
    entry = own_box_entry(load_i64(context + 48), ray, group, primitive, inverses)
    stops = 0.0 <= entry <= 1.0
    if stops and load_i64(arguments + 8) != 0:
        channels = _passing_channels(context, ray, hit, np.uint32(instance + np.uint32(1)), group, primitive)
        left = load_u32(context + 56) & np.uint32(channels)
        tints = (load_u32(context + 40) & np.uint32(7)) == np.uint32(KIND_POINT_SHADOW)
        stops = left == np.uint32(0) if tints else channels != _ALL_CHANNELS
        if tints and not stops:
            store_u32(context + 56, left)
    if not stops:
        store_u32(load_i64(arguments), np.uint32(0))


@njit(error_model="numpy", _nrt=False)
def _prepare(workspace, nearest, shadow, addresses):  # type: ignore[no-untyped-def]
    """Arguments of the two queries, each with its filter."""
    base = workspace.ctypes.data
    workspace[:] = np.uint32(0)
    workspace[_CONTEXT] = _NOBODY
    workspace[_CONTEXT + 1] = _NOBODY
    words = workspace.view(np.int64)
    words[(_CONTEXT + 12) // 2] = addresses.ctypes.data
    for arguments, function in ((_ARGUMENTS, nearest), (_SHADOW_ARGUMENTS, shadow)):
        workspace[arguments] = _INVOKE_ARGUMENT_FILTER
        workspace[arguments + 1] = _NOBODY
        words[(arguments + 2) // 2] = base + _CONTEXT * 4
        words[(arguments + 4) // 2] = function
    return base


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _write_ray(workspace, reals, ox, oy, oz, dx, dy, dz, t_far):  # type: ignore[no-untyped-def]
    reals[0], reals[1], reals[2], reals[3] = ox, oy, oz, np.float32(0.0)
    reals[4], reals[5], reals[6], reals[7] = dx, dy, dz, np.float32(0.0)
    reals[8] = t_far
    workspace[9], workspace[10], workspace[11] = _NOBODY, np.uint32(0), np.uint32(0)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def cast_batch(  # type: ignore[no-untyped-def]
    intersect,
    occluded,
    nearest,
    shadow,
    addresses,
    see_through,
    scene_address,
    first_instance_id,
    workspace,
    scratch,
    rays,
    alone,
    family,
    cells,
    node,
    job,
    first_path,
    status,
    hit_uv,
    hit_ids,
):
    """Cast each ray to where it leaves this node's cell, or to what it hits before.

    rays uint32[n, 9], whose t_done is advanced; status uint8[n]; hit_uv float32[n, 2]; hit_ids uint32[n, 3]
    (instance, group, primitive), both written for hits. `first_instance_id`: Embree's id of instance 1. `nearest`
    and `shadow` are the addresses of the two filters, and `addresses`, int64[TABLE_WORDS], says where these find
    their arrays; `see_through` is 0 where nothing that is held lets rays pass. `alone` is not 0 where there is one cell only,
    so that every ray is cast to its end. scratch uint32[SCRATCH_WORDS].
    A path ray that is already done (65535) left the job's box before it met any cell: it is free at once.
    """
    base = _prepare(workspace, nearest, shadow, addresses)
    reals = workspace.view(np.float32)
    keys = workspace.view(np.uint64)
    workspace[_CONTEXT + 15] = np.uint32(first_instance_id)
    low, high = job.box_low, job.box_high
    reach = 0.0
    for axis in range(3):
        reach = max(reach, max(abs(low[axis]), abs(high[axis])))
    pad = np.float32(reach * _PAD)
    directions = scratch.view(np.float32)
    inverses = workspace.view(np.float64)[_INVERSES // 2 :]
    for i in range(rays.shape[0]):
        lane = i & (LANES - 1)
        if lane == 0:
            unpack_directions(rays, i, directions)
        step = t_done_of(rays, i)
        if step == 65535:
            status[i] = STATUS_FREE
            continue
        ox, oy, oz = origin_of(rays, i)
        if see_through != 0:
            pixel, sample = pixel_of(job, np.uint64(first_path + path_of(rays, i)))
            keys[(_CONTEXT + 8) // 2] = path_key(job.seed, job.frame, pixel, sample)
            workspace[_CONTEXT + 10] = (rays[i, 8] >> np.uint32(8)) & np.uint32(0xFF)
        is_shadow = is_shadow_ray(rays, i)
        if is_shadow:
            ex, ey, ez = end_of(rays, i)
            fx, fy, fz = np.float32(ex - ox), np.float32(ey - oy), np.float32(ez - oz)
        else:
            fx, fy, fz = directions[lane], directions[LANES + lane], directions[2 * LANES + lane]
        t_limit = 1.0 if is_shadow else math.inf
        if alone != 0:
            step = 65535
        else:
            x, y, z, dx, dy, dz = np.float64(ox), np.float64(oy), np.float64(oz), np.float64(fx), np.float64(fy), np.float64(fz)
            t_in, t_out = (0.0, 1.0) if is_shadow else box_span(x, y, z, dx, dy, dz, low, high)
            t_exit = exit_after(family, cells, node, x, y, z, dx, dy, dz, t_of_step(step, t_in, t_out))
            step = step_after(t_exit, t_in, t_out, step)
            if step < 65535:
                t_limit = t_of_step(step, t_in, t_out)
        inverses[0], inverses[1], inverses[2] = 1.0 / np.float64(fx), 1.0 / np.float64(fy), 1.0 / np.float64(fz)
        if is_shadow:
            _write_ray(workspace, reals, ox, oy, oz, fx, fy, fz, min(np.float32(t_limit * (1.0 + 2.0**-22)), np.float32(1.0)))
            workspace[_CONTEXT + 14] = np.uint32(_ALL_CHANNELS)
            call_with_3(occluded, scene_address, base, base + _SHADOW_ARGUMENTS * 4)
            dead = reals[8] < np.float32(0.0)
            if not dead and workspace[_CONTEXT + 14] != np.uint32(_ALL_CHANNELS):
                dead = not keep_channels(rays, i, workspace[_CONTEXT + 14])
            if dead:
                status[i] = STATUS_DEAD
                continue
        else:
            reals[_CONTEXT + 4] = np.float32(math.inf)
            workspace[_CONTEXT + 5], workspace[_CONTEXT + 6], workspace[_CONTEXT + 7] = _NOBODY, _NOBODY, _NOBODY
            workspace[17], workspace[18], workspace[19] = _NOBODY, _NOBODY, _NOBODY
            reals[_CONTEXT + 11] = pad
            # The search reaches a little past the limit; what it finds there is left to the next node.
            _write_ray(workspace, reals, ox, oy, oz, fx, fy, fz, np.float32(t_limit * (1.0 + 2.0**-20) + pad))
            call_with_3(intersect, scene_address, base, base + _ARGUMENTS * 4)
            if float(reals[_CONTEXT + 4]) <= t_limit and workspace[18] != _NOBODY:
                status[i] = STATUS_HIT
                hit_uv[i, 0], hit_uv[i, 1] = reals[15], reals[16]
                instance = workspace[19]
                hit_ids[i, 0] = np.uint32(0) if instance == _NOBODY else instance - np.uint32(first_instance_id) + np.uint32(1)
                hit_ids[i, 1], hit_ids[i, 2] = workspace[18], workspace[17]
                continue
        set_t_done(rays, i, step)
        status[i] = STATUS_FREE if step == 65535 else STATUS_FORWARD


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def find_owners(rays, family, cells, low, high, me, owners, scratch):  # type: ignore[no-untyped-def]
    """Which node casts each ray next: the owner of the place up to which it is done.

    A ray that is done for good stays with whoever holds it. owners int32[n] is written; scratch uint32[SCRATCH_WORDS].
    """
    directions = scratch.view(np.float32)
    for i in range(rays.shape[0]):
        lane = i & (LANES - 1)
        if lane == 0:
            unpack_directions(rays, i, directions)
        step = t_done_of(rays, i)
        if step == 65535:
            owners[i] = me
            continue
        ox, oy, oz = origin_of(rays, i)
        x, y, z = np.float64(ox), np.float64(oy), np.float64(oz)
        if is_shadow_ray(rays, i):
            ex, ey, ez = end_of(rays, i)
            dx, dy, dz = np.float64(np.float32(ex - ox)), np.float64(np.float32(ey - oy)), np.float64(np.float32(ez - oz))
            t = t_of_step(step, 0.0, 1.0)
        else:
            dx, dy, dz = np.float64(directions[lane]), np.float64(directions[LANES + lane]), np.float64(directions[2 * LANES + lane])
            t_in, t_out = box_span(x, y, z, dx, dy, dz, low, high)
            t = t_of_step(step, t_in, t_out)
        owners[i] = owner_ahead(family, cells, x + dx * t, y + dy * t, z + dz * t, dx, dy, dz)
