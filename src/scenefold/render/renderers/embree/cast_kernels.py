"""The caster: every ray of a batch against the geometry that this node holds, within this node's cell.

Embree is called once a ray, through its address, with the quick filters of filter_kernels.py. Then the boxes of the triangles that
were met are tested, of many rays one after the other, so that these wait for memory at the same time and not in turn.
What is not sure after that is cast again, with the exact filters.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.partition.empty_walk_kernels import first_met
from scenefold.partition.kernels import exit_after, owner_ahead
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
from scenefold.render.renderers.embree.filter_kernels import (
    ALL_CHANNELS,
    ARGUMENTS,
    CONTEXT,
    INVERSES,
    NOBODY,
    NOTES,
    SHADOW_ARGUMENTS,
    near,
)
from scenefold.render.renderers.embree.memory_kernels import call_with_3, load_i64, load_u32, prefetch
from scenefold.render.renderers.embree.own_box_kernels import own_box_entry
from scenefold.render.shade_kernels import STATUS_DEAD, STATUS_FORWARD, STATUS_FREE, STATUS_HIT
from scenefold.render.space_kernels import box_span, step_after, step_before, t_of_step

_INVOKE_ARGUMENT_FILTER = np.uint32(2)
_PAD = 2.0**-20
"""Of the largest coordinate: by so much an instance's box in the world may be off its place by rounding."""
_SURE, _UNTESTED, _AGAIN = np.uint8(0), np.uint8(1), np.uint8(2)
_AHEAD = 8
"""Rays by which memory is asked for ahead of the test that reads it."""


@njit(error_model="numpy", _nrt=False)
def _prepare(workspace, nearest, shadow, addresses):  # type: ignore[no-untyped-def]
    """Arguments of the two queries, each with its filter."""
    base = workspace.ctypes.data
    workspace[:] = np.uint32(0)
    workspace[CONTEXT] = NOBODY
    workspace[CONTEXT + 1] = NOBODY
    words = workspace.view(np.int64)
    words[(CONTEXT + 12) // 2] = addresses.ctypes.data
    for arguments in (ARGUMENTS, SHADOW_ARGUMENTS):
        workspace[arguments] = _INVOKE_ARGUMENT_FILTER
        workspace[arguments + 1] = NOBODY
        words[(arguments + 2) // 2] = base + CONTEXT * 4
    _prepare_filters(workspace, nearest, shadow)
    return base


@njit(error_model="numpy", _nrt=False)
def _prepare_filters(workspace, nearest, shadow):  # type: ignore[no-untyped-def]
    words = workspace.view(np.int64)
    words[(ARGUMENTS + 4) // 2], words[(SHADOW_ARGUMENTS + 4) // 2] = nearest, shadow


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _write_ray(workspace, reals, ox, oy, oz, dx, dy, dz, t_far):  # type: ignore[no-untyped-def]
    reals[0], reals[1], reals[2], reals[3] = ox, oy, oz, np.float32(0.0)
    reals[4], reals[5], reals[6], reals[7] = dx, dy, dz, np.float32(0.0)
    reals[8] = t_far
    workspace[9], workspace[10], workspace[11] = NOBODY, np.uint32(0), np.uint32(0)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _corners_address(addresses, hit_ids, i):  # type: ignore[no-untyped-def]
    """Where the three corners of the triangle lie that a ray met."""
    first = load_i64(addresses[8] + 8 * np.int64(hit_ids[i, 1]))
    return addresses[2] + 12 * (first + np.int64(hit_ids[i, 2]))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _prefetch_vertices(addresses, hit_ids, i):  # type: ignore[no-untyped-def]
    corners = _corners_address(addresses, hit_ids, i)
    for corner in range(3):
        prefetch(addresses[0] + 12 * np.int64(load_u32(corners + 4 * corner)))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _is_sound(addresses, workspace, base, rays, i, status, hit_ids, ways, reached):  # type: ignore[no-untyped-def]
    """Whether what the quick filters found is what the exact ones would find: the ray meets the triangle's own box, and not behind t."""
    reals = workspace.view(np.float32)
    ox, oy, oz = origin_of(rays, i)
    _write_ray(workspace, reals, ox, oy, oz, ways[i, 0], ways[i, 1], ways[i, 2], np.float32(0.0))
    entry = own_box_entry(addresses.ctypes.data, base, hit_ids[i, 1], hit_ids[i, 2], 0)
    if status[i] == STATUS_DEAD:
        return 0.0 <= entry <= 1.0
    return entry >= 0.0 and np.float32(entry) <= near(reached[i])


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _cast(  # type: ignore[no-untyped-def]
    intersect,
    occluded,
    quick,
    see_through,
    scene_address,
    first_instance_id,
    workspace,
    base,
    rays,
    i,
    alone,
    family,
    cells,
    node,
    job,
    first_path,
    status,
    hit_uv,
    hit_ids,
    ways,
    reached,
):
    """Cast one ray; how sure what was found is: `_SURE`, `_UNTESTED`, or `_AGAIN` (then nothing was written that matters)."""
    reals = workspace.view(np.float32)
    step = t_done_of(rays, i)
    if step == 65535:
        status[i] = STATUS_FREE
        return _SURE
    ox, oy, oz = origin_of(rays, i)
    if see_through != 0:
        pixel, sample = pixel_of(job, np.uint64(first_path + path_of(rays, i)))
        workspace.view(np.uint64)[(CONTEXT + 8) // 2] = path_key(job.seed, job.frame, pixel, sample)
        workspace[CONTEXT + 10] = (rays[i, 8] >> np.uint32(8)) & np.uint32(0xFF)
    is_shadow = is_shadow_ray(rays, i)
    fx, fy, fz = ways[i, 0], ways[i, 1], ways[i, 2]
    t_limit = 1.0 if is_shadow else math.inf
    if alone != 0:
        step = 65535
    else:
        low, high = job.box_low, job.box_high
        x, y, z, dx, dy, dz = np.float64(ox), np.float64(oy), np.float64(oz), np.float64(fx), np.float64(fy), np.float64(fz)
        t_in, t_out = (0.0, 1.0) if is_shadow else box_span(x, y, z, dx, dy, dz, low, high)
        t_exit = exit_after(family, cells, node, x, y, z, dx, dy, dz, t_of_step(step, t_in, t_out))
        step = step_after(t_exit, t_in, t_out, step)
        if step < 65535:
            t_limit = t_of_step(step, t_in, t_out)
    if see_through != 0 or not quick:
        inverses = workspace.view(np.float64)[INVERSES // 2 :]
        inverses[0], inverses[1], inverses[2] = 1.0 / np.float64(fx), 1.0 / np.float64(fy), 1.0 / np.float64(fz)
    workspace[NOTES], workspace[NOTES + 1] = np.uint32(0), np.uint32(0)
    if is_shadow:
        _write_ray(workspace, reals, ox, oy, oz, fx, fy, fz, min(np.float32(t_limit * (1.0 + 2.0**-22)), np.float32(1.0)))
        workspace[CONTEXT + 14] = np.uint32(ALL_CHANNELS)
        call_with_3(occluded, scene_address, base, base + SHADOW_ARGUMENTS * 4)
        dead = reals[8] < np.float32(0.0)
        if not dead and workspace[CONTEXT + 14] != np.uint32(ALL_CHANNELS):
            dead = not keep_channels(rays, i, workspace[CONTEXT + 14])
            workspace[NOTES + 1] = np.uint32(1)
        if dead:
            status[i] = STATUS_DEAD
            if not quick or workspace[NOTES + 1] != np.uint32(0):
                return _SURE
            hit_ids[i, 1], hit_ids[i, 2] = workspace[CONTEXT + 6], workspace[CONTEXT + 7]
            return _UNTESTED
    else:
        reals[CONTEXT + 4] = np.float32(math.inf)
        workspace[CONTEXT + 5], workspace[CONTEXT + 6], workspace[CONTEXT + 7] = NOBODY, NOBODY, NOBODY
        workspace[17], workspace[18], workspace[19] = NOBODY, NOBODY, NOBODY
        pad = reals[CONTEXT + 11]
        # The search reaches a little past the limit; what it finds there is left to the next node.
        _write_ray(workspace, reals, ox, oy, oz, fx, fy, fz, np.float32(t_limit * (1.0 + 2.0**-20) + pad))
        call_with_3(intersect, scene_address, base, base + ARGUMENTS * 4)
        t = reals[CONTEXT + 4]
        if float(t) <= t_limit and workspace[18] != NOBODY:
            tested = not quick or workspace[NOTES + 1] != np.uint32(0)
            if workspace[NOTES] != np.uint32(0) or not (tested or float(near(t)) <= t_limit):
                return _AGAIN
            status[i] = STATUS_HIT
            reached[i] = t
            hit_uv[i, 0], hit_uv[i, 1] = reals[15], reals[16]
            instance = workspace[19]
            hit_ids[i, 0] = np.uint32(0) if instance == NOBODY else instance - np.uint32(first_instance_id) + np.uint32(1)
            hit_ids[i, 1], hit_ids[i, 2] = workspace[18], workspace[17]
            return _SURE if tested else _UNTESTED
    set_t_done(rays, i, step)
    status[i] = STATUS_FREE if step == 65535 else STATUS_FORWARD
    return _SURE


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def cast_batch(  # type: ignore[no-untyped-def]
    intersect,
    occluded,
    filters,
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
    ways,
    reached,
    listed,
):
    """Cast each ray to where it leaves this node's cell, or to what it hits before.

    rays uint32[n, 9], whose t_done is advanced; status uint8[n]; hit_uv float32[n, 2]; hit_ids uint32[n, 3]
    (instance, group, primitive), both written for hits. `first_instance_id`: Embree's id of instance 1. `filters`, int64[4], are the
    addresses of quick_nearest_filter, quick_shadow_filter, nearest_filter and shadow_filter, and `addresses`, int64[TABLE_WORDS], says
    where these find their arrays; `see_through` is 0 where nothing that is held lets rays pass. `alone` is not 0 where there is one cell only,
    so that every ray is cast to its end. To work in: scratch uint32[SCRATCH_WORDS], ways float32[n, 3], reached float32[n], listed int64[2 n].
    A path ray that is already done (65535) left the job's box before it met any cell: it is free at once.
    """
    base = _prepare(workspace, filters[0], filters[1], addresses)
    workspace[CONTEXT + 15] = np.uint32(first_instance_id)
    low, high = job.box_low, job.box_high
    reach = 0.0
    for axis in range(3):
        reach = max(reach, max(abs(low[axis]), abs(high[axis])))
    workspace.view(np.float32)[CONTEXT + 11] = np.float32(reach * _PAD)
    directions = scratch.view(np.float32)
    untested = again = 0
    for i in range(rays.shape[0]):
        lane = i & (LANES - 1)
        if lane == 0:
            unpack_directions(rays, i, directions)
        if is_shadow_ray(rays, i):
            ox, oy, oz = origin_of(rays, i)
            ex, ey, ez = end_of(rays, i)
            ways[i, 0], ways[i, 1], ways[i, 2] = np.float32(ex - ox), np.float32(ey - oy), np.float32(ez - oz)
        else:
            ways[i, 0], ways[i, 1], ways[i, 2] = directions[lane], directions[LANES + lane], directions[2 * LANES + lane]
        sure = _cast(
            intersect, occluded, True, see_through, scene_address, first_instance_id, workspace, base, rays, i, alone, family, cells,
            node, job, first_path, status, hit_uv, hit_ids, ways, reached,
        )  # fmt: skip
        if sure == _UNTESTED:
            prefetch(_corners_address(addresses, hit_ids, i))
            listed[untested] = i
            untested += 1
        elif sure == _AGAIN:
            again += 1
            listed[listed.shape[0] - again] = i
    # The test comes last of all: what is refused joins those at the far end of the list, whose places it left itself.
    for k in range(untested):
        if k + _AHEAD < untested:
            _prefetch_vertices(addresses, hit_ids, listed[k + _AHEAD])
        i = listed[k]
        if not _is_sound(addresses, workspace, base, rays, i, status, hit_ids, ways, reached):
            again += 1
            listed[listed.shape[0] - again] = i
    if again > 0:
        _prepare_filters(workspace, filters[2], filters[3])
        for k in range(again):
            _cast(
                intersect, occluded, False, see_through, scene_address, first_instance_id, workspace, base, rays,
                listed[listed.shape[0] - 1 - k], alone, family, cells, node, job, first_path, status, hit_uv, hit_ids, ways, reached,
            )  # fmt: skip


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def find_owners(rays, family, cells, empty, low, high, me, owners, scratch):  # type: ignore[no-untyped-def]
    """Which node casts each ray next: the owner of the place up to which it is done, or behind that of the first where it may meet something.

    What lies between is empty, and t_done is advanced over it. A ray that is done for good stays with whoever holds it. `empty`: an
    `EmptySpace`. owners int32[n] is written; scratch uint32[SCRATCH_WORDS].
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
            t_in, t_out = 0.0, 1.0
        else:
            dx, dy, dz = np.float64(directions[lane]), np.float64(directions[LANES + lane]), np.float64(directions[2 * LANES + lane])
            t_in, t_out = box_span(x, y, z, dx, dy, dz, low, high)
        t = t_of_step(step, t_in, t_out)
        owner = owner_ahead(family, cells, x + dx * t, y + dy * t, z + dz * t, dx, dy, dz)
        # What goes on here is cast here anyway: to look ahead would cost more.
        if owner != me and empty.reach.shape[0] > 0:
            t_met = first_met(empty, x, y, z, dx, dy, dz, t, t_out)
            if t_met == math.inf:
                set_t_done(rays, i, 65535)
                owner = me
            elif t_met > t:
                set_t_done(rays, i, step_before(t_met, t_in, t_out, step))
                owner = owner_ahead(family, cells, x + dx * t_met, y + dy * t_met, z + dz * t_met, dx, dy, dz)
        owners[i] = owner
