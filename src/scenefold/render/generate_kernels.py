"""The generator: camera rays of one pass, in the scattered pixel order (thesis 3.3.3).

Path number n of a job is pixel (n mod P) x stride mod P and sample n div P, P pixels in all; stride is coprime
to P and near the golden ratio of it, so that consecutive paths lie far apart and every pass covers the image.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_CAMERA, PDF_DELTA
from scenefold.render.dice_kernels import PAIR_LENS, PAIR_PIXEL, dice_of, pair
from scenefold.render.lane_values_kernels import alike, lane_numbers, put, real_of_whole, select, take
from scenefold.render.lanes_kernels import LANES
from scenefold.render.math_kernels import decode_direction, encode_color, encode_direction, sine_cosine_of_turns
from scenefold.render.pixel_kernels import pixels_of
from scenefold.render.record_kernels import set_t_done, write_rays
from scenefold.render.space_kernels import box_span

SCRATCH_WORDS = 12 * LANES
"""uint32 words that kernels which go in lanes want to work in."""


def scattering_stride(pixels: int) -> int:
    """The multiplier of the scattered order for this many pixels: coprime to it, near its golden section."""
    stride = max(1, int(pixels * 0.6180339887498949))
    while math.gcd(stride, pixels) != 1:
        stride += 1
    return stride


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def generate_pass(job, first_path, order, out, scratch):  # type: ignore[no-untyped-def]
    """Write the camera rays of a pass's paths order[: len(out)] to out, uint32[n, 9].

    first_path: global number of the pass's path 0; order uint32[n, rounded up to a whole number of `LANES`]; scratch
    uint32[SCRATCH_WORDS].
    A ray is born where it enters the job's box: seen from a camera far away, single precision would not tell
    one surface from the next. One that misses the box altogether is born with t_done 65535.
    """
    camera, low, high = job.camera, job.box_low, job.box_high
    reals = scratch.view(np.float32)
    has_lens = camera[15] > 0.0
    within = camera[14] == 0.0 and not has_lens
    for axis in range(3):
        within = within and low[axis] < camera[axis] < high[axis]
    nobody = alike(np.uint32(0), lane_numbers())
    half = alike(0.5, real_of_whole(nobody))
    white_low, white_high = encode_color(half * 2.0, half * 2.0, half * 2.0, (half, half, half))
    made, count = 0, out.shape[0]
    for first in range(0, count, LANES):
        paths = take(order, first)
        pixel, sample = pixels_of(job, first_path, paths, scratch)
        dice = dice_of(job, pixel, sample, nobody)
        u, v = pair(job, dice, PAIR_PIXEL)
        for k in range(LANES):
            row = scratch[k] // np.uint32(job.width)
            column = np.int64(scratch[k]) - np.int64(row) * job.width
            reals[2 * LANES + k] = np.float32(2.0 * column / job.width - 1.0)
            reals[3 * LANES + k] = np.float32(1.0 - 2.0 * row / job.height)
        x = (take(reals, 2 * LANES) + u * (2.0 / job.width)) * camera[12]
        y = (take(reals, 3 * LANES) - v * (2.0 / job.height)) * camera[13]
        right_x, right_y, right_z = x * camera[3] + y * camera[6], x * camera[4] + y * camera[7], x * camera[5] + y * camera[8]
        if has_lens:
            u, v = pair(job, dice, PAIR_LENS)
            code_u, code_v, right_x, right_y, right_z = _through_lens(camera, u, v, right_x, right_y, right_z)
        elif camera[14] == 0.0:
            code_u, code_v = encode_direction(right_x + camera[9], right_y + camera[10], right_z + camera[11])
        else:
            zero = alike(0.0, x)
            code_u, code_v = encode_direction(zero + camera[9], zero + camera[10], zero + camera[11])
        if within:
            ox, oy, oz = alike(camera[0], x), alike(camera[1], x), alike(camera[2], x)
            steps = np.uint32(0)
        else:
            dx, dy, dz = decode_direction(code_u, code_v)
            put(reals, 0 * LANES, dx)
            put(reals, 1 * LANES, dy)
            put(reals, 2 * LANES, dz)
            put(reals, 3 * LANES, right_x)
            put(reals, 4 * LANES, right_y)
            put(reals, 5 * LANES, right_z)
            steps = _enter_box(job, reals)
            ox, oy, oz = take(reals, 3 * LANES), take(reals, 4 * LANES), take(reals, 5 * LANES)
        before = made
        made = write_rays(
            out, made, lane_numbers() + np.uint32(first) < np.uint32(count), scratch, ox, oy, oz, code_u, code_v, alike(np.uint32(PDF_DELTA), paths),
            white_low, white_high, paths, alike(np.uint32(KIND_CAMERA), paths), nobody,
        )  # fmt: skip
        for k in range(made - before):
            if (steps >> np.uint32(k)) & np.uint32(1):
                set_t_done(out, before + k, 65535)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def disk_point(u, v):  # type: ignore[no-untyped-def]
    """A point of the unit disk, evenly, from two numbers in [0, 1): lanes. Squares about the centre become circles about it
    (Shirley and Chiu, A Low Distortion Map Between Disk and Square, JGT 1997)."""
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    across = abs(a) > abs(b)
    radius, other = select(across, a, b), select(across, b, a)
    ratio = other / select(radius == 0.0, 1.0, radius)
    # From -1/8 of a turn on, which is what the polynomials' first quarter reaches down to.
    sine, cosine = sine_cosine_of_turns(select(across, 0.125 * ratio, 0.25 - 0.125 * ratio))
    return radius * cosine, radius * sine


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _through_lens(camera, u, v, right_x, right_y, right_z):  # type: ignore[no-untyped-def]
    """(code_u, code_v, x, y, z): the way from a point of the lens to what is sharp there, and where that point lies beside the camera.

    right: the place in the image, in the plane at distance 1, or beside an orthographic camera, whose pixels have a lens each.
    """
    a, b = disk_point(u, v)
    a, b = a * camera[15], b * camera[15]
    x, y, z = a * camera[3] + b * camera[6], a * camera[4] + b * camera[7], a * camera[5] + b * camera[8]
    focus = camera[16]
    if camera[14] == 0.0:
        to_x, to_y, to_z = (right_x + camera[9]) * focus, (right_y + camera[10]) * focus, (right_z + camera[11]) * focus
        right_x, right_y, right_z = x, y, z
    else:
        zero = alike(0.0, x)
        to_x, to_y, to_z = zero + camera[9] * focus, zero + camera[10] * focus, zero + camera[11] * focus
        right_x, right_y, right_z = right_x + x, right_y + y, right_z + z
    code_u, code_v = encode_direction(to_x - x, to_y - y, to_z - z)
    return code_u, code_v, right_x, right_y, right_z


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _enter_box(job, reals):  # type: ignore[no-untyped-def]
    """Origins where rays enter the box, in reals[3 * LANES:] in place of how far they begin beside the camera; which rays miss it, as bits.

    reals[0 : 3 * LANES]: directions.
    """
    camera, low, high = job.camera, job.box_low, job.box_high
    missed = np.uint32(0)
    for k in range(LANES):
        dx, dy, dz = np.float64(reals[k]), np.float64(reals[LANES + k]), np.float64(reals[2 * LANES + k])
        ox, oy, oz = camera[0], camera[1], camera[2]
        if camera[14] != 0.0 or camera[15] > 0.0:
            ox, oy, oz = ox + reals[3 * LANES + k], oy + reals[4 * LANES + k], oz + reals[5 * LANES + k]
        # Rounded, its origin may miss by a little what it met: there is nothing in the box's margin anyway.
        t_in, t_out = box_span(ox, oy, oz, dx, dy, dz, low, high)
        if t_in <= t_out:
            ox, oy, oz = ox + dx * t_in, oy + dy * t_in, oz + dz * t_in
        else:
            missed |= np.uint32(1) << np.uint32(k)
        reals[3 * LANES + k], reals[4 * LANES + k], reals[5 * LANES + k] = np.float32(ox), np.float32(oy), np.float32(oz)
    return missed


@njit(error_model="numpy", _nrt=False, forceinline=True)
def depth_of(job, px, py, pz):  # type: ignore[no-untyped-def]
    """How far a point is from the camera, or from its plane if the camera is orthographic."""
    camera = job.camera
    x, y, z = px - camera[0], py - camera[1], pz - camera[2]
    if camera[14] == 0.0:
        return math.sqrt(x * x + y * y + z * z)
    return max(x * camera[9] + y * camera[10] + z * camera[11], 0.0)
