"""Ray records as embreex wants rays: origins and directions in single precision."""

from __future__ import annotations

import numpy as np
from numba import njit

from scenefold.render.lanes_kernels import LANES
from scenefold.render.record_kernels import end_of, is_shadow_ray, origin_of, unpack_directions


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def unpack_rays(rays, origins, directions, is_shadow, scratch):  # type: ignore[no-untyped-def]
    """rays uint32[n, 9] -> float32[n, 3] twice and bool[n]; scratch float32[>= 3 * LANES]. A shadow ray's direction reaches from origin to end."""
    for i in range(rays.shape[0]):
        lane = i & (LANES - 1)
        if lane == 0:
            unpack_directions(rays, i, scratch)
        ox, oy, oz = origin_of(rays, i)
        is_shadow[i] = is_shadow_ray(rays, i)
        if is_shadow[i]:
            ex, ey, ez = end_of(rays, i)
            dx, dy, dz = np.float32(ex - ox), np.float32(ey - oy), np.float32(ez - oz)
        else:
            dx, dy, dz = scratch[lane], scratch[LANES + lane], scratch[2 * LANES + lane]
        origins[i, 0], origins[i, 1], origins[i, 2] = ox, oy, oz
        directions[i, 0], directions[i, 1], directions[i, 2] = dx, dy, dz
