"""The ray record: 36 bytes, the same in memory and on the wire (thesis table 3.3, specs/07-rays.md).

    path ray    | origin 3 x f32 | direction 2 x u32 | pdf u16 | time u8 | flags u8 | throughput 48 bits
                | path u16 | medium u8 | kind u8 | t_done u16
    shadow ray  | origin 3 x f32 | end 3 x f32                                      | contribution 48 bits
                | path u16 | medium u8 | kind u8 | t_done u16

Kernels see a batch as uint32[n, 9], little endian; the two structured dtypes name the same bytes. A shadow
ray's end point takes the room of direction, pdf, time and flags, so that both kinds keep 16 bits of t_done.
`kind` holds the bounce in its upper five bits and one of the KIND_ values in its lower three.
"""

from __future__ import annotations

import numpy as np

RAY_BYTES = 36
RAY_WORDS = RAY_BYTES // 4

PATH_RAY = np.dtype(
    [
        ("origin", "<f4", 3),
        ("direction", "<u4", 2),
        ("pdf", "<u2"),
        ("time", "u1"),
        ("flags", "u1"),
        ("throughput", "u1", 6),
        ("path", "<u2"),
        ("medium", "u1"),
        ("kind", "u1"),
        ("t_done", "<u2"),
    ]
)
SHADOW_RAY = np.dtype(
    [
        ("origin", "<f4", 3),
        ("end", "<f4", 3),
        ("contribution", "u1", 6),
        ("path", "<u2"),
        ("medium", "u1"),
        ("kind", "u1"),
        ("t_done", "<u2"),
    ]
)
assert PATH_RAY.itemsize == SHADOW_RAY.itemsize == RAY_BYTES

KIND_CAMERA = 0
KIND_BOUNCE = 1
KIND_SHADOW = 2
KIND_POINT_SHADOW = 3
"""Towards a punctual light, which no other ray can find: panes that it passes tint it (specs/07-rays.md)."""

BOUNCE_MAX = 31
"""Five bits."""
T_DONE_STEPS = 65_535
"""t_done counts this many steps of a ray's span in the job's box; the last one means: left the box."""
PDF_DELTA = 65_535
"""The pdf code of a direction that was not drawn from a density (mirror, straight through, camera)."""
