"""If this fails, textures appear shifted, mirrored the wrong way, or in wrong colours, or a lookup reads foreign memory."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from scenefold.render.setup_kernels import linear_of_srgb
from unit.render import probe_kernels as probe

RANDOM = np.random.default_rng(5)
SIZES = ((7, 5), (1, 1), (16, 3))
IMAGES = [RANDOM.integers(0, 256, (height, width, 4), np.uint8) for width, height in SIZES]
OFFSETS = np.cumsum([0] + [image.size for image in IMAGES])[:-1]
ROWS = np.array(
    [[at, width, height, number % 2] for number, (at, (width, height)) in enumerate(zip(OFFSETS, SIZES, strict=True))], np.int64
)
TEXELS = np.concatenate([image.ravel() for image in IMAGES])
LINEAR = linear_of_srgb()

Color = np.ndarray[tuple[int], np.dtype[np.float64]]


def srgb_to_linear(byte: int) -> float:
    value = byte / 255
    return value / 12.92 if value <= 0.04045 else math.pow((value + 0.055) / 1.055, 2.4)


def slow_texel(number: int, column: int, row: int, wraps: tuple[int, int]) -> Color:
    """One pixel, wrapped, linear."""
    place = []
    for index, size, wrap in zip((column, row), SIZES[number], wraps, strict=True):
        if wrap == 0:
            index %= size
        elif wrap == 1:
            index = min(max(index, 0), size - 1)
        else:
            index %= 2 * size
            index = min(index, 2 * size - 1 - index)
        place.append(index)
    r, g, b, a = (int(value) for value in IMAGES[number][place[1], place[0]])
    colors = [srgb_to_linear(value) if number % 2 else value / 255 for value in (r, g, b)]
    return np.array([*colors, a / 255])


def slow_lookup(number: int, u: float, v: float, wraps: tuple[int, int], nearest: bool) -> Color:
    """A lookup from the definition: pixel centres lie at half-odd places."""
    width, height = SIZES[number]
    if nearest:
        return slow_texel(number, math.floor(u * width), math.floor(v * height), wraps)
    x, y = u * width - 0.5, v * height - 0.5
    left, top = math.floor(x), math.floor(y)
    total = np.zeros(4)
    for column, row in itertools.product((0, 1), (0, 1)):
        weight = abs(1 - column - (x - left)) * abs(1 - row - (y - top))
        total += weight * slow_texel(number, left + column, top + row, wraps)
    return total


def test_bytes_become_linear_as_srgb_says() -> None:
    assert np.abs(LINEAR - [srgb_to_linear(byte) for byte in range(256)]).max() < 1e-15


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("wraps", list(itertools.product((0, 1, 2), repeat=2)))
def test_lookups_are_those_of_the_slow_reference(wraps: tuple[int, int], nearest: bool) -> None:
    uvs = RANDOM.uniform(-3.5, 3.5, (150, 2))
    uvs[:9] = list(itertools.product((0.0, 1.0, -1.0), repeat=2))
    for number in range(len(SIZES)):
        found = probe.texture_samples(ROWS, TEXELS, LINEAR, number, uvs, *wraps, nearest)
        expected = [slow_lookup(number, u, v, wraps, nearest) for u, v in uvs]
        assert np.abs(found - expected).max() < 1e-12


def test_pixel_centres_show_their_pixel() -> None:
    width, height = SIZES[0]
    row, column = (axis.ravel() for axis in np.meshgrid(np.arange(height), np.arange(width), indexing="ij"))
    uvs = np.stack([(column + 0.5) / width, (row + 0.5) / height], axis=1)
    for nearest in (False, True):
        found = probe.texture_samples(ROWS, TEXELS, LINEAR, 0, uvs, 0, 0, nearest)
        assert np.abs(found - IMAGES[0].reshape(-1, 4) / 255).max() < 1e-12, "v = 0 is the top row"


@pytest.mark.parametrize("nearest", [False, True])
def test_coordinates_from_far_outside_read_nothing_foreign(nearest: bool) -> None:
    values = [0.0, 1e6, -1e6, 1e30, -1e30, math.inf, -math.inf, math.nan, 1e-300, -1e-300]
    uvs = np.array(list(itertools.product(values, repeat=2)))
    finite = np.isfinite(uvs).all(axis=1)
    pixel, row = TEXELS[OFFSETS[1] : OFFSETS[1] + 4].copy(), np.array([[0, 1, 1, 1]], np.int64)
    for wraps in itertools.product((0, 1, 2), repeat=2):
        found = probe.texture_samples(row, pixel, LINEAR, 0, uvs, wraps[0], wraps[1], nearest)
        assert np.abs(found[finite] - slow_lookup(1, 0.5, 0.5, (0, 0), nearest)).max() < 1e-9, "there is one pixel to read"
