"""How checks speak: an AssertionError with what was expected and what came, whatever Python's -O does with asserts."""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F64
from scenefold.render.kit.rig import Rendered

Z_MAX = 4.0
"""Standard errors: one right renderer in 16,000 would fail a channel of a check by chance, and dice are fixed anyway."""


def expect(condition: object, message: str) -> None:
    """AssertionError with this message unless the condition holds."""
    if not condition:
        raise AssertionError(message)


def expect_mean(image: Rendered, low: F64, high: F64, what: str, *, noise_max: float = 0.02) -> None:
    """The image's mean, float64[3], must lie between `low` and `high`, or within its own noise beside them.

    `noise_max` is the noise, relative to `high`, beyond which the check would show nothing.
    """
    mean = image.beauty.astype(np.float64).mean(axis=(0, 1))
    paths = image.radiance / 2.0**32
    error = Z_MAX * paths.std(axis=0) / np.sqrt(len(paths))
    expect(
        (error <= noise_max * np.maximum(high, 1e-12)).all(), f"{what}: the noise, {error}, is too high to tell; expected {low} to {high}"
    )
    good = (mean >= low - error) & (mean <= high + error)
    expect(good.all(), f"{what}: the mean is {mean}, expected {low} to {high}, give or take {error}")


def expect_nothing_lost(image: Rendered, what: str) -> None:
    """No contribution was clamped, or was not a number."""
    expect(not image.counters[1:].any(), f"{what}: {image.counters[1]} contributions are not finite, {image.counters[2]} were clamped")
