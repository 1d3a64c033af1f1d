"""Bounds of what an image may be asked to be: options of a render, and what a scene's log says of them."""

from __future__ import annotations

SIDE_MAX = 16_384
"""Pixels of one side."""
SAMPLES_MAX = 1 << 20
"""Paths for each pixel."""
DEPTH_MAX = 32
"""Segments of a path."""
SKY_MAX = 1e9
"""Radiance of one channel of a uniform sky."""
CLAMP_MAX = 1e6
"""Limit of a contribution of light: above 2^24 they are clamped anyway."""
EXPOSURE_MAX = 64.0
"""Stops, up or down."""
CAMERA_NAME_BYTES_MAX = 1_024
