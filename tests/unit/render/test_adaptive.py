"""If this fails, samples go to pixels that need none, or where they go depends on the order in which passes were closed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from scenefold.base.errors import UsageFault
from scenefold.render.adaptive import going_on
from scenefold.render.film import Film
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.levels import Adaptive
from scenefold.render.pass_sums import PassSums
from scenefold.render.sum_columns import FULL, PLAIN, SumColumns

WIDTH, HEIGHT, SAMPLES = 12, 9, 16
PIXELS = WIDTH * HEIGHT
STRIDE = scattering_stride(PIXELS)


def passes(noise: np.ndarray, light: float = 1.0, columns: SumColumns = PLAIN) -> list[PassSums]:
    """A pass for each sample: each pixel is `light` bright, and as noisy as `noise` [H, W] says, relative to that."""
    order = np.arange(PIXELS) * STRIDE % PIXELS
    made = []
    for sample in range(SAMPLES):
        sums = PassSums.zeros(PIXELS, columns)
        values = light * (1.0 + noise.ravel() * (1.0 if sample % 2 else -1.0))
        sums.radiance[:, -3:] = np.round(values[order] * 2**32)[:, None]
        made.append(sums)
    return made


def film_of(some_passes: list[PassSums], order: list[int] | None = None) -> Film:
    film = Film(WIDTH, HEIGHT, some_passes[0].columns)
    for number in order or range(len(some_passes)):
        film.add(some_passes[number], number * PIXELS, STRIDE)
    return film


def unsettled(film: Film, target: float) -> np.ndarray:
    """Pixels of the image."""
    return np.flatnonzero(film.in_order(going_on(film, target)))


def test_levels_double_and_end_where_they_should() -> None:
    levels = Adaptive(0.1).levels
    assert levels(64) == (16, 32, 64)
    assert levels(100) == (16, 32, 64, 100)
    assert (levels(16), levels(5), levels(17)) == ((16,), (5,), (16, 17))
    assert Adaptive(0.1, 24).levels(60) == (24, 48, 60)


@pytest.mark.parametrize("adaptive", [Adaptive(0.0), Adaptive(1.5), Adaptive(float("nan")), Adaptive(0.1, 1), Adaptive(0.1, 2**40)])
def test_what_is_out_of_range_is_one_clear_error(adaptive: Adaptive) -> None:
    with pytest.raises(UsageFault, match=r"adaptive is|min_samples is"):
        adaptive.check()
    with pytest.raises((UsageFault, ValueError)):
        Adaptive.of_row(adaptive.row())
    assert Adaptive.of_row(Adaptive(0.25, 8).row()) == Adaptive(0.25, 8)


def test_a_pixel_that_ended_stays_ended() -> None:
    film = film_of(passes(np.full((HEIGHT, WIDTH), 0.9)))
    before = np.zeros(PIXELS, np.uint8)
    before[5:9] = 1
    assert going_on(film, 0.01, before).tolist() == before.tolist()


@pytest.mark.parametrize("columns", [PLAIN, FULL])
@pytest.mark.parametrize("light", [1e-4, 1.0, 4000.0])
def test_noisy_pixels_go_on_with_their_neighbours_whatever_the_unit_of_light(columns: SumColumns, light: float) -> None:
    noise = np.zeros((HEIGHT, WIDTH))
    noise[4, 6] = noise[0, 0] = 0.9
    found = unsettled(film_of(passes(noise, light, columns)), 0.05)
    expected = {(y, x) for y in (3, 4, 5) for x in (5, 6, 7)} | {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert {divmod(int(pixel), WIDTH) for pixel in found} == expected
    assert found.tolist() == sorted(found.tolist())


def test_enough_is_enough() -> None:
    noise = np.full((HEIGHT, WIDTH), 0.2)
    film = film_of(passes(noise))
    # Values of 1 ± 0.2: the error of a mean of sixteen is 0.2 / sqrt(15).
    assert len(unsettled(film, 0.2 / np.sqrt(15) * 1.01)) == 0
    assert len(unsettled(film, 0.2 / np.sqrt(15) * 0.99)) == PIXELS
    assert len(unsettled(film_of(passes(noise * 0.0)), 1e-3)) == 0
    assert len(unsettled(film_of(passes(noise, light=0.0)), 1e-3)) == 0, "there is nothing to find in the dark"


@settings(max_examples=20, deadline=None)
@given(some.permutations(range(SAMPLES)), some.integers(0, SAMPLES))
def test_the_order_of_passes_and_films_is_no_matter(order: list[int], cut: int) -> None:
    noise = np.random.default_rng(2).random((HEIGHT, WIDTH)) ** 2
    made = passes(noise)
    film, other = Film(WIDTH, HEIGHT), Film(WIDTH, HEIGHT)
    for place, number in enumerate(order):
        (film if place < cut else other).add(made[number], number * PIXELS, STRIDE)
    for index, part in enumerate(other.parts()):
        film.merge_part(index, part)
    expected = unsettled(film_of(made), 0.08)
    assert 0 < len(expected) < PIXELS
    assert unsettled(film, 0.08).tolist() == expected.tolist()
