"""Two images of one scene, each with the variance of its pixels' means: do they show the same?

z of a pixel is the difference of luminance over its standard error. Were both images right, |z| would pass 1.96 in 5 % of the pixels.
A pixel's mean of few, uneven samples is no normal variable yet, so blocks of 8 x 8 pixels are judged as well: they are nearer to one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
BLOCK = 8
Z_95 = 1.959964
Z_999 = 3.290527
_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
_EQUAL = 1e-5
"""Where neither image has noise (sky, lamps), they agree if they are relatively this near."""


@dataclass(frozen=True)
class Estimate:
    """An image: mean radiance and variance of that mean, float64[H, W, 3] and float64[H, W] of the luminance, and of each channel."""

    mean: F64
    variance: F64
    channels: F64
    """Variance of the mean, float64[H, W, 3]."""

    @property
    def luminance(self) -> F64:
        """float64[H, W]"""
        result: F64 = self.mean @ _WEIGHTS
        return result


def of_batches(images: F64) -> Estimate:
    """From independent images of equally many samples, float64[batches, H, W, 3]."""
    light = images @ _WEIGHTS
    return Estimate(images.mean(axis=0), light.var(axis=0, ddof=1) / len(images), images.var(axis=0, ddof=1) / len(images))


def judge(ours: Estimate, theirs: Estimate) -> dict[str, Any]:
    """What differs, in numbers."""
    difference = ours.luminance - theirs.luminance
    variance = ours.variance + theirs.variance
    level = float(theirs.luminance.mean())
    quiet = variance <= (_EQUAL * np.maximum(theirs.luminance, 1e-12)) ** 2
    z = np.where(quiet, 0.0, difference / np.sqrt(np.maximum(variance, 1e-300)))
    noisy = ~quiet
    blocks, spread = _blocks(difference), _blocks(variance)
    block_z = blocks / np.sqrt(np.maximum(spread, 1e-300))
    lit = spread > (_EQUAL * np.maximum(_blocks(theirs.luminance), 1e-12)) ** 2
    block_z = np.where(lit, block_z, 0.0)
    worst = np.unravel_index(int(np.abs(block_z).argmax()), block_z.shape)
    return {
        "mean": level,
        "channels": [_channel(ours, theirs, channel) for channel in range(3)],
        "luminance_difference_percent": 100 * float(difference.mean()) / max(level, 1e-12),
        "standard_error_percent": 100 * float(np.sqrt(variance.sum())) / difference.size / max(level, 1e-12),
        "noisy_pixels": int(noisy.sum()),
        "quiet_pixels_that_differ": int((quiet & (np.abs(difference) > 10 * _EQUAL * np.maximum(theirs.luminance, 1e-12))).sum()),
        "rejected_percent": 100 * float((np.abs(z[noisy]) > Z_95).mean()) if noisy.any() else 0.0,
        "rejected_percent_blocks": 100 * float((np.abs(block_z[lit]) > Z_95).mean()) if lit.any() else 0.0,
        "far_off_percent": 100 * float((np.abs(z[noisy]) > Z_999).mean()) if noisy.any() else 0.0,
        "worst_block": {"z": float(block_z[worst]), "x": int(worst[1]) * BLOCK, "y": int(worst[0]) * BLOCK},
    }


def _channel(ours: Estimate, theirs: Estimate, channel: int) -> dict[str, float]:
    """How far one channel of the whole image differs, and how sure that is: what luminance hides, of blue most."""
    level = max(float(theirs.mean[..., channel].mean()), 1e-12)
    variance = ours.channels[..., channel] + theirs.channels[..., channel]
    return {
        "difference_percent": 100 * float((ours.mean - theirs.mean)[..., channel].mean()) / level,
        "standard_error_percent": 100 * float(np.sqrt(variance.sum())) / variance.size / level,
    }


def _blocks(values: F64) -> F64:
    """Sums over blocks of BLOCK x BLOCK pixels; what is left at the right and below counts with the last block."""
    rows, columns = (np.minimum(np.arange(size) // BLOCK, max(size // BLOCK, 1) - 1) for size in values.shape)
    sums = np.zeros((int(rows.max()) + 1, int(columns.max()) + 1))
    np.add.at(sums, (rows[:, None], columns[None, :]), values)
    return sums


def difference_image(ours: Estimate, theirs: Estimate) -> npt.NDArray[np.uint8]:
    """uint8[H, W, 3]: red where ours is brighter, blue where theirs is; full at half of the mean luminance."""
    scaled = (ours.luminance - theirs.luminance) / max(0.5 * float(theirs.luminance.mean()), 1e-12)
    amount = np.clip(np.abs(scaled), 0.0, 1.0)
    pixels = np.zeros((*amount.shape, 3))
    pixels[..., 0] = np.where(scaled > 0, amount, 0.0)
    pixels[..., 2] = np.where(scaled < 0, amount, 0.0)
    return (pixels * 255 + 0.5).astype(np.uint8)
