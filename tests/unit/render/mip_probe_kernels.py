"""Kernels that call device functions of textures' levels over arrays, for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from scenefold.render import texture_kernels

_sample_levels = texture_kernels.sample_levels


@njit(cache=True, error_model="numpy")
def level_samples(textures: Any, texels: Any, linear: Any, uvs: Any, counts: Any, minify: Any) -> Any:
    """f64[n, 4] of texture 0, clamped, at uvs f64[n, 2], with so many texels in the footprint."""
    out = np.empty((uvs.shape[0], 4))
    for i in range(uvs.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = _sample_levels(
            textures, texels, linear, 0, uvs[i, 0], uvs[i, 1], 1, 1, minify, counts[i]
        )  # fmt: skip
    return out
