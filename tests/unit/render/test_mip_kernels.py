"""If this fails, far textures differ between nodes, or are darker, shifted, or framed in colours of what nobody sees."""

from __future__ import annotations

import hashlib
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.mip_kernels import fill_level, level_sizes, level_tables
from scenefold.render.setup_kernels import linear_of_srgb
from scenefold.scene.payloads.texture_uses import Minify
from unit.render.mip_probe_kernels import level_samples

Image = npt.NDArray[np.uint8]
LINEAR = linear_of_srgb()
RANDOM = np.random.default_rng(31)
GOLDEN = ["5d4bde710d491999", "157de4bd2ce12b82", "d3254c3fa2207d0b", "36e5b980d4327d97"]
"""Plain, coded, by alpha, both: of all levels of a made-up image of 52 x 45."""


def levels_of(image: Image, *, coded: bool = False, by_alpha: bool = False) -> list[Image]:
    values, codes = level_tables(LINEAR, coded)
    levels = [np.zeros((height, width, 4), np.uint8) for width, height in level_sizes(image.shape[1], image.shape[0])]
    levels[0][:] = image
    for finer, coarser in pairwise(levels):
        fill_level(finer, coarser, values, codes, by_alpha)
    return levels


def even(red: int, green: int, blue: int, alpha: int, height: int, width: int) -> Image:
    return np.tile(np.array([red, green, blue, alpha], np.uint8), (height, width, 1))


def test_sizes_are_halved_down_to_one_texel() -> None:
    assert level_sizes(1, 1) == [(1, 1)]
    assert level_sizes(5, 2) == [(5, 2), (2, 1), (1, 1)]
    assert level_sizes(1, 7) == [(1, 7), (1, 3), (1, 1)]
    assert len(level_sizes(16384, 3)) == 15


@pytest.mark.parametrize("coded", [False, True])
def test_codes_are_those_of_the_nearest_values(coded: bool) -> None:
    values, codes = level_tables(LINEAR, coded)
    assert (codes[values] == np.arange(256)).all()
    apart = np.abs(values[codes.astype(np.int64)] - np.arange(65536))
    assert apart.max() <= (np.diff(values).max() + 1) // 2


@pytest.mark.parametrize("coded", [False, True])
@pytest.mark.parametrize("by_alpha", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (1, 9), (7, 1), (5, 3), (13, 8), (16, 16)])
def test_what_is_even_stays_as_it_is(size: tuple[int, int], coded: bool, by_alpha: bool) -> None:
    for level in levels_of(even(3, 128, 255, 77, *size), coded=coded, by_alpha=by_alpha):
        assert (level == (3, 128, 255, 77)).all()


@pytest.mark.parametrize("size", [(8, 8), (7, 5), (1, 9), (6, 11)])
def test_each_texel_is_the_mean_of_its_area(size: tuple[int, int]) -> None:
    image = RANDOM.integers(0, 256, (*size, 4), np.uint8)
    height, width = (max(side // 2, 1) for side in size)
    # By the definition: each texel repeated so often that areas are whole numbers of copies.
    fine = np.repeat(np.repeat(image.astype(float), height, axis=0), width, axis=1)
    means = fine.reshape(height, size[0], width, size[1], 4).mean(axis=(1, 3))
    assert np.abs(levels_of(image)[1] - means).max() <= 0.5 + 1e-9


def test_light_is_averaged_and_not_its_codes() -> None:
    board = np.zeros((2, 2, 4), np.uint8)
    board[0, 0] = board[1, 1] = 255
    assert levels_of(board)[1].ravel().tolist() == [128, 128, 128, 128]
    assert levels_of(board, coded=True)[1].ravel().tolist() == [188, 188, 188, 128]


def test_what_is_hidden_does_not_bleed() -> None:
    leaf = even(255, 0, 255, 0, 4, 4)
    leaf[1, 1] = (10, 200, 30, 255)
    for level in levels_of(leaf, coded=True, by_alpha=True)[1:]:
        assert level[0, 0, :3].tolist() == [10, 200, 30]
    assert levels_of(leaf, by_alpha=True)[2][0, 0, 3] == 16
    assert levels_of(leaf)[1][0, 0, :3].tolist() != [10, 200, 30]


def test_little_that_is_seen_keeps_its_colour() -> None:
    leaf = even(255, 0, 255, 0, 64, 64)
    leaf[5, 9] = (10, 200, 30, 255)
    assert levels_of(leaf, by_alpha=True)[-1].ravel().tolist() == [10, 200, 30, 1]


def test_bumps_that_face_each_other_are_flat_from_afar() -> None:
    bumps = np.array([[(192, 128, 238, 255), (64, 128, 238, 255)]], np.uint8)
    assert levels_of(bumps)[1].ravel().tolist() == [128, 128, 238, 255]


def test_levels_have_these_bytes() -> None:
    image = (np.arange(45 * 52 * 4, dtype=np.int64) * 2654435761 >> 7).astype(np.uint8).reshape(45, 52, 4)
    told = [
        hashlib.sha256(b"".join(level.tobytes() for level in levels_of(image, coded=coded, by_alpha=by_alpha))).hexdigest()[:16]
        for coded, by_alpha in ((False, False), (True, False), (False, True), (True, True))
    ]
    assert told == GOLDEN


STEPS = [255, 200, 150, 100]
"""Levels of 8 x 5, 4 x 2, 2 x 1 and 1 x 1, each of one grey."""
SIZES = level_sizes(8, 5)
TEXELS = np.concatenate([even(grey, grey, grey, 255, h, w).ravel() for grey, (w, h) in zip(STEPS, SIZES, strict=True)])
ROW = np.array([[0, 8, 5, 0, len(SIZES)]], np.int64)
WIDTHS = np.array([1.0001, 1.4, 1.45, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 9.0, 1e30, np.inf])


@pytest.mark.parametrize("minify", list(Minify)[1:])
def test_the_level_follows_the_width_of_the_footprint(minify: Minify) -> None:
    places = RANDOM.random((len(WIDTHS), 2))
    got = level_samples(ROW, TEXELS, LINEAR, places, WIDTHS * WIDTHS, int(minify))[:, 0] * 255
    level = np.minimum(np.log2(np.minimum(WIDTHS, 1e9)), 3.0)
    whole = np.minimum(np.floor(level), 2).astype(int)
    if minify in (Minify.NEAREST_OF_NEAREST, Minify.LINEAR_OF_NEAREST):
        wanted = np.array(STEPS)[np.round(level).astype(int)]
    else:
        part = np.minimum(WIDTHS, 8.0) / 2.0**whole - 1.0
        wanted = np.array(STEPS)[whole] * (1 - part) + np.array(STEPS)[whole + 1] * part
    assert np.abs(got - wanted).max() < 1e-9


def test_a_level_is_read_between_its_texels_or_at_the_nearest() -> None:
    image = RANDOM.integers(0, 256, (2, 2, 4), np.uint8)
    texels = np.concatenate([even(0, 0, 0, 0, 4, 4).ravel(), image.ravel(), np.zeros(4, np.uint8)])
    row = np.array([[0, 4, 4, 0, 3]], np.int64)
    places = np.array([[0.3, 0.3], [0.5, 0.25]])
    two = np.array([4.0, 4.0])
    nearest = level_samples(row, texels, LINEAR, places, two, int(Minify.NEAREST_OF_NEAREST)) * 255
    between = level_samples(row, texels, LINEAR, places, two, int(Minify.LINEAR_OF_NEAREST)) * 255
    assert np.abs(nearest - [image[0, 0], image[0, 1]]).max() < 1e-9
    assert np.abs(between[1] - (image[0, 0].astype(float) + image[0, 1]) / 2).max() < 1e-9
