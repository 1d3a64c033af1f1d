"""The image of the arithmetic renderer in closed form: sums over the steps of all samples, and nothing of passes, films and pools."""

from __future__ import annotations

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.render.job import RenderOptions
from scenefold.render.layers import Pixels, packed
from scenefold.render.rehearsal.walks import STEPS_MAX, U64, added, ends_at, features, has_side_ray, keys_of
from scenefold.render.sum_columns import AOV_UNIT, CHANNELS, NORMAL, RADIANCE_UNIT

LAYERS = ("albedo", "samples")
"""What can be told beside the beauty. With the samples a pass that is added twice is seen, of which the mean is none the wiser."""


def image_of(options: RenderOptions) -> bytes:
    """As it is sent. LocalFault for options that decide by what was found."""
    if options.adaptive is not None or not set(options.layers) <= set(LAYERS):
        raise LocalFault("of such an image there is no closed form")
    window = options.window
    rows, columns = np.mgrid[window.y : window.y + window.height, window.x : window.x + window.width]
    pixels = (rows * options.width + columns).reshape(-1).astype(np.uint64)
    light, albedo = np.zeros((len(pixels), CHANNELS), np.int64), np.zeros((len(pixels), NORMAL), np.int64)
    for sample in range(options.samples):
        keys = keys_of(options.seed, pixels, np.full(len(pixels), sample, np.uint64))
        light += _light_of(keys)
        albedo += features(keys)[:, :NORMAL]
    count = float(options.samples)
    layers: dict[str, Pixels] = {
        "beauty": light.astype(np.float64) / RADIANCE_UNIT / count,
        "albedo": albedo.astype(np.float64) / AOV_UNIT / count,
        "samples": np.full(len(pixels), options.samples, np.uint32),
    }
    return packed({name: values for name, values in layers.items() if name not in LAYERS or name in options.layers})


def _light_of(keys: U64) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    total = np.zeros((len(keys), CHANNELS), np.int64)
    walks = np.ones(len(keys), np.bool_)
    for number in range(STEPS_MAX):
        steps = np.full(len(keys), number, np.uint32)
        total += added(keys, steps, np.zeros(len(keys), np.bool_)) * walks[:, None]
        branches = walks & has_side_ray(keys, steps)
        total += added(keys, steps, np.ones(len(keys), np.bool_)) * branches[:, None]
        walks &= ~ends_at(keys, steps)
    assert not walks.any(), "every walk has ended"
    return total
