"""What rays need to go past empty cells: how far each voxel of a bitmap (occupancy.py) is from all that is set."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

SHIFT = (0.25, 0.75)
"""Voxels, by which each grid begins below the box."""


class Leaps(NamedTuple):
    """Arguments of kernels, in the order in which these take them."""

    distances: npt.NDArray[np.uint8]
    """[grids, 128, 128, 128], to the next voxel that is set; no grids where nothing is known."""
    low: Floats
    high: Floats
    per_voxel: Floats
    shift: Floats


NO_LEAPS = Leaps(np.empty((0, 1, 1, 1), np.uint8), np.zeros(3), np.ones(3), np.ones(3), np.array(SHIFT))
"""Anything may be anywhere."""
