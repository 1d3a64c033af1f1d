"""If this fails, a hit is shaded otherwise in company than alone: then the image depends on which rays came together."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from scenefold.render.lanes_kernels import LANES
from unit.render import lanes_probe_kernels as probe

COUNT = 4096


def inputs() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(11)
    reals = random.random((4, COUNT)).astype(np.float32)
    # What functions choose by: ends, halves, the very small, two that are equal.
    reals[:, :64] = random.choice(np.float32([0.0, 0.5, 1.0, 1e-30, 1.0 - 2.0**-24]), (4, 64))
    reals[1, 64:128] = reals[0, 64:128]
    return reals, random.integers(0, 2**32, (2, COUNT), np.uint32)


@pytest.mark.parametrize("name", probe.PROBES)
def test_a_lane_does_not_know_its_company(name: str) -> None:
    """Every ray in another lane, beside others: the same bits. No such lane is ever used where they are no number."""
    reals, words = inputs()
    order = np.random.default_rng(5).permutation(COUNT)
    here, there = probe.PROBES[name](reals, words), probe.PROBES[name](reals[:, order], words[:, order])
    assert len(np.unique(here)) > COUNT / 2, "or the same few numbers were compared"
    both_none = np.isnan(here[:, order].view(np.float32)) & np.isnan(there.view(np.float32))
    assert ((here[:, order] == there) | both_none).all()


@pytest.mark.parametrize("name", probe.IN_NUMBERS)
def test_lanes_are_what_double_precision_has_rounded(name: str) -> None:
    """But for a few, where a comparison falls the other way, or digits cancel."""
    reals = np.random.default_rng(12).uniform(0.05, 0.95, (4, COUNT)).astype(np.float32)
    lanes = probe.reals_of(probe.PROBES[name](reals, np.zeros((2, COUNT), np.uint32)))
    numbers = probe.IN_NUMBERS[name](reals.astype(np.float64))
    close = np.isclose(lanes, numbers, rtol=2e-4, atol=2e-5)
    assert close.mean() > 0.998
    assert close.mean(axis=1).min() > 0.99, "in every column"


def test_columns_are_those_of_long_numbers() -> None:
    words = np.random.default_rng(14).integers(0, 2**32, COUNT, np.uint32)
    words[:6] = (0, 1, 0xFFFF, 0x10000, 0xFFFFFFFF, 0xFFFF0000)
    found = probe.probed("columns", word_columns=(words,))
    for row, count in ((0, 1_000_000), (2, 70_001), (4, 3)):
        products = words.astype(np.uint64) * np.uint64(count)
        assert (found[row] == products >> np.uint64(32)).all()
        assert (probe.reals_of(found[row + 1]) == ((products & np.uint64(0xFFFFFFFF)) >> np.uint64(8)) / 2**24).all()


def test_words_are_those_of_mathematics() -> None:
    reals, (w, v) = inputs()
    product, turned, chosen, reversed_, real, whole, _, larger = probe.PROBES["words"](reals, np.array([w, v]))
    wide_w, wide_v = w.astype(np.uint64), v.astype(np.uint64)
    assert np.array_equal(product, (wide_w * wide_v + (wide_w ^ wide_v) - 5).astype(np.uint32))
    assert np.array_equal(turned, (w >> np.uint32(7)) | (w << np.uint32(25)))
    assert np.array_equal(chosen, np.where(w <= v, w & v, ~v))
    assert reversed_.tolist() == [int(f"{value:032b}"[::-1], 2) for value in w.tolist()]
    assert np.array_equal(real.view(np.float32), w.view(np.int32).astype(np.float32))
    scaled = (reals[0] * np.float32(1e9) - np.float32(5e8)).astype(np.float32)
    assert np.array_equal(whole.view(np.int32), np.trunc(scaled).astype(np.int32))
    assert np.array_equal(larger, np.maximum(w, v))


def test_flags() -> None:
    for flags in itertools.product([False, True], repeat=LANES):
        bits = sum(int(flag) << lane for lane, flag in enumerate(flags))
        assert probe.some(np.array(flags)) == (any(flags), bits, sum(flags))


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint8, np.uint16, np.uint32, np.int64])
def test_gathering_from_all_kinds_of_arrays(dtype: type) -> None:
    array = np.arange(1, 200).astype(dtype)
    places = np.array([0, 198, 7, 7, 3, 150, 1, 42], np.uint32)
    bits = probe.gathered(array, places)
    found = bits.view(np.float32) if np.issubdtype(dtype, np.floating) else bits
    assert np.array_equal(found, array[places])
    assert probe.numbered().tolist() == list(range(LANES))
