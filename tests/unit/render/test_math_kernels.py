"""If this fails, images differ between machines, or rays carry wrong or biased directions, colours and densities."""

from __future__ import annotations

import hashlib
import itertools
import math

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.arrays import JobNumbers
from scenefold.render.dice_kernels import NOISE_THROUGHPUT, SAMPLER_INDEPENDENT, SAMPLER_SOBOL
from scenefold.render.numbers import dice_seed
from unit.render import lanes_probe_kernels as lanes
from unit.render import probe_kernels as probe
from unit.render.test_light_kernels import job

Floats = npt.NDArray[np.float64]
RANDOM = np.random.default_rng(7)
TURNS = np.concatenate([RANDOM.random(20_000), np.linspace(0, 1, 4097), np.nextafter([0.125, 0.25, 0.375, 0.5, 0.75, 1.0], 0)])
POSITIVE = np.concatenate(
    [2.0 ** RANDOM.uniform(-300, 300, len(TURNS) - 6), [1.0, math.sqrt(2), np.nextafter(math.sqrt(2), 2), 2.0, 0.5, np.nextafter(1.0, 0)]]
)


def test_elementary_functions_are_those_of_mathematics() -> None:
    sine, cosine, log2, exp2 = probe.elementary(POSITIVE, TURNS).T
    # libm takes radians, whose rounding alone costs up to 4e-16.
    assert np.abs(sine - np.sin(2 * np.pi * TURNS)).max() < 1e-15
    assert np.abs(cosine - np.cos(2 * np.pi * TURNS)).max() < 1e-15
    expected = np.log2(POSITIVE)
    assert (np.abs(log2 - expected) <= 1e-15 * np.maximum(np.abs(expected), 1.0)).all()
    powers = np.exp2(TURNS * 2000 - 1000)
    assert (np.abs(exp2 - powers) <= 1e-15 * powers).all()


def test_turns_that_are_exact_have_exact_sines() -> None:
    exact = probe.elementary(np.ones(5), np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert exact[:, :2].tolist() == [[0, 1], [1, 0], [0, -1], [-1, 0], [0, 1]]


def test_powers() -> None:
    base, exponent = RANDOM.random(10_000) * 4, RANDOM.uniform(-3, 3, 10_000)
    expected = base**exponent
    assert (np.abs(probe.powers(base, exponent) - expected) <= 4e-15 * expected).all()
    assert probe.powers(np.array([0.0]), np.array([2.4])).tolist() == [0.0]


def test_elementary_functions_have_these_bits() -> None:
    """They are + - * / alone; a compiler that fused or reordered them would change the hash, and every image."""
    values = probe.elementary(np.arange(1, 1001) / 7, np.arange(1000) / 1000)
    assert hashlib.sha256(values.astype("<f8").tobytes()).hexdigest()[:16] == "1f19cf7cdc4669d7"


def test_elementary_functions_in_lanes_are_as_fine_as_single_precision() -> None:
    turns, x = RANDOM.random(20_000).astype(np.float32), (2.0 ** RANDOM.uniform(-100, 100, 20_000)).astype(np.float32)
    exponents = RANDOM.uniform(-126, 127, 20_000).astype(np.float32)
    sine, cosine, log2, exp2 = lanes.reals_of(lanes.probed("elementary", turns, x, exponents)[:4])
    radians = 2 * np.pi * turns.astype(np.float64)
    assert np.abs(sine - np.sin(radians)).max() < 2e-7
    assert np.abs(cosine - np.cos(radians)).max() < 2e-7
    assert np.abs(log2 - np.log2(x.astype(np.float64))).max() < 1e-5
    assert np.abs(exp2 / np.exp2(exponents.astype(np.float64)) - 1).max() < 4e-7


def test_elementary_functions_in_lanes_have_these_bits() -> None:
    steps = np.arange(1000, dtype=np.float32)
    bits = lanes.probed("elementary", steps / 1000, (steps + 1) / 7, steps / 4 - 120)[:4]
    assert hashlib.sha256(bits.astype("<u4").tobytes()).hexdigest()[:16] == "177b4ae2d9aedc60"


def unit_vectors(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Random ones, the axes, and ones near the folds of the octahedron."""
    vectors = RANDOM.normal(size=(count, 3))
    vectors[:100, 2] *= 1e-9
    vectors[100:200, 0] *= 1e-9
    vectors = np.concatenate([vectors, np.eye(3), -np.eye(3)])
    units: np.ndarray[tuple[int, int], np.dtype[np.float64]] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return units


def direction_codes(vectors: Floats) -> lanes.U32:
    """uint32[2, n]"""
    return lanes.probed("to_direction_code", *vectors.T)[:2]


def directions(codes: lanes.U32) -> Floats:
    """f64[n, 3] of uint32[2, n]"""
    return lanes.reals_of(lanes.probed("from_direction_code", word_columns=tuple(codes))[:3]).T


def test_direction_codes_are_fine_and_their_directions_unit() -> None:
    vectors = unit_vectors(50_000)
    decoded = directions(direction_codes(vectors))
    assert np.abs(decoded - vectors).max() < 3e-7
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1).max() < 2e-7
    assert np.array_equal(direction_codes(vectors[:1000] * 0.25), direction_codes(vectors[:1000])), "any length will do"


def test_every_code_has_a_direction() -> None:
    codes = RANDOM.integers(0, 2**32, (2, 50_000), np.uint32)
    codes[:, :16] = np.array([(a, b) for a in (0, 2**31, 2**31 - 1, 2**32 - 1) for b in (0, 2**31, 2**31 - 1, 2**32 - 1)]).T
    decoded = directions(codes)
    assert np.isfinite(decoded).all()
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1).max() < 2e-7


def color_codes(colors: Floats, dice: np.ndarray) -> lanes.U32:  # type: ignore[type-arg]
    """uint32[2, n] of f64[n, 3], rounded by these words."""
    return lanes.probed("to_color_code", *colors.T, word_columns=(dice,))[:2]


def colors_of(codes: lanes.U32) -> Floats:
    """f64[n, 3]"""
    return lanes.reals_of(lanes.probed("from_color_code", word_columns=tuple(codes))[:3]).T


def dice(count: int) -> np.ndarray:  # type: ignore[type-arg]
    return RANDOM.integers(0, 2**32, count, np.uint32)


@pytest.mark.parametrize("color", [(1.0, 1.0, 1.0), (0.5, 0.1, 1e-3), (1e-5, 3e-9, 7.0), (123.4, 0.0, 1e4), (1e-25, 2e-26, 0.0)])
def test_colors_are_rounded_without_bias(color: tuple[float, float, float]) -> None:
    count = 200_000
    exact = np.float32(color).astype(np.float64)
    decoded = colors_of(color_codes(np.tile(color, (count, 1)), dice(count)))
    step = 2.0 ** (math.frexp(max(color))[1] - 13)
    assert np.abs(decoded - exact).max() <= 2 * step, "one step, or two where rounding carried"
    # The mean of n roundings, each at most a step off, strays by a step / sqrt(n) or so; ten bits of noise leave 2^-11 of a step.
    assert np.abs(decoded.mean(axis=0) - exact).max() < step * (4 / math.sqrt(count) + 2.0**-10)


def test_the_largest_channel_keeps_twelve_bits() -> None:
    colors = 2.0 ** RANDOM.uniform(-40, 40, (50_000, 3))
    decoded = colors_of(color_codes(colors, dice(len(colors))))
    largest = colors.argmax(axis=1)
    rows = np.arange(len(colors))
    assert np.abs(decoded[rows, largest] / colors[rows, largest] - 1).max() <= 2.0**-12 + 1e-7


def test_black_stays_black_and_zero_channels_zero() -> None:
    assert not color_codes(np.zeros((1000, 3)), dice(1000)).any()
    assert not color_codes(np.full((1000, 3), 2.0**-101), dice(1000)).any()
    assert not color_codes(np.full((1000, 3), 1e-40), dice(1000)).any(), "not even what has no whole mantissa"
    decoded = colors_of(color_codes(np.tile([0.0, 0.3, 0.0], (1000, 1)), dice(1000)))
    assert not decoded[:, [0, 2]].any()


@pytest.mark.parametrize("value", [2.0**126, 1e38, np.inf])
def test_colors_too_large_become_the_largest(value: float) -> None:
    codes = color_codes(np.tile([value, 0.0, value], (1000, 1)), dice(1000))
    decoded = colors_of(codes)
    assert (codes[1] < 2**16).all()
    assert (decoded[:, 0] >= 2.0**126 * (1 - 2.0**-12)).all()
    assert np.isfinite(decoded).all()
    assert not decoded[:, 1].any()


def test_codes_fit_48_bits() -> None:
    colors = 2.0 ** RANDOM.uniform(-126, 127, (20_000, 3))
    assert int(color_codes(colors, dice(len(colors)))[1].max()) < 2**16


def test_codes_that_nobody_makes_are_colours_all_the_same() -> None:
    decoded = colors_of(np.stack([dice(50_000), RANDOM.integers(0, 2**16, 50_000, np.uint32)]))
    assert np.isfinite(decoded).all()
    assert (decoded >= 0).all()


def pdf_codes(densities: Floats) -> Floats:
    return lanes.probed("to_pdf_code", densities)[0].astype(np.float64)


def pdfs(codes: Floats) -> Floats:
    return lanes.reals_of(lanes.probed("from_pdf_code", word_columns=(codes.astype(np.uint32),))[0])


def test_density_codes_rise_and_are_close() -> None:
    densities = np.sort(2.0 ** RANDOM.uniform(-24, 39.9, 50_000)).astype(np.float32)
    codes = pdf_codes(densities)
    assert (np.diff(codes) >= 0).all()
    assert np.abs(np.log2(pdfs(codes)) - np.log2(densities.astype(np.float64))).max() <= 1 / 2048 + 1e-5


def test_density_codes_saturate_below_the_one_that_means_none() -> None:
    assert pdf_codes(np.array([0.0, 1e-30, 2.0**-25, -1.0])).tolist() == [0] * 4
    assert pdf_codes(np.array([2.0**40, 1e30, np.inf])).tolist() == [65_534] * 3
    assert 0 <= pdf_codes(np.array([np.nan]))[0] <= 65_534


def test_a_density_code_stands_for_itself() -> None:
    codes = np.arange(65_535)
    assert np.array_equal(pdf_codes(pdfs(codes)), codes)


def chi_square(counts: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> float:
    """In standard deviations from what even counts would give."""
    expected = counts.sum() / counts.size
    freedom = counts.size - 1
    return float((((counts - expected) ** 2 / expected).sum() - freedom) / math.sqrt(2 * freedom))


SAMPLERS = (SAMPLER_SOBOL, SAMPLER_INDEPENDENT)


def thrown(sampler: int, seed: int = 1, frame: int = 0) -> JobNumbers:
    whole = dice_seed(seed, frame)
    return job(1.0, 0.0, 0.0)._replace(sampler=sampler, dice_low=whole & 0xFFFFFFFF, dice_high=whole >> 32)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_random_numbers_are_even_in_every_dimension_used(sampler: int) -> None:
    pixels = np.arange(100_000)
    for bounce in (0, 1, 31):
        for number in range(NOISE_THROUGHPUT):
            for column in lanes.rolled(thrown(sampler), pixels, 0, bounce, number).T:
                assert 0.0 <= column.min() and column.max() < 1.0
                assert abs(chi_square(np.histogram(column, 256, (0, 1))[0])) < 5


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("dimensions", [((0, 0, 0), (0, 0, 1)), ((0, 0, 0), (1, 0, 0)), ((2, 1, 0), (2, 2, 1)), ((0, 4, 0), (0, 5, 1))])
def test_random_numbers_of_two_dimensions_are_independent(sampler: int, dimensions: tuple[tuple[int, int, int], ...]) -> None:
    numbers = thrown(sampler)
    pixels, samples = np.arange(204_800) % 640, np.arange(204_800) // 640
    first, second = (lanes.rolled(numbers, pixels, samples, bounce, number)[:, at] for bounce, number, at in dimensions)
    counts = np.histogram2d(first, second, 32, ((0, 1), (0, 1)))[0].astype(np.int64)
    # Sobol's points are more even than chance would have them, never less.
    assert chi_square(counts) < 5
    assert sampler == SAMPLER_SOBOL or chi_square(counts) > -5
    assert np.abs(np.corrcoef(first, second)[0, 1]) < 0.01


@pytest.mark.parametrize("count", [16, 64, 256])
def test_samples_of_a_pixel_are_spread_evenly_over_each_pair(count: int) -> None:
    """Of 2^m points every elementary interval of volume 2^-m holds exactly one: a (0, m, 2)-net, however it was scrambled."""
    bits = count.bit_length() - 1
    for pixel, bounce, number in itertools.product((0, 5, 123_456), (0, 3), (0, 3)):
        points = lanes.rolled(thrown(SAMPLER_SOBOL), pixel, np.arange(count), bounce, number)
        for first in range(bits + 1):
            boxes = np.floor(points[:, 0] * 2**first) * 2 ** (bits - first) + np.floor(points[:, 1] * 2 ** (bits - first))
            assert len(np.unique(boxes)) == count


def test_noise_is_even_and_never_at_an_end() -> None:
    noises = lanes.noises(dice(65_536), dice(65_536))
    assert 0.0 < noises.min() and noises.max() < 1.0
    for column in noises.T:
        assert abs(chi_square(np.histogram(column, 128, (0, 1))[0])) < 5
    assert np.abs(np.corrcoef(noises.T) - np.eye(3)).max() < 0.02


def test_random_numbers_tell_seed_frame_pixel_and_sample_apart() -> None:
    pixels, samples = (axis.ravel() for axis in np.meshgrid(np.arange(64), np.arange(64)))
    throws = [
        lanes.rolled(thrown(SAMPLER_INDEPENDENT, seed, frame), pixels, samples, 0, 0) for seed in (0, 1, 2**62) for frame in (0, 1, 2)
    ]
    pairs = np.concatenate(throws)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    # Neighbours must not walk in step, either: consecutive samples of one pixel, and consecutive pixels.
    for shift in (1, 64):
        both = throws[0][:, 0], np.roll(throws[0][:, 0], shift)
        assert abs(chi_square(np.histogram2d(*both, 8, ((0, 1), (0, 1)))[0].astype(np.int64))) < 5


def test_keys_of_paths_differ() -> None:
    pixels, samples = (axis.ravel() for axis in np.meshgrid(np.arange(64), np.arange(64)))
    keys = np.concatenate([probe.path_keys(seed, frame, pixels, samples) for seed in (0, 1, 2**62) for frame in (0, 1, 2)])
    assert len(np.unique(keys)) == len(keys)
