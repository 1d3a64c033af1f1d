"""If this fails, a hit is shaded otherwise in company than alone: then the image depends on which rays came together."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from scenefold.render.lanes_kernels import LANES
from unit.render import lanes_probe_kernels as probe
from unit.render.test_light_kernels import job, lit_scene

COUNT = 4096


def numbers() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(11)
    reals = random.random((COUNT, 4))
    # What functions branch at: ends, halves, the very small, two that are equal.
    reals[:64] = random.choice([0.0, 0.5, 1.0, 1e-30, 1.0 - 2.0**-53], (64, 4))
    reals[64:128, 1] = reals[64:128, 0]
    return reals, random.integers(0, 2**64, COUNT, np.uint64)


def same_bits(left: np.ndarray, right: np.ndarray) -> bool:
    """Also where both are no number, whichever: no such lane is ever used."""
    return bool(((left.view(np.uint64) == right.view(np.uint64)) | (np.isnan(left) & np.isnan(right))).all())


@pytest.mark.parametrize("name", probe.BESIDE)
def test_lanes_have_the_bits_of_numbers(name: str) -> None:
    single, many = probe.BESIDE[name](*numbers())
    assert np.isfinite(single).mean() > 0.8, "or nothing was compared"
    assert len(np.unique(single)) > COUNT, "or the same few numbers were"
    assert same_bits(single, many)


def test_light_samples_in_lanes_have_the_bits_of_single_ones() -> None:
    random = np.random.default_rng(3)
    points, keys = random.uniform(-3.5, 3.5, (COUNT, 3)), random.integers(0, 2**64, COUNT, np.uint64)
    single, many = probe.lights(lit_scene(), job(0.25, 0.35, 0.4), points, keys)
    found = single[:, 0] != 0.0
    assert 0.5 < found.mean() < 1.0
    assert np.array_equal(single[:, 0], many[:, 0])
    assert same_bits(np.ascontiguousarray(single[found]), np.ascontiguousarray(many[found]))


def test_any_lane_of_all_flags() -> None:
    for flags in itertools.product([False, True], repeat=LANES):
        assert probe.some(np.array(flags)) == (any(flags), sum(flags))
