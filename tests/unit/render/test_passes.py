"""If this fails, paths are traced twice or never, or a pass's owner is disputed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.levels import Adaptive
from scenefold.render.passes import PassPlan, place_of, plan_of

jobs = st.integers(0, 2**64 - 1)


@given(jobs, st.integers(1, 2**40))
def test_passes_cover_all_paths_once(job: int, paths: int) -> None:
    plan = PassPlan(job, paths)
    last = plan.count - 1
    assert plan.first_path(0) == 0
    assert plan.first_path(last) + plan.size(last) == paths
    assert 1 <= plan.size(last) <= PASS_PATHS_MAX
    for number in {0, last // 2, max(last - 1, 0)}:
        if number < last:
            assert plan.size(number) == PASS_PATHS_MAX
            assert plan.first_path(number) + plan.size(number) == plan.first_path(number + 1)


@given(st.integers(1, 3 * PASS_PATHS_MAX), st.integers(1, 600), st.integers(4, 40))
def test_no_pass_has_paths_of_two_levels(pixels: int, samples: int, first: int) -> None:
    adaptive = Adaptive(0.1, first)
    plan = plan_of(5, pixels, samples, adaptive)
    path = number = 0
    for level, count in enumerate(adaptive.levels(samples)):
        while number < plan.passes_until(level):
            assert plan.first_path(number) == path
            assert 1 <= plan.size(number) <= PASS_PATHS_MAX
            path, number = path + plan.size(number), number + 1
        assert path == count * pixels
    assert (number, path) == (plan.count, plan.paths) and plan.levels == len(adaptive.levels(samples))


@given(jobs, st.integers(0, 2**20), st.integers(0, 2**20))
def test_places_differ_and_are_the_same_everywhere(job: int, one: int, other: int) -> None:
    plan = PassPlan(job, 2**40)
    assert (plan.location(one) == plan.location(other)) == (one == other)
    assert plan.location(one) == PassPlan(job, 1).location(one)
    assert plan.location(one) != place_of(b"job", job, one)


def test_places_of_record() -> None:
    assert bytes(place_of(b"pass", 1, 2)).hex() == "cf4958f7a017866d82e1b4ef34083ea5be894572"


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 2), (2, 1), (3, 1), (24, 24), (640, 360), (641, 359), (16_384, 16_384)])
def test_strides_visit_every_pixel(width: int, height: int) -> None:
    pixels = width * height
    stride = scattering_stride(pixels)
    assert math.gcd(stride, pixels) == 1
    if pixels < 10**6:
        assert len(np.unique(np.arange(pixels) * stride % pixels)) == pixels


def test_consecutive_paths_lie_far_apart() -> None:
    width, height = 640, 360
    pixel = np.arange(5000) * scattering_stride(width * height) % (width * height)
    counts = np.histogram2d(pixel // width, pixel % width, (6, 6), ((0, height), (0, width)))[0]
    assert counts.min() > 0.7 * counts.mean(), "the first few thousand paths cover the image evenly"
