"""Reading and writing ray records as nine 32-bit words (base/rays.py draws the bytes)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_POINT_SHADOW, KIND_SHADOW
from scenefold.render.lane_values_kernels import f32_of_bits, gather
from scenefold.render.math_kernels import f32_bits, f32_from_bits

_U16 = np.uint32(0xFFFF)
_U8 = np.uint32(0xFF)


class HitRays(NamedTuple):
    """Path rays in lanes: reals, and words for the rest."""

    x: Any
    y: Any
    z: Any
    code_u: Any
    code_v: Any
    pdf: Any
    """The density's code."""
    color: Any
    """The throughput's."""
    path: Any
    kind: Any
    bounce: Any


@njit(error_model="numpy", _nrt=False)
def read_hit_rays(rays, at):  # type: ignore[no-untyped-def]
    """The path rays at these places, words."""
    low, high, rest = gather(rays, (at, 6)), gather(rays, (at, 7)), gather(rays, (at, 8))
    return HitRays(
        f32_of_bits(gather(rays, (at, 0))),
        f32_of_bits(gather(rays, (at, 1))),
        f32_of_bits(gather(rays, (at, 2))),
        gather(rays, (at, 3)),
        gather(rays, (at, 4)),
        gather(rays, (at, 5)) & np.uint64(0xFFFF),
        low | ((high & np.uint64(0xFFFF)) << np.uint64(32)),
        high >> np.uint64(16),
        (rest >> np.uint64(8)) & np.uint64(7),
        (rest >> np.uint64(11)) & np.uint64(31),
    )


@njit(error_model="numpy", _nrt=False)
def kind_of(rays, i):  # type: ignore[no-untyped-def]
    """One of the KIND_ values."""
    return int((rays[i, 8] >> np.uint32(8)) & np.uint32(7))


@njit(error_model="numpy", _nrt=False)
def is_shadow_ray(rays, i):  # type: ignore[no-untyped-def]
    """Whether this is a shadow ray of either kind."""
    kind = kind_of(rays, i)
    return kind == KIND_SHADOW or kind == KIND_POINT_SHADOW


@njit(error_model="numpy", _nrt=False)
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


@njit(error_model="numpy", _nrt=False)
def bounce_of(rays, i):  # type: ignore[no-untyped-def]
    """How often the path was scattered before this ray."""
    return int((rays[i, 8] >> np.uint32(11)) & np.uint32(31))


@njit(error_model="numpy", _nrt=False)
def t_done_of(rays, i):  # type: ignore[no-untyped-def]
    """Up to which step of its span nothing was hit."""
    return int(rays[i, 8] >> np.uint32(16))


@njit(error_model="numpy", _nrt=False)
def set_t_done(rays, i, step):  # type: ignore[no-untyped-def]
    """Write the certificate."""
    rays[i, 8] = (rays[i, 8] & _U16) | (np.uint32(step) << np.uint32(16))


@njit(error_model="numpy", _nrt=False)
def path_of(rays, i):  # type: ignore[no-untyped-def]
    """The path's index in its pass."""
    return int(rays[i, 7] >> np.uint32(16))


@njit(error_model="numpy", _nrt=False)
def color_code_of(rays, i):  # type: ignore[no-untyped-def]
    """The 48-bit code of throughput or contribution."""
    return np.uint64(rays[i, 6]) | (np.uint64(rays[i, 7] & _U16) << np.uint64(32))


@njit(error_model="numpy", _nrt=False)
def pdf_code_of(rays, i):  # type: ignore[no-untyped-def]
    """The code of the density that a path ray's direction was drawn from."""
    return int(rays[i, 5] & _U16)


@njit(error_model="numpy", _nrt=False)
def origin_of(rays, i):  # type: ignore[no-untyped-def]
    """The origin, as three f32."""
    return f32_from_bits(rays[i, 0]), f32_from_bits(rays[i, 1]), f32_from_bits(rays[i, 2])


@njit(error_model="numpy", _nrt=False)
def end_of(rays, i):  # type: ignore[no-untyped-def]
    """A shadow ray's end point, as three f32."""
    return f32_from_bits(rays[i, 3]), f32_from_bits(rays[i, 4]), f32_from_bits(rays[i, 5])


@njit(error_model="numpy", _nrt=False)
def _write_rest(rays, i, ox, oy, oz, color, path, kind, bounce, step):  # type: ignore[no-untyped-def]
    rays[i, 0], rays[i, 1], rays[i, 2] = f32_bits(ox), f32_bits(oy), f32_bits(oz)
    rays[i, 6] = np.uint32(color & np.uint64(0xFFFFFFFF))
    rays[i, 7] = np.uint32(color >> np.uint64(32)) | (np.uint32(path) << np.uint32(16))
    rays[i, 8] = ((np.uint32(kind) | (np.uint32(bounce) << np.uint32(3))) << np.uint32(8)) | (np.uint32(step) << np.uint32(16))


@njit(error_model="numpy", _nrt=False)
def write_path_ray(rays, i, ox, oy, oz, code_u, code_v, pdf_code, color, path, kind, bounce, step):  # type: ignore[no-untyped-def]
    """A camera or bounce ray; origin f32, colour as its 48-bit code."""
    rays[i, 3], rays[i, 4], rays[i, 5] = code_u, code_v, np.uint32(pdf_code)
    _write_rest(rays, i, ox, oy, oz, color, path, kind, bounce, step)


@njit(error_model="numpy", _nrt=False)
def write_shadow_ray(rays, i, ox, oy, oz, ex, ey, ez, color, path, kind, bounce):  # type: ignore[no-untyped-def]
    """A shadow ray with its finished contribution."""
    rays[i, 3], rays[i, 4], rays[i, 5] = f32_bits(ex), f32_bits(ey), f32_bits(ez)
    _write_rest(rays, i, ox, oy, oz, color, path, kind, bounce, 0)
