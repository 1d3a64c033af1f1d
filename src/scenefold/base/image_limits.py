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
SAMPLERS = ("sobol", "independent")
"""How the random numbers of a pixel's paths are drawn (specs/07-rays.md, *Random numbers*)."""
ADAPTIVE_MAX = 1.0
"""Error at which pixels may end, relative to their brightness."""
MIN_SAMPLES_LEAST = 4
"""No first level of adaptive sampling has fewer: the mean of what stops early is biased the more, the fewer samples decide."""
FOCUS_MIN = 1e-6
"""In the world's unit: nearer, the lens would be all that is seen."""
ROTATION_MAX = 360.0
"""Degrees of an environment map's turn, either way."""
CLAMP_MAX = 1e6
"""Limit of a contribution of light: above 2^24 they are clamped anyway."""
EXPOSURE_MAX = 64.0
"""Stops, up or down."""
CAMERA_NAME_BYTES_MAX = 1_024
