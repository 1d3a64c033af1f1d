"""The image of the arithmetic renderer as it must be: sums over the steps of all samples, and nothing of passes on several nodes, and of pools.

Where it is decided on the way which pixels go on, that rule and the film that it looks at are the product's; of all else there is a closed form.
"""

from __future__ import annotations

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.render.adaptive import going_on
from scenefold.render.film import EVERY_ROW, Film, GoesOn
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.job import RenderOptions
from scenefold.render.layers import Pixels, packed
from scenefold.render.pass_sums import PassSums
from scenefold.render.rehearsal.walks import STEPS_MAX, U64, added, ends_at, features, has_side_ray, keys_of
from scenefold.render.sum_columns import AOV_UNIT, CHANNELS, NORMAL, RADIANCE_UNIT

LAYERS = ("albedo", "samples")
"""What can be told beside the beauty. With the samples a pass that is added twice is seen, of which the mean is none the wiser."""


def image_of(options: RenderOptions) -> bytes:
    """As it is sent. LocalFault for layers that are nothing of its kind."""
    if not set(options.layers) <= set(LAYERS):
        raise LocalFault("of such an image there is no closed form")
    window = options.window
    rows, columns = np.mgrid[window.y : window.y + window.height, window.x : window.x + window.width]
    pixels = (rows * options.width + columns).reshape(-1).astype(np.uint64)
    samples = samples_of(options, pixels)
    light, albedo = np.zeros((len(pixels), CHANNELS), np.int64), np.zeros((len(pixels), NORMAL), np.int64)
    for sample in range(options.samples):
        keys = keys_of(options.seed, pixels, np.full(len(pixels), sample, np.uint64))
        has = (sample < samples)[:, None]
        light += _light_of(keys) * has
        albedo += features(keys)[:, :NORMAL] * has
    counts = samples.astype(np.float64)[:, None]
    layers: dict[str, Pixels] = {
        "beauty": light.astype(np.float64) / RADIANCE_UNIT / counts,
        "albedo": albedo.astype(np.float64) / AOV_UNIT / counts,
        "samples": samples.astype(np.uint32),
    }
    return packed({name: values for name, values in layers.items() if name not in LAYERS or name in options.layers})


def samples_of(options: RenderOptions, pixels: U64) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """How many samples each of these pixels of the window has, which are all of it, in its order."""
    samples = np.full(len(pixels), options.samples, np.int64)
    if options.adaptive is None:
        return samples
    window = options.window
    film, goes_on = Film(window.width, window.height, options.columns), EVERY_ROW
    in_rows = film.in_rows(pixels.reshape(window.height, window.width))
    done = 0
    for level in options.adaptive.levels(options.samples)[:-1]:
        for sample in range(done, level):
            _add_sample(film, keys_of(options.seed, in_rows, np.full(len(pixels), sample, np.uint64)), sample, goes_on)
        done = level
        goes_on = going_on(film, options.adaptive.noise, goes_on)
        ended = film.in_order(goes_on).reshape(-1) == 0
        samples[ended] = np.minimum(samples[ended], level)
    return samples


def _add_sample(film: Film, keys: U64, sample: int, goes_on: GoesOn) -> None:
    """One sample of each pixel, or of each that goes on."""
    sums = PassSums.zeros(len(keys), film.rows.columns)
    goes = np.ones(len(keys), np.bool_) if not len(goes_on) else goes_on != 0
    sums.radiance[goes], sums.aovs[goes] = _light_of(keys[goes]), features(keys[goes])
    film.add(sums, sample * len(keys), scattering_stride(len(keys)), goes_on)


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
