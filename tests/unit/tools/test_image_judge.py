"""If this fails, two images that differ are called equal, or equal ones different: the comparison with Mitsuba says nothing."""

from __future__ import annotations

import numpy as np
import pytest

from image_judge import Estimate, judge, of_batches


def images(seed: int, red: float = 1.0, green: float = 1.0, blue: float = 1.0) -> Estimate:
    """24 x 16 pixels, of 32 batches with a tenth of noise."""
    noise = np.random.default_rng(seed).normal(1.0, 0.1, (32, 16, 24, 3))
    return of_batches(noise * [red, green, blue])


def test_equal_images_differ_by_no_more_than_chance() -> None:
    found = judge(images(1), images(2))
    assert abs(found["luminance_difference_percent"]) < 4 * found["standard_error_percent"] < 1.0
    assert found["far_off_percent"] < 2.0


def test_a_channel_that_is_wrong_alone_is_told() -> None:
    """Blue is a fourteenth of the luminance, and red and green can make up for one another."""
    found = judge(images(1, red=1.03, green=0.99108, blue=1.0), images(2))
    assert abs(found["luminance_difference_percent"]) < 0.2
    differences = [one["difference_percent"] for one in found["channels"]]
    assert differences == pytest.approx([3.0, -0.892, 0.0], abs=0.25)


def test_a_channel_s_error_is_how_its_mean_scatters() -> None:
    errors = [one["standard_error_percent"] for one in judge(images(1), images(2))["channels"]]
    assert errors == pytest.approx(3 * [100 * 0.1 * (2 / (32 * 16 * 24)) ** 0.5], rel=0.05)
