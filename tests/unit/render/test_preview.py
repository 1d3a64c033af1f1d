"""If this fails, a preview shows other light than its film has, or is of another size than whoever fetches it expects."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.render import preview
from scenefold.render.developing import develop
from scenefold.render.film import Film
from scenefold.render.layers import BEAUTY
from scenefold.render.preview import Sums, add_rows, block_of, nothing_of, picture_of, preview_bytes, preview_shape, unpack_preview
from scenefold.render.sum_columns import RADIANCE_UNIT

sides = st.integers(1, 70)
BOX = (np.zeros(3), np.ones(3))


def painted(width: int, height: int, seed: int = 1) -> Film:
    """A film whose pixels have different radiances and numbers of samples, some of them none."""
    film, dice = Film(width, height), np.random.default_rng(seed)
    samples = dice.integers(0, 3, width * height)
    film.rows.samples[:] = samples
    film.rows.low[:] = (dice.integers(0, 1000, (width * height, 3)) * samples[:, None] * RADIANCE_UNIT / 256).astype(np.uint64)
    return film


def preview_of(film: Film, at_a_time: int = 1000) -> Sums:
    """Of all of its rows."""
    sums = nothing_of(film.width, film.height)
    for first in range(0, film.width * film.height, at_a_time):
        add_rows(sums, film, first, first + at_a_time)
    return sums


@given(sides, sides, st.integers(1, 200))
def test_a_block_is_the_smallest_that_fits(width: int, height: int, most: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preview, "PREVIEW_PIXELS_MAX", most)
        block = block_of(width, height)

        def pixels(block: int) -> int:
            return -(-width // block) * -(-height // block)

        assert pixels(block) <= most and (block == 1 or pixels(block - 1) > most)
        assert preview_bytes(width, height) == 16 * pixels(block)


def test_a_full_hd_image_is_shown_by_a_quarter_of_its_pixels() -> None:
    assert preview_shape(1920, 1080) == (540, 960) and preview_shape(800, 600) == (600, 800)


@given(sides, sides, st.integers(1, 4))
def test_where_a_pixel_is_one_of_the_image_the_picture_is_the_image(width: int, height: int, seed: int) -> None:
    film = painted(width, height, seed)
    sums = unpack_preview(preview_of(film, 64 * seed).tobytes(), width, height)
    known = sums[:, :, 3] > 0
    assert np.array_equal(sums[:, :, 3], film.in_order(film.rows.samples.astype(np.float32)))
    with np.errstate(invalid="ignore", divide="ignore"):
        beauty = develop(film, (), BOX)[BEAUTY]
    np.testing.assert_allclose(picture_of(sums)[known], beauty[known], rtol=1e-6)


@given(sides, sides, st.integers(1, 60))
def test_no_light_is_lost_in_blocks(width: int, height: int, most: int) -> None:
    film = painted(width, height)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preview, "PREVIEW_PIXELS_MAX", most)
        sums = preview_of(film)
    assert sums[:, :, 3].sum() == film.rows.samples.sum()
    np.testing.assert_allclose(sums[:, :, :3].sum(axis=(0, 1)), film.rows.low.sum(axis=0) / RADIANCE_UNIT, rtol=1e-4)


def test_blocks_lie_where_their_pixels_do(monkeypatch: pytest.MonkeyPatch) -> None:
    film = Film(6, 5)
    image = np.arange(30.0).reshape(5, 6)
    film.rows.samples[:] = 1
    film.rows.low[:] = (film.in_rows(image)[:, None] * RADIANCE_UNIT).astype(np.uint64)
    monkeypatch.setattr(preview, "PREVIEW_PIXELS_MAX", 6)
    sums = preview_of(film)
    assert sums.shape == (2, 2, 4) and block_of(6, 5) == 3
    assert sums[0, 0, 0] == image[:3, :3].sum() and sums[1, 1, 0] == image[3:, 3:].sum() and sums[1, 0, 3] == 6


@given(sides, sides)
def test_nothing_becomes_a_black_picture(width: int, height: int) -> None:
    picture = picture_of(nothing_of(width, height))
    assert picture.shape == (height, width, 3) and picture.dtype == np.float32 and not picture.any()


def test_an_unknown_pixel_shows_what_lies_around() -> None:
    sums = nothing_of(8, 8)
    sums[:, :4] = (2.0, 4.0, 6.0, 2.0)
    sums[:, 4:] = (9.0, 9.0, 9.0, 1.0)
    sums[2, 1] = sums[5, 5] = 0.0
    picture = picture_of(sums)
    assert tuple(picture[2, 1]) == (1.0, 2.0, 3.0) and tuple(picture[5, 5]) == (9.0, 9.0, 9.0)
    sums[0:2, 0:2] = 0.0
    np.testing.assert_allclose(picture_of(sums)[0, 0], (1.0, 2.0, 3.0))


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e38])
def test_what_cannot_be_is_no_preview(value: float) -> None:
    sums = nothing_of(4, 3)
    sums[1, 2, 3] = value
    with pytest.raises(PeerFault, match="cannot be"):
        unpack_preview(sums.tobytes(), 4, 3)
    with pytest.raises(PeerFault, match="another size"):
        unpack_preview(bytes(16 * 11), 4, 3)
