"""What an image looks like so far: sums of radiance in few pixels, that nodes add up and a client makes a picture of (specs/34-previews.md). Pure.

Not a film: in floats, so its bits depend on who added what first, and without anything but the beauty. It is looked at, and thrown away.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.render.arrays import F32
from scenefold.render.developing import radiance_of
from scenefold.render.film import Film

PREVIEW_PIXELS_MAX = 1 << 19
"""Of a larger image several pixels are one of its preview."""
CHANNELS = 4
"""Of each pixel: the sums of its paths' radiance, red, green and blue, and how many they are."""
PIXEL_BYTES = 4 * CHANNELS
SUM_MAX = 1e30
"""Far above what paths of any image come to, and so far below what a float holds that no sum of such sums is infinite."""
Sums = npt.NDArray[np.float32]
"""float32[height, width, CHANNELS], top row first."""


def block_of(width: int, height: int) -> int:
    """So many pixels of an image, each way, are one of its preview."""
    block = max(1, math.isqrt(max(0, width * height - 1) // PREVIEW_PIXELS_MAX))
    while -(-width // block) * -(-height // block) > PREVIEW_PIXELS_MAX:
        block += 1
    return block


def preview_shape(width: int, height: int) -> tuple[int, int]:
    """Height and width of the preview of an image."""
    block = block_of(width, height)
    return -(-height // block), -(-width // block)


def preview_bytes(width: int, height: int) -> int:
    """As it travels."""
    rows, columns = preview_shape(width, height)
    return rows * columns * PIXEL_BYTES


def nothing_of(width: int, height: int) -> Sums:
    """As long as no pass is closed."""
    return np.zeros((*preview_shape(width, height), CHANNELS), np.float32)


def add_rows(sums: Sums, film: Film, first: int, last: int) -> None:
    """Add what rows `first` to `last` - 1 of a film come to."""
    block, columns = block_of(film.width, film.height), sums.shape[1]
    part = film.rows.part(first, last)
    y, x = np.divmod(film.pixels_of_rows(first, first + len(part.words)), film.width)
    values = np.concatenate([radiance_of(part), part.samples[:, None]], axis=1).astype(np.float32)
    np.add.at(sums.reshape(-1, CHANNELS), y // block * columns + x // block, values)


def unpack_preview(payload: bytes | bytearray, width: int, height: int) -> Sums:
    """What `tobytes` of one gave, in the same memory. PeerFault if it is none of an image of this size: its size, or values that no paths have."""
    if len(payload) != preview_bytes(width, height):
        raise PeerFault("a preview has another size than its image", where=f"{len(payload)} bytes")
    sums = np.frombuffer(payload, "<f4").astype(np.float32, copy=False).reshape(*preview_shape(width, height), CHANNELS)
    # Also what is no number is not below.
    if not (np.abs(sums) < SUM_MAX).all() or (sums[:, :, CHANNELS - 1] < 0.0).any():
        raise PeerFault("a preview has values that cannot be")
    return sums


def picture_of(sums: Sums) -> F32:
    """The mean radiance, float32[height, width, 3]; where nothing is known yet, that of what lies around."""
    known = sums[:, :, CHANNELS - 1 :] > 0.0
    mean: F32 = (sums[:, :, : CHANNELS - 1] / np.maximum(sums[:, :, CHANNELS - 1 :], 1.0)).astype(np.float32, copy=False)
    height, width = known.shape[:2]
    if known.all() or height == width == 1:
        return mean
    coarse = picture_of(_halved(sums))
    around = coarse.repeat(2, axis=0)[:height].repeat(2, axis=1)[:, :width]
    return np.where(known, mean, around).astype(np.float32, copy=False)


def _halved(sums: Sums) -> Sums:
    """Two by two pixels as one."""
    height, width = sums.shape[:2]
    even = np.pad(sums, ((0, height % 2), (0, width % 2), (0, 0)))
    halved: Sums = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2, CHANNELS).sum(axis=(1, 3), dtype=np.float32)
    return halved
