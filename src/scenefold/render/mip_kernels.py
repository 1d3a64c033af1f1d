"""The coarser levels of textures, each half as wide and as high, down to one texel (specs/05-scene-content.md, *Levels*).

Whole numbers only, so that a level has the same bytes everywhere. A level is made of the one before it by areas: of an odd side
n = 2m + 1, texel i of m has three in it, of weights m - i, m and i + 1 (polyphase box filter: Guthe and Heckbert, "Non-power-of-two
mipmapping", 2005).
"""

from __future__ import annotations

import numpy as np
from numba import njit

_TABLE = 65536


def level_sizes(width: int, height: int) -> list[tuple[int, int]]:
    """(width, height) of all levels of an image, from itself to one texel."""
    sizes = [(width, height)]
    while max(width, height) > 1:
        width, height = max(width // 2, 1), max(height // 2, 1)
        sizes.append((width, height))
    return sizes


@njit(nogil=True, cache=True, error_model="numpy")
def level_tables(linear_of_byte, coded):  # type: ignore[no-untyped-def]
    """(int64[256]: bytes as linear values of 16 bits; uint8[65536]: the byte whose linear value is nearest to one of these).

    linear_of_byte float64[256], ascending from 0 to 1, counts if `coded`; else a byte b is b / 255 of the range.
    """
    values, bytes_ = np.empty(256, np.int64), np.empty(_TABLE, np.uint8)
    for byte in range(256):
        values[byte] = np.int64(linear_of_byte[byte] * 65535.0 + 0.5) if coded else byte * 257
    byte = 0
    for value in range(_TABLE):
        while byte < 255 and values[byte] + values[byte + 1] <= 2 * value:
            byte += 1
        bytes_[value] = byte
    return values, bytes_


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _weights(place, size):  # type: ignore[no-untyped-def]
    """Of three texels from 2 x place on, of a side of this size."""
    half = size // 2
    if size == 1:
        return 1, 0, 0
    if size == 2 * half:
        return 1, 1, 0
    return half - place, half, place + 1


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def fill_level(finer, coarser, values, bytes_, by_alpha):  # type: ignore[no-untyped-def]
    """Write a level, uint8[h', w', 4], from the one before it, uint8[h, w, 4]; tables of `level_tables`.

    by_alpha: colours count as much as they are opaque, so that what is hidden does not bleed into what is seen; where nothing is seen
    they count alike, and what is seen a little has an alpha of 1 at least.
    """
    height, width = finer.shape[0], finer.shape[1]
    for row in range(coarser.shape[0]):
        rows = _weights(row, height)
        for column in range(coarser.shape[1]):
            columns = _weights(column, width)
            r = g = b = a = total = 0
            seen_r = seen_g = seen_b = 0
            for y in range(3):
                for x in range(3):
                    weight = rows[y] * columns[x]
                    if weight == 0:
                        continue
                    texel = finer[2 * row + y, 2 * column + x]
                    alpha = np.int64(texel[3])
                    vr, vg, vb = values[texel[0]], values[texel[1]], values[texel[2]]
                    total += weight
                    a += weight * alpha
                    r += weight * vr
                    g += weight * vg
                    b += weight * vb
                    seen_r += weight * alpha * vr
                    seen_g += weight * alpha * vg
                    seen_b += weight * alpha * vb
            opaque, whole = (a + total // 2) // total, total
            if by_alpha and a > 0:
                r, g, b, whole, opaque = seen_r, seen_g, seen_b, a, max(opaque, 1)
            coarser[row, column, 0] = bytes_[(r + whole // 2) // whole]
            coarser[row, column, 1] = bytes_[(g + whole // 2) // whole]
            coarser[row, column, 2] = bytes_[(b + whole // 2) // whole]
            coarser[row, column, 3] = opaque
