"""Environment maps out of image files: Radiance's .hdr, and OpenEXR (specs/05-scene-content.md, *Environment*).

What is no light (negative, infinite, no number) becomes black and is counted; a map with more texels than a node should hold
is made smaller by halves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.base.limits import ENVIRONMENT_TEXELS_MAX, TEXTURE_PIXELS_MAX, TEXTURE_SIDE_MAX
from scenefold.scene.importers.faults import bad_file, readable_size
from scenefold.scene.importers.radiance_hdr import read_hdr
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.environment import Environment

F32 = NDArray[np.float32]
_HALF_MAX = 65504.0


def read_environment(path: Path) -> tuple[Environment, list[str]]:
    """The map of a file, and what of it was not carried over, in words; LocalFault if it is none."""
    readable_size(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        kinds = ", ".join(_READERS)
        raise LocalFault(f"{path.suffix!r} is no kind of an environment map", where=str(path), remedy=f"give one of {kinds}")
    return environment_of(reader(path))


def environment_of(radiance: F32) -> tuple[Environment, list[str]]:
    """The map of linear radiance f32[height, width, 3], row 0 on top, and what was not carried over."""
    left = NotCarried()
    light = np.isfinite(radiance) & (radiance >= 0.0)
    dark = np.logical_not(light.all(axis=2))
    left.note("texels of the environment map that are no light, taken as black", int(dark.sum()))
    radiance = np.where(dark[:, :, None], np.float32(0.0), radiance)
    while radiance.shape[0] * radiance.shape[1] > ENVIRONMENT_TEXELS_MAX:
        left.note("halvings of the environment map's sides, which was too large")
        radiance = _halved(radiance)
    brightest = float(radiance.max())
    exponent = max(0, math.ceil(math.log2(brightest / _HALF_MAX))) if brightest > _HALF_MAX else 0
    texels = (radiance.astype(np.float64) * 2.0**-exponent).astype(np.float16).reshape(-1, 3)
    height, width = radiance.shape[:2]
    return Environment(width, height, exponent, texels), left.lines()


def _halved(radiance: F32) -> F32:
    """Half as wide and high, in whole texels: means of two by two; of an odd side the last texel counts twice."""
    height, width = radiance.shape[:2]
    padded = np.pad(radiance, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return (0.25 * (padded[::2, ::2] + padded[1::2, ::2] + padded[::2, 1::2] + padded[1::2, 1::2])).astype(np.float32)


def _read_exr(path: Path) -> F32:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
        width, height = (int(last) - int(first) + 1 for first, last in zip(low, high, strict=True))
        if max(width, height) > TEXTURE_SIDE_MAX or width * height > TEXTURE_PIXELS_MAX:
            raise bad_file(path, f"the map has {width} x {height} pixels", "make it smaller")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels: dict[str, Any] = {name: channel.pixels for name, channel in file.channels().items()}
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise bad_file(path, f"the OpenEXR file cannot be read, {error}") from error
    names = "YYY" if "Y" in channels else "RGB"
    if not set(names) <= set(channels):
        raise bad_file(path, "the OpenEXR file has no channels R, G and B", "give one with a picture in it")
    return np.stack([channels[name].astype(np.float32) for name in names], axis=2)


_READERS: dict[str, Callable[[Path], F32]] = {".hdr": read_hdr, ".exr": _read_exr}
