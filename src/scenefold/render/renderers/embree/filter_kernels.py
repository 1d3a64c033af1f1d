"""The caster's filters: Embree asks them about every candidate of a ray, and they choose so that no tree can be told from another.

Which hit wins must not depend on what else a node holds, and Embree leaves equal distances to the order of its tree; so
the exact filters compare every candidate themselves by (t, instance, group, primitive), and keep the search open a little behind the
best, so that no candidate of the same t is culled before it was compared. What only some trees find is refused (own_box_kernels.py);
t is never less than where the ray enters the triangle's box, for the boxes above are culled by that.

Nearly every ray has one nearest candidate that nothing comes close to. The quick filters are for these, and read nothing of the
scene: they take the least t, and note whether another candidate came as near (`near`). If none did, and the ray meets the box of what was
found no farther than `near`, which the caster tests afterwards, then the exact filters would have found the same. For what they would have
preferred has a t, and a box that begins, no farther than that: it was either seen, and then noted, or it was culled, and then its box
begins behind where the search ended, which is farther still (`_STILL_OPEN_QUICK`).

Memory layouts are Embree 4's (rtcore_ray.h, rtcore_common.h), in 32-bit words:
    RTCRayHit   0 org 3 | 3 tnear | 4 dir 3 | 7 time | 8 tfar | 9 mask | 10 id | 11 flags
                12 Ng 3 | 15 u | 16 v | 17 primID | 18 geomID | 19 instID | 20 instPrimID
    context     0 instID | 1 instPrimID | then ours: 4 best t | 5 instance | 6 group | 7 primitive
                8-9 path key | 10 bounce and kind | 11 pad of the search | 12-13 address of the table of array addresses
                14 channels that a shadow ray still carries | 15 Embree's id of instance 1 | 32-37 1 / direction, 3 x f64
                38 quick: 1 where another candidate came near | 39 quick: 1 where the best has been tested already
    arguments   0 flags | 1 feature mask | 2-3 context | 4-5 filter | 6-7 function
    filter's    0-1 valid | 2-3 user data, 1 for groups with see-through triangles | 4-5 context | 6-7 ray | 8-9 hit | 10 N
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import carray, cfunc, njit, types

from scenefold.base.rays import KIND_POINT_SHADOW
from scenefold.render.arrays import F32, F64, I64, U8, U16, U32, MaterialColumn, TextureColumn, TextureUseColumn
from scenefold.render.renderers.embree.memory_kernels import (
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

WORKSPACE_WORDS = 80
"""uint32 words of a caster's workspace: ray and hit at 0, context at 32, arguments at 48 and 56, inverses at 64, notes at 70; 64-byte aligned."""
CONTEXT = 32
ARGUMENTS = 48
SHADOW_ARGUMENTS = 56
INVERSES = 64
NOTES = 70
"""Two words of the quick filters: 1 where another candidate came near, 1 where what was found has been tested already."""
_TO_INVERSES, _TO_NEAR, _TO_TESTED = 4 * (INVERSES - CONTEXT), 4 * (NOTES - CONTEXT), 4 * (NOTES + 1 - CONTEXT)
"""Bytes from the context."""
NOBODY = np.uint32(0xFFFFFFFF)
ALL_CHANNELS = 7
_STILL_OPEN = np.float32(1.0 + 2.0**-21)
_NEAR = np.float32(1.0 + 2.0**-22)
_STILL_OPEN_QUICK = np.float32(1.0 + 2.0**-20)


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
    inverses = context + _TO_INVERSES if instance == NOBODY else 0
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
    if wins and load_i64(arguments + 8) != 0 and _passing_channels(context, ray, hit, mine, group, primitive) == ALL_CHANNELS:
        wins = False
    if wins:
        store_f32(context + 16, t)
        store_u32(context + 20, instance)
        store_u32(context + 24, group)
        store_u32(context + 28, primitive)
        store_f32(ray + 32, t * _STILL_OPEN + load_f32(context + 44))
    else:
        store_u32(load_i64(arguments), np.uint32(0))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def near(t):  # type: ignore[no-untyped-def]
    """Up to which t another candidate comes near one of this t."""
    return t * _NEAR


@cfunc(types.void(types.int64), cache=True)
def quick_nearest_filter(arguments):  # type: ignore[no-untyped-def]
    """Accept a candidate only if it is nearer than the best so far, and note whether another one comes near.

    What is see-through or within an instance is tested at once: afterwards, the ray is no longer in the space of the instance.
    """
    context, ray, hit = load_i64(arguments + 16), load_i64(arguments + 24), load_i64(arguments + 32)
    best, t = load_f32(context + 16), load_f32(ray + 32)
    if t > near(best):
        store_u32(load_i64(arguments), np.uint32(0))
        return
    instance = load_u32(hit + 28)
    see_through = load_i64(arguments + 8) != 0
    tested = see_through or instance != NOBODY
    if tested:
        primitive, group = load_u32(hit + 20), load_u32(hit + 24)
        inverses = context + _TO_INVERSES if instance == NOBODY else 0
        entry = own_box_entry(load_i64(context + 48), ray, group, primitive, inverses)
        t = max(t, np.float32(entry))
        refused = not entry >= 0.0 or t > near(best)
        if not refused and see_through:
            mine = np.uint32(instance + np.uint32(1))
            refused = _passing_channels(context, ray, hit, mine, group, primitive) == ALL_CHANNELS
        if refused:
            store_u32(load_i64(arguments), np.uint32(0))
            return
    if not t < best:
        store_u32(context + _TO_NEAR, np.uint32(1))
        store_u32(load_i64(arguments), np.uint32(0))
        return
    store_u32(context + _TO_NEAR, np.uint32(1) if best <= near(t) else np.uint32(0))
    store_u32(context + _TO_TESTED, np.uint32(1) if tested else np.uint32(0))
    store_f32(context + 16, t)
    store_f32(ray + 32, t * _STILL_OPEN_QUICK + load_f32(context + 44))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _stops_shadow(arguments):  # type: ignore[no-untyped-def]
    """Whether a candidate ends a shadow ray: it is neither refused nor see-through."""
    context, ray, hit = load_i64(arguments + 16), load_i64(arguments + 24), load_i64(arguments + 32)
    primitive, group, instance = load_u32(hit + 20), load_u32(hit + 24), load_u32(hit + 28)
    inverses = context + _TO_INVERSES if instance == NOBODY else 0
    entry = own_box_entry(load_i64(context + 48), ray, group, primitive, inverses)
    stops = 0.0 <= entry <= 1.0
    if stops and load_i64(arguments + 8) != 0:
        channels = _passing_channels(context, ray, hit, np.uint32(instance + np.uint32(1)), group, primitive)
        left = load_u32(context + 56) & np.uint32(channels)
        tints = (load_u32(context + 40) & np.uint32(7)) == np.uint32(KIND_POINT_SHADOW)
        stops = left == np.uint32(0) if tints else channels != ALL_CHANNELS
        if tints and not stops:
            store_u32(context + 56, left)
    return stops


@cfunc(types.void(types.int64), cache=True)
def shadow_filter(arguments):  # type: ignore[no-untyped-def]
    """Let a shadow ray pass what is see-through, or found in some trees only; anything else ends it."""
    if not _stops_shadow(arguments):
        store_u32(load_i64(arguments), np.uint32(0))


@cfunc(types.void(types.int64), cache=True)
def quick_shadow_filter(arguments):  # type: ignore[no-untyped-def]
    """Let a shadow ray end at any candidate, and note which; what is see-through or within an instance is tested at once."""
    context, hit = load_i64(arguments + 16), load_i64(arguments + 32)
    if load_i64(arguments + 8) != 0 or load_u32(hit + 28) != NOBODY:
        if _stops_shadow(arguments):
            store_u32(context + _TO_TESTED, np.uint32(1))
        else:
            store_u32(load_i64(arguments), np.uint32(0))
        return
    store_u32(context + 24, load_u32(hit + 24))
    store_u32(context + 28, load_u32(hit + 20))


FILTERS = (quick_nearest_filter, quick_shadow_filter, nearest_filter, shadow_filter)
"""In the order in which `cast_batch` is given their addresses."""
