"""Which pixel and sample a path is of: the scattered order of a job's pixels (thesis 3.3.3; specs/07-rays.md, Random numbers).

Pixels are those of the whole image, also where a job makes a part of it: that part has the bits that it has in the whole.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from scenefold.render.lane_values_kernels import put, take
from scenefold.render.lanes_kernels import LANES


@njit(error_model="numpy", _nrt=False, forceinline=True)
def pixel_of(job, number):  # type: ignore[no-untyped-def]
    """(pixel of the whole image, sample) of a path of the job; all of them uint64."""
    pixels = np.uint64(job.crop_width * job.crop_height)
    sample = number // pixels
    at = (number - sample * pixels) * np.uint64(job.stride) % pixels
    pixel = at + np.uint64(job.crop_y * job.width + job.crop_x)
    if job.crop_width != job.width:
        pixel = pixel + at // np.uint64(job.crop_width) * np.uint64(job.width - job.crop_width)
    return pixel, sample


@njit(error_model="numpy", _nrt=False, forceinline=True)
def pixels_of(job, first_path, paths, scratch):  # type: ignore[no-untyped-def]
    """(pixel, sample) of paths of a pass, words; first_path is the number of the pass's path 0 among all of the job. scratch uint32[>= 2 * LANES]."""
    put(scratch, 0, paths)
    for k in range(LANES):
        pixel, sample = pixel_of(job, np.uint64(first_path) + np.uint64(scratch[k]))
        scratch[k] = np.uint32(pixel)
        scratch[LANES + k] = np.uint32(sample)
    return take(scratch, 0), take(scratch, LANES)
