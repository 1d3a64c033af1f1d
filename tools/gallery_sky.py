"""The gallery's sky: blue above, pale at the horizon, brown below, with a low sun; written as a Radiance picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
WIDTH, HEIGHT = 512, 256
_ZENITH, _HORIZON, _GROUND = (np.array(colour) for colour in ((0.25, 0.5, 1.1), (1.1, 1.15, 1.2), (0.28, 0.25, 0.22)))
_SUN, _SUN_COLOUR, _SUN_RADIUS = np.array([-0.55, 0.6, 0.58]), np.array([700.0, 620.0, 480.0]), 0.04
"""Direction (glTF's axes), radiance, and radius in radians."""


def sky_of(directions: F64) -> F64:
    """Linear radiance f64[..., 3] from unit directions f64[..., 3]."""
    up = directions[..., 1:2]
    above = _HORIZON + (_ZENITH - _HORIZON) * np.clip(up, 0.0, 1.0) ** 0.5
    sun = np.arccos(np.clip(directions @ (_SUN / np.linalg.norm(_SUN)), -1.0, 1.0))[..., None]
    above = above + np.where(sun < _SUN_RADIUS, _SUN_COLOUR, 0.0) + np.exp(-sun * 6.0) * np.array([1.2, 1.0, 0.7])
    found: F64 = np.where(up > 0.0, above, _GROUND)
    return found


def write_sky(path: Path) -> None:
    """Equirectangular, the top +Y and the middle -Z (specs/05-scene-content.md, *Environment*)."""
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH * 2 * np.pi, (np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi)
    radiance = sky_of(np.stack([-np.sin(x) * np.sin(y), np.cos(y), np.cos(x) * np.sin(y)], axis=-1))
    exponents = np.ceil(np.log2(radiance.max(axis=2, keepdims=True)))
    mantissas = np.clip(radiance / 2.0**exponents * 256.0, 0.0, 255.0)
    texels = np.concatenate([mantissas, exponents + 128.0], axis=2).astype(np.uint8)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n".encode()
    path.write_bytes(head + texels.tobytes())
