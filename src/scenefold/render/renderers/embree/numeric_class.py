"""Within which images are equal to the bit: Embree's version and instruction set, our own arithmetic, and what this processor makes of fixed rays.

Embree begins its reciprocals with the processor's own estimate (rcpps), which the instruction set leaves open within 1.5 x 2^-12; one
step of Newton's method does not always round the rest away. So t, u and v differ in their last bits between makers of processors, whatever the instruction set.
Rather than to know makers, the class has a **print**: a hash of what comes out for rays that are always the same.
"""

from __future__ import annotations

import functools
import hashlib
from importlib import metadata
from typing import Final

import numpy as np
import numpy.typing as npt

from scenefold.render.renderers.embree.library import ISA, Device

ARITHMETIC: Final = 7
"""Of our own kernels: one more whenever a change of theirs changes the bits of an image."""

_TRIANGLES, _RAYS = 128, 2048
_PRINT_DIGITS: Final = 8
_RAYHIT_WORDS: Final = 24
"""RTCRayHit in 32-bit words, as in filter_kernels.py, up to a whole number of 16 bytes."""
_FOUND: Final = (8, *range(12, 20))
"""Of these: t, the normal, u, v, and what was met."""
_NOBODY: Final = 0xFFFFFFFF
_SKEWED: Final = ((0.9, 0.3, -0.2, 0.1), (-0.35, 1.1, 0.15, -0.2), (0.25, -0.1, 0.7, 0.3))


@functools.cache
def numeric_class() -> str:
    """The class of this node. LocalFault if its processor, or its Embree, is none to render with. It takes some milliseconds, once."""
    device = Device()
    major, minor, patch = device.version
    try:
        of_processor = processor_print(device)
    finally:
        device.release()
    kernels = metadata.version("embreex")
    return f"embree-{major}.{minor}.{patch}-{ISA}-embreex-{kernels}-kernels-{ARITHMETIC}-print-{of_processor}"


def processor_print(device: Device) -> str:
    """8 hex digits: equal where Embree's t, u and v are, for rays at triangles and at an instance of them."""
    vertices, origins, directions = _shapes()
    triangles = np.arange(3 * _TRIANGLES, dtype=np.uint32).reshape(-1, 3)
    prototype, scene = device.new_scene(), device.new_scene()
    try:
        device.add_triangles(prototype, 0, vertices, triangles)
        device.commit(prototype)
        device.add_triangles(scene, 0, vertices, triangles)
        device.add_instance(scene, 1, prototype, np.array(_SKEWED, np.float32))
        device.commit(scene)
        found = _cast(device, scene, origins, directions)
    finally:
        device.release_scenes(scene, prototype)
    return hashlib.sha256(found.astype("<u4").tobytes()).hexdigest()[:_PRINT_DIGITS]


def _shapes() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Vertices float32[3 n + 2, 3], of which Embree reads the last two as padding only, and rays' float32[m, 3] origins and directions."""
    count = 3 * (4 * _TRIANGLES + 2 * _RAYS)
    drawn = np.frombuffer(hashlib.shake_256(b"scenefold/numeric class").digest(4 * count), "<u4") >> 8
    numbers = (drawn.astype(np.float32) * np.float32(2.0**-23) - np.float32(1.0)).reshape(-1, 3)
    centres, numbers = numbers[:_TRIANGLES], numbers[_TRIANGLES:]
    corners, numbers = numbers[: 3 * _TRIANGLES], numbers[3 * _TRIANGLES :]
    vertices = np.concatenate([np.repeat(centres, 3, axis=0) + corners * np.float32(0.25), np.zeros((2, 3), np.float32)])
    origins = numbers[:_RAYS] * np.float32(4.0)
    aims = centres[np.arange(_RAYS) % _TRIANGLES] + numbers[_RAYS:] * np.float32(0.0625)
    return np.ascontiguousarray(vertices), origins, aims - origins


def _cast(device: Device, scene: int, origins: npt.NDArray[np.float32], directions: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """uint32[m, 9], the words of `_FOUND` of each ray."""
    room = np.zeros(len(origins) * _RAYHIT_WORDS + 4, np.uint32)
    first = -room.ctypes.data % 16 // 4
    words = room[first : first + len(origins) * _RAYHIT_WORDS].reshape(-1, _RAYHIT_WORDS)
    reals = words.view(np.float32)
    reals[:, 0:3], reals[:, 4:7], reals[:, 8] = origins, directions, np.inf
    words[:, [9, 17, 18, 19, 20]] = _NOBODY
    for ray in words:
        device.intersect(scene, ray.ctypes.data)
    return words[:, _FOUND]
