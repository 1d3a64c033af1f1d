"""If this fails, images differ between machines, or rays carry wrong or biased directions, colours and densities."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest

from unit.render import probe_kernels as probe

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


def unit_vectors(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Random ones, the axes, and ones near the folds of the octahedron."""
    vectors = RANDOM.normal(size=(count, 3))
    vectors[:100, 2] *= 1e-9
    vectors[100:200, 0] *= 1e-9
    vectors = np.concatenate([vectors, np.eye(3), -np.eye(3)])
    units: np.ndarray[tuple[int, int], np.dtype[np.float64]] = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return units


def test_direction_codes_are_fine_and_their_directions_unit() -> None:
    vectors = unit_vectors(50_000)
    decoded = probe.directions(probe.direction_codes(vectors))
    assert np.abs(decoded - vectors).max() < 1e-9
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1).max() < 4e-16
    assert np.array_equal(probe.direction_codes(vectors[:1000] * 0.25), probe.direction_codes(vectors[:1000])), "any length will do"


def test_every_code_has_a_direction() -> None:
    codes = RANDOM.integers(0, 2**32, (50_000, 2), np.uint32)
    codes[:9] = [(a, b) for a in (0, 2**31, 2**32 - 1) for b in (0, 2**31, 2**32 - 1)]
    decoded = probe.directions(codes)
    assert np.isfinite(decoded).all()
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1).max() < 1e-15


@pytest.mark.parametrize("color", [(1.0, 1.0, 1.0), (0.5, 0.1, 1e-3), (1e-5, 3e-9, 7.0), (123.4, 0.0, 1e4), (1e-30, 2e-31, 0.0)])
def test_colors_are_rounded_without_bias(color: tuple[float, float, float]) -> None:
    keys = RANDOM.integers(0, 2**64, 200_000, np.uint64)
    decoded = probe.colors(probe.color_codes(np.tile(color, (len(keys), 1)), keys))
    step = 2.0 ** (math.frexp(max(color))[1] - 13)
    assert np.abs(decoded - color).max() <= 2 * step, "one step, or two where rounding carried"
    # The mean of n roundings, each at most a step off, strays by a step / sqrt(n) or so.
    assert np.abs(decoded.mean(axis=0) - color).max() < 4 * step / math.sqrt(len(keys))


def test_the_largest_channel_keeps_twelve_bits() -> None:
    colors = 2.0 ** RANDOM.uniform(-40, 40, (50_000, 3))
    decoded = probe.colors(probe.color_codes(colors, RANDOM.integers(0, 2**64, len(colors), np.uint64)))
    largest = colors.argmax(axis=1)
    rows = np.arange(len(colors))
    assert np.abs(decoded[rows, largest] / colors[rows, largest] - 1).max() <= 2.0**-12


def test_black_stays_black_and_zero_channels_zero() -> None:
    keys = RANDOM.integers(0, 2**64, 1000, np.uint64)
    assert not probe.color_codes(np.zeros((1000, 3)), keys).any()
    assert not probe.color_codes(np.full((1000, 3), 1e-71), keys).any()
    decoded = probe.colors(probe.color_codes(np.tile([0.0, 0.3, 0.0], (1000, 1)), keys))
    assert not decoded[:, [0, 2]].any()


@pytest.mark.parametrize("value", [2.0**254, 2.0**255, 1e80, 1e200, 1e308])
def test_colors_too_large_become_the_largest(value: float) -> None:
    keys = RANDOM.integers(0, 2**64, 1000, np.uint64)
    codes = probe.color_codes(np.tile([value, 0.0, value], (1000, 1)), keys)
    decoded = probe.colors(codes)
    assert (codes < 2**48).all()
    assert (decoded[:, 0] >= min(value, 2.0**255) * (1 - 2.0**-12)).all()
    assert (decoded[:, 0] <= 2.0**255).all()
    assert not decoded[:, 1].any()


def test_codes_fit_48_bits() -> None:
    colors = 2.0 ** RANDOM.uniform(-230, 255, (20_000, 3))
    assert int(probe.color_codes(colors, RANDOM.integers(0, 2**64, len(colors), np.uint64)).max()) < 2**48


def test_density_codes_rise_and_are_close() -> None:
    densities = np.sort(2.0 ** RANDOM.uniform(-24, 39.9, 50_000))
    codes = probe.pdf_codes(densities)
    assert (np.diff(codes) >= 0).all()
    assert np.abs(np.log2(probe.pdfs(codes)) - np.log2(densities)).max() <= 1 / 2048 + 1e-12


def test_density_codes_saturate_below_the_one_that_means_none() -> None:
    assert probe.pdf_codes(np.array([0.0, 1e-300, 2.0**-25, -1.0, np.nan])).tolist() == [0] * 5
    assert probe.pdf_codes(np.array([2.0**40, 1e30, 1e300])).tolist() == [65_534] * 3


def test_a_density_code_stands_for_itself() -> None:
    codes = np.arange(65_535)
    assert np.array_equal(probe.pdf_codes(probe.pdfs(codes)), codes)


def chi_square(counts: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> float:
    """In standard deviations from what even counts would give."""
    expected = counts.sum() / counts.size
    freedom = counts.size - 1
    return float((((counts - expected) ** 2 / expected).sum() - freedom) / math.sqrt(2 * freedom))


def test_random_numbers_are_even_in_every_dimension_used() -> None:
    keys = probe.path_keys(1, 0, np.arange(100_000), np.zeros(100_000, np.int64))
    assert len(np.unique(keys)) == len(keys)
    for bounce in (0, 1, 31):
        for dimension in range(18):
            numbers = probe.uniforms(keys, bounce, dimension)
            assert 0.0 <= numbers.min() and numbers.max() < 1.0
            assert abs(chi_square(np.histogram(numbers, 256, (0, 1))[0])) < 5


@pytest.mark.parametrize("pair", [((0, 0), (0, 1)), ((0, 1), (1, 1)), ((0, 63), (1, 0)), ((2, 4), (2, 5)), ((0, 16), (0, 17))])
def test_random_numbers_of_two_dimensions_are_independent(pair: tuple[tuple[int, int], tuple[int, int]]) -> None:
    keys = probe.path_keys(1, 0, np.arange(200_000) % 640, np.arange(200_000) // 640)
    first, second = (probe.uniforms(keys, bounce, dimension) for bounce, dimension in pair)
    counts = np.histogram2d(first, second, 32, ((0, 1), (0, 1)))[0].astype(np.int64)
    assert abs(chi_square(counts)) < 5
    assert not np.array_equal(first, second)


def test_keys_tell_seed_frame_pixel_and_sample_apart() -> None:
    pixels, samples = (axis.ravel() for axis in np.meshgrid(np.arange(64), np.arange(64)))
    keys = np.concatenate([probe.path_keys(seed, frame, pixels, samples) for seed in (0, 1, 2**62) for frame in (0, 1, 2)])
    assert len(np.unique(keys)) == len(keys)
    # Neighbours must not walk in step, either: consecutive samples of one pixel, and consecutive pixels.
    for shift in (1, 64):
        pairs = probe.uniforms(keys[:4096], 0, 0), np.roll(probe.uniforms(keys[:4096], 0, 0), shift)
        assert abs(chi_square(np.histogram2d(*pairs, 8, ((0, 1), (0, 1)))[0].astype(np.int64))) < 5
