"""Reading and writing ray records as nine 32-bit words (base/rays.py draws the bytes)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_POINT_SHADOW, KIND_SHADOW, RAY_WORDS
from scenefold.render.lane_values_kernels import bits_of, bits_of_flags, gather, lane_numbers, put, real_of_bits, select
from scenefold.render.lanes_kernels import LANES
from scenefold.render.math_kernels import decode_direction
from scenefold.render.precise_kernels import f32_from_bits

_U16 = np.uint32(0xFFFF)
_U8 = np.uint32(0xFF)


class RayLanes(NamedTuple):
    """Path rays in lanes: reals, and words for the rest."""

    x: Any
    y: Any
    z: Any
    code_u: Any
    code_v: Any
    pdf: Any
    """The density's code."""
    color_low: Any
    """The throughput's code."""
    color_high: Any
    path: Any
    kind: Any
    bounce: Any


@njit(error_model="numpy", _nrt=False, forceinline=True)
def read_rays(rays, at):  # type: ignore[no-untyped-def]
    """The rays at these places, words. Of a shadow ray what belongs to a direction means something else."""
    high, rest = gather(rays, (at, 7)), gather(rays, (at, 8))
    return RayLanes(
        real_of_bits(gather(rays, (at, 0))),
        real_of_bits(gather(rays, (at, 1))),
        real_of_bits(gather(rays, (at, 2))),
        gather(rays, (at, 3)),
        gather(rays, (at, 4)),
        gather(rays, (at, 5)) & _U16,
        gather(rays, (at, 6)),
        high & _U16,
        high >> np.uint32(16),
        (rest >> np.uint32(8)) & np.uint32(7),
        (rest >> np.uint32(11)) & np.uint32(31),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def kind_of(rays, i):  # type: ignore[no-untyped-def]
    """One of the KIND_ values."""
    return int((rays[i, 8] >> np.uint32(8)) & np.uint32(7))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def is_shadow_ray(rays, i):  # type: ignore[no-untyped-def]
    """Whether this is a shadow ray of either kind."""
    kind = kind_of(rays, i)
    return kind == KIND_SHADOW or kind == KIND_POINT_SHADOW


@njit(error_model="numpy", _nrt=False, forceinline=True)
def keep_channels(rays, i, channels):  # type: ignore[no-untyped-def]
    """Set the channels of the colour that are not among `channels` (bits 0 to 2) to 0; whether any light is left.

    Exact, and the same in any order and however often it is done.
    """
    code = color_code_of(rays, i)
    for channel in range(3):
        if (channels >> channel) & 1 == 0:
            code &= ~(np.uint64(0x1FFF) << np.uint64(13 * channel))
    rays[i, 6] = np.uint32(code & np.uint64(0xFFFFFFFF))
    rays[i, 7] = (rays[i, 7] & ~_U16) | np.uint32(code >> np.uint64(32))
    return code & np.uint64(0x7FFFFFFFFF) != np.uint64(0)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def t_done_of(rays, i):  # type: ignore[no-untyped-def]
    """Up to which step of its span nothing was hit."""
    return int(rays[i, 8] >> np.uint32(16))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def set_t_done(rays, i, step):  # type: ignore[no-untyped-def]
    """Write the certificate."""
    rays[i, 8] = (rays[i, 8] & _U16) | (np.uint32(step) << np.uint32(16))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def path_of(rays, i):  # type: ignore[no-untyped-def]
    """The path's index in its pass."""
    return int(rays[i, 7] >> np.uint32(16))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def color_code_of(rays, i):  # type: ignore[no-untyped-def]
    """The 48-bit code of throughput or contribution."""
    return np.uint64(rays[i, 6]) | (np.uint64(rays[i, 7] & _U16) << np.uint64(32))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def origin_of(rays, i):  # type: ignore[no-untyped-def]
    """The origin, as three f32."""
    return f32_from_bits(rays[i, 0]), f32_from_bits(rays[i, 1]), f32_from_bits(rays[i, 2])


@njit(error_model="numpy", _nrt=False, forceinline=True)
def end_of(rays, i):  # type: ignore[no-untyped-def]
    """A shadow ray's end point, as three f32."""
    return f32_from_bits(rays[i, 3]), f32_from_bits(rays[i, 4]), f32_from_bits(rays[i, 5])


@njit(error_model="numpy", _nrt=False, forceinline=True)
def unpack_directions(rays, first, reals):  # type: ignore[no-untyped-def]
    """The directions of path rays first .. first + LANES - 1 to reals[0 : 3 * LANES], float32: all x, all y, all z."""
    last = np.uint32(rays.shape[0] - 1)
    at = lane_numbers() + np.uint32(first)
    at = select(at < last, at, last)
    dx, dy, dz = decode_direction(gather(rays, (at, 3)), gather(rays, (at, 4)))
    put(reals, 0, dx)
    put(reals, LANES, dy)
    put(reals, 2 * LANES, dz)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def write_rays(out, made, flags, scratch, ox, oy, oz, word_3, word_4, word_5, color_low, color_high, path, kind, bounce):  # type: ignore[no-untyped-def]
    """Append the flagged lanes to `out` behind its `made` rays, with t_done 0; returns how many there are then.

    Origin in reals, the rest in words: 3 to 5 are direction code and density code of a path ray, or the bits of a shadow ray's
    end. scratch uint32[>= 9 * LANES].
    """
    put(scratch, 0 * LANES, bits_of(ox))
    put(scratch, 1 * LANES, bits_of(oy))
    put(scratch, 2 * LANES, bits_of(oz))
    put(scratch, 3 * LANES, word_3)
    put(scratch, 4 * LANES, word_4)
    put(scratch, 5 * LANES, word_5)
    put(scratch, 6 * LANES, color_low)
    put(scratch, 7 * LANES, color_high | (path << np.uint32(16)))
    put(scratch, 8 * LANES, (kind | (bounce << np.uint32(3))) << np.uint32(8))
    left = bits_of_flags(flags)
    for k in range(LANES):
        if (left >> k) & 1:
            for word in range(RAY_WORDS):
                out[made, word] = scratch[word * LANES + k]
            made += 1
    return made
