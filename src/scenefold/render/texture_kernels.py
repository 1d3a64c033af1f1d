"""Looking up RGBA8 textures: nearest or bilinear, with glTF's three ways to wrap, as a texture use says (specs/05-scene-content.md).

Where more than a texel lies within a footprint, also between levels (*Levels* there).
"""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.arrays import TextureColumn, TextureUseColumn
from scenefold.scene.payloads.texture_uses import Minify

_OFFSET, _WIDTH, _HEIGHT, _SRGB = TextureColumn.OFFSET, TextureColumn.WIDTH_PX, TextureColumn.HEIGHT_PX, TextureColumn.SRGB
_TEXTURE, _UV_SET, _NEAREST = TextureUseColumn.TEXTURE, TextureUseColumn.UV_SET, TextureUseColumn.NEAREST
_WRAP_S, _WRAP_T, _MINIFY = TextureUseColumn.WRAP_S, TextureUseColumn.WRAP_T, TextureUseColumn.MINIFY
_LEVELS = TextureColumn.LEVELS
_NEAREST_OF_NEAREST, _NEAREST_BETWEEN = int(Minify.NEAREST_OF_NEAREST), int(Minify.NEAREST_BETWEEN)
_M00, _M01, _M02, _M10, _M11, _M12 = (
    TextureUseColumn.M00,
    TextureUseColumn.M01,
    TextureUseColumn.M02,
    TextureUseColumn.M10,
    TextureUseColumn.M11,
    TextureUseColumn.M12,
)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _wrapped(index, size, wrap):  # type: ignore[no-untyped-def]
    if wrap == 1:
        return min(max(index, 0), size - 1)
    if wrap == 2:
        index = index % (2 * size)
        return index if index < size else 2 * size - 1 - index
    return index % size


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _texel(texels, linear_of_srgb, srgb, offset, width, column, row):  # type: ignore[no-untyped-def]
    at = offset + (row * width + column) * 4
    r, g, b, a = texels[at], texels[at + 1], texels[at + 2], texels[at + 3] / 255.0
    if srgb:
        return linear_of_srgb[r], linear_of_srgb[g], linear_of_srgb[b], a
    return r / 255.0, g / 255.0, b / 255.0, a


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _sample_level(texels, linear_of_srgb, srgb, offset, width, height, u, v, wrap_s, wrap_t, nearest):  # type: ignore[no-untyped-def]
    """Linear RGBA (four f64) of one level, which begins at `offset` of the texels."""
    # Coordinates far outside would overflow the whole-number arithmetic; such a surface has no detail anyway.
    x = min(max(u, -1e6), 1e6) * width
    y = min(max(v, -1e6), 1e6) * height
    if nearest:
        column = _wrapped(int(math.floor(x)), width, wrap_s)
        row = _wrapped(int(math.floor(y)), height, wrap_t)
        return _texel(texels, linear_of_srgb, srgb, offset, width, column, row)
    x -= 0.5
    y -= 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    c0, c1 = _wrapped(int(left), width, wrap_s), _wrapped(int(left) + 1, width, wrap_s)
    r0, r1 = _wrapped(int(top), height, wrap_t), _wrapped(int(top) + 1, height, wrap_t)
    a0, a1, a2, a3 = _texel(texels, linear_of_srgb, srgb, offset, width, c0, r0)
    b0, b1, b2, b3 = _texel(texels, linear_of_srgb, srgb, offset, width, c1, r0)
    d0, d1, d2, d3 = _texel(texels, linear_of_srgb, srgb, offset, width, c0, r1)
    e0, e1, e2, e3 = _texel(texels, linear_of_srgb, srgb, offset, width, c1, r1)
    w00, w10, w01, w11 = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy
    return (
        a0 * w00 + b0 * w10 + d0 * w01 + e0 * w11,
        a1 * w00 + b1 * w10 + d1 * w01 + e1 * w11,
        a2 * w00 + b2 * w10 + d2 * w01 + e2 * w11,
        a3 * w00 + b3 * w10 + d3 * w01 + e3 * w11,
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_texture(textures, texels, linear_of_srgb, texture, u, v, wrap_s, wrap_t, nearest):  # type: ignore[no-untyped-def]
    """Linear RGBA (four f64) at texture coordinates (u, v), v from the top as glTF has it; of the finest level."""
    return _sample_level(
        texels, linear_of_srgb, textures[texture, _SRGB] != 0, textures[texture, _OFFSET], textures[texture, _WIDTH],
        textures[texture, _HEIGHT], u, v, wrap_s, wrap_t, nearest,
    )  # fmt: skip


@njit(error_model="numpy", _nrt=False)
def sample_levels(textures, texels, linear_of_srgb, texture, u, v, wrap_s, wrap_t, minify, count):  # type: ignore[no-untyped-def]
    """Linear RGBA (four f64) where `count` texels of the finest level, more than one, lie within the footprint; minify: 1 to 4 (`Minify`).

    The level grows by one with each doubling of the footprint's width, and evenly with the width between two of them.
    """
    offset, width, height = textures[texture, _OFFSET], textures[texture, _WIDTH], textures[texture, _HEIGHT]
    srgb, last = textures[texture, _SRGB] != 0, textures[texture, _LEVELS] - 1
    nearest, between = (minify == _NEAREST_OF_NEAREST) | (minify == _NEAREST_BETWEEN), minify >= _NEAREST_BETWEEN
    level = 0
    while count >= 4.0 and level < last:
        offset += width * height * 4
        width, height = max(width >> 1, 1), max(height >> 1, 1)
        count *= 0.25
        level += 1
    part = 0.0
    if level < last:
        # Half a level up the footprint is the square root of two times as wide.
        part = math.sqrt(count) - 1.0 if between else (1.0 if count >= 2.0 else 0.0)
    r = g = b = a = 0.0
    if part < 1.0:
        r, g, b, a = _sample_level(texels, linear_of_srgb, srgb, offset, width, height, u, v, wrap_s, wrap_t, nearest)
    if part > 0.0:
        offset += width * height * 4
        width, height = max(width >> 1, 1), max(height >> 1, 1)
        cr, cg, cb, ca = _sample_level(texels, linear_of_srgb, srgb, offset, width, height, u, v, wrap_s, wrap_t, nearest)
        r, g, b, a = r + (cr - r) * part, g + (cg - g) * part, b + (cb - b) * part, a + (ca - a) * part
    return r, g, b, a


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_use(scene, use, u, v, u2, v2):  # type: ignore[no-untyped-def]
    """Linear RGBA (four f64) of a use, a row of `scene.texture_uses`, where the vertices' two sets of coordinates are these."""
    row = scene.texture_uses[use]
    s, t = (u2, v2) if row[_UV_SET] != 0.0 else (u, v)
    return sample_texture(
        scene.textures, scene.texels, scene.linear_of_srgb, int(row[_TEXTURE]),
        row[_M00] * s + row[_M01] * t + row[_M02], row[_M10] * s + row[_M11] * t + row[_M12],
        int(row[_WRAP_S]), int(row[_WRAP_T]), row[_NEAREST] != 0.0,
    )  # fmt: skip


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_use_over(scene, use, u, v, u2, v2, area, area2):  # type: ignore[no-untyped-def]
    """`sample_use` of a footprint that covers these squared units of the vertices' two sets of coordinates (footprint_kernels.py)."""
    row = scene.texture_uses[use]
    covered = area2 if row[_UV_SET] != 0.0 else area
    if row[_MINIFY] != 0.0 and covered > 0.0:
        texture = int(row[_TEXTURE])
        grown = abs(row[_M00] * row[_M11] - row[_M01] * row[_M10])
        count = covered * grown * (scene.textures[texture, _WIDTH] * scene.textures[texture, _HEIGHT])
        if count > 1.0:
            s, t = (u2, v2) if row[_UV_SET] != 0.0 else (u, v)
            return sample_levels(
                scene.textures, scene.texels, scene.linear_of_srgb, texture,
                row[_M00] * s + row[_M01] * t + row[_M02], row[_M10] * s + row[_M11] * t + row[_M12],
                int(row[_WRAP_S]), int(row[_WRAP_T]), int(row[_MINIFY]), count,
            )  # fmt: skip
    return sample_use(scene, use, u, v, u2, v2)
