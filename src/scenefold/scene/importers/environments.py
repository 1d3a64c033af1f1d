"""Environment maps out of image files: Radiance's .hdr, and OpenEXR (specs/05-scene-content.md, *Environment*).

What is no light (negative, infinite, no number) becomes black and is counted; a map with more texels than a node should hold
is made smaller by halves. All of it happens some rows at a time: a small file may hold a map of the largest size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.base.limits import ENVIRONMENT_TEXELS_MAX
from scenefold.scene.importers.faults import readable_size
from scenefold.scene.importers.open_exr import read_exr
from scenefold.scene.importers.radiance_hdr import read_hdr
from scenefold.scene.importers.source import NotCarried
from scenefold.scene.payloads.environment import Environment

F32 = NDArray[np.float32]
_HALF_MAX = 65504.0
_RANGE = 2.0**26
"""The brightest texel over the middle one: at most so much, and the middle one keeps all the bits of a half."""
_ROWS = 64
"""At a time; an even number."""


def read_environment(path: Path) -> tuple[Environment, list[str]]:
    """The map of a file, and what of it was not carried over, in words; LocalFault if it is none."""
    readable_size(path, "an environment map")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        kinds = ", ".join(_READERS)
        raise LocalFault(f"{path.suffix!r} is no kind of an environment map", where=str(path), remedy=f"give one of {kinds}")
    left = NotCarried()
    return environment_of(reader(path, left), left)


def environment_of(radiance: F32, left: NotCarried | None = None) -> tuple[Environment, list[str]]:
    """The map of linear radiance f32[height, width, 3], row 0 on top, and what was not carried over; what is no light becomes 0 in `radiance`, too."""
    left = left or NotCarried()
    left.note("texels of the environment map that are no light, taken as black", _without_what_is_no_light(radiance))
    while radiance.shape[0] * radiance.shape[1] > ENVIRONMENT_TEXELS_MAX:
        left.note("halvings of the environment map's sides, which was too large")
        radiance = _halved(radiance)
    left.note(
        f"texels of the environment map over {_RANGE:g} times as bright as the middle one, taken for as bright as that", _dimmed(radiance)
    )
    brightest = float(radiance.max())
    exponent = max(0, math.ceil(math.log2(brightest / _HALF_MAX))) if brightest > _HALF_MAX else 0
    texels = (radiance.astype(np.float64) * 2.0**-exponent).astype(np.float16).reshape(-1, 3)
    height, width = radiance.shape[:2]
    return Environment(width, height, exponent, texels), left.lines()


def _without_what_is_no_light(radiance: F32) -> int:
    """Makes texels black that are negative, infinite or no number, and says how many."""
    count = 0
    for first in range(0, len(radiance), _ROWS):
        rows = radiance[first : first + _ROWS]
        dark = np.logical_not((np.isfinite(rows) & (rows >= 0.0)).all(axis=2))
        if dark.any():
            rows[dark] = 0.0
            count += int(dark.sum())
    return count


def _dimmed(radiance: F32) -> int:
    """Makes texels no brighter than a map can hold beside its middle ones, and says how many there were: all of a map has one exponent, and a
    single texel that is no light at all would leave nothing of the others."""
    brightness = radiance.max(axis=2)
    if not (lit := brightness[brightness > 0.0]).size:
        return 0
    most = float(np.median(lit)) * _RANGE
    over = brightness > most
    radiance[over] *= (most / brightness[over].astype(np.float64)).astype(np.float32)[:, None]
    return int(over.sum())


def _halved(radiance: F32) -> F32:
    """Half as wide and high, in whole texels: means of two by two; of an odd side the last texel counts twice."""
    height, width = radiance.shape[:2]
    halved = np.empty(((height + 1) // 2, (width + 1) // 2, 3), np.float32)
    for first in range(0, height, _ROWS):
        rows = radiance[first : first + _ROWS]
        padded = np.pad(rows, ((0, len(rows) % 2), (0, width % 2), (0, 0)), mode="edge")
        mean = 0.25 * (padded[::2, ::2] + padded[1::2, ::2] + padded[::2, 1::2] + padded[1::2, 1::2])
        halved[first // 2 : first // 2 + len(mean)] = mean
    return halved


_READERS: dict[str, Callable[[Path, NotCarried], F32]] = {".hdr": read_hdr, ".exr": read_exr}
