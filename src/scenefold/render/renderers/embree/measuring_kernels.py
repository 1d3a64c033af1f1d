"""Ray records as embreex wants rays: origins and directions in single precision."""

from __future__ import annotations

import numpy as np
from numba import njit

from scenefold.render.math_kernels import decode_direction
from scenefold.render.record_kernels import end_of, is_shadow_ray, origin_of


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def unpack_rays(rays, origins, directions, is_shadow):  # type: ignore[no-untyped-def]
    """rays uint32[n, 9] -> float32[n, 3] twice and bool[n]. A shadow ray's direction reaches from origin to end."""
    for i in range(rays.shape[0]):
        ox, oy, oz = origin_of(rays, i)
        is_shadow[i] = is_shadow_ray(rays, i)
        if is_shadow[i]:
            ex, ey, ez = end_of(rays, i)
            dx, dy, dz = np.float32(ex - ox), np.float32(ey - oy), np.float32(ez - oz)
        else:
            rx, ry, rz = decode_direction(rays[i, 3], rays[i, 4])
            dx, dy, dz = np.float32(rx), np.float32(ry), np.float32(rz)
        origins[i, 0], origins[i, 1], origins[i, 2] = ox, oy, oz
        directions[i, 0], directions[i, 1], directions[i, 2] = dx, dy, dz
