"""What one contribution of light may be at most, where a job sets a limit (specs/07-rays.md, *Settings of paths*).

A bright spot that few paths find stays for hundreds of samples. With a limit it is darker than it should be, and gone.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.lane_values_kernels import select


@njit(error_model="numpy", _nrt=False, forceinline=True)
def clamped(job, scatterings, r, g, b):  # type: ignore[no-untyped-def]
    """A contribution in lanes, darkened to its limit if the mean of its channels is above; `scatterings`, words: how often it was reflected.

    One that is infinite becomes what is no number, and is counted as that.
    """
    if min(job.clamp_direct, job.clamp_indirect) < math.inf:
        limit = select(scatterings <= np.uint32(1), job.clamp_direct, job.clamp_indirect)
        mean = (r + g + b) * (1.0 / 3.0)
        scale = select(mean > limit, limit / mean, 1.0)
        r, g, b = r * scale, g * scale, b * scale
    return r, g, b
