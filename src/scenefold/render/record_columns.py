"""Camera rays as records, and records as columns of reals: what a renderer needs that keeps no records of its own.

Reading is numpy, from the words of specs/07-rays.md alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.base.rays import KIND_BOUNCE, KIND_CAMERA, PATH_RAY, RAY_WORDS
from scenefold.render.arrays import F64, I64, U32, JobNumbers
from scenefold.render.generate_kernels import SCRATCH_WORDS, generate_pass
from scenefold.render.lanes_kernels import LANES

_CODES = 2.0**31


class PathRays(NamedTuple):
    """Rays that search their first hit."""

    rows: I64
    """[n] of the batch."""
    origins: F64
    """[n, 3]"""
    directions: F64
    """[n, 3], unit"""
    throughputs: F64
    """[n, 3]"""
    paths: I64
    """[n], in their pass"""
    is_camera: npt.NDArray[np.bool_]
    bounces: I64


def camera_rays(numbers: JobNumbers, first_path: int, count: int) -> U32:
    """The camera rays of paths first_path .. first_path + count - 1 as records uint32[count, 9]."""
    rays = np.empty((count, RAY_WORDS), np.uint32)
    in_turn = np.arange(count + LANES, dtype=np.uint32)
    generate_pass(numbers, np.int64(first_path), in_turn, rays, np.empty(SCRATCH_WORDS, np.uint32))
    return rays


def path_rays(rays: U32, paths: int) -> PathRays:
    """Camera and bounce rays of a batch uint32[n, 9] of a pass of so many paths.

    What is no number, and what names a path that the pass does not have, is left out: peers may be faulty.
    """
    records = np.ascontiguousarray(rays).view(PATH_RAY).reshape(-1)
    kinds = records["kind"] & 7
    usable = ((kinds == KIND_CAMERA) | (kinds == KIND_BOUNCE)) & np.isfinite(records["origin"]).all(axis=1) & (records["path"] < paths)
    rows = np.flatnonzero(usable)
    chosen = records[rows]
    return PathRays(
        rows,
        chosen["origin"].astype(np.float64),
        _directions(chosen["direction"].view("<i4").astype(np.float64)),
        _colors(chosen["throughput"]),
        chosen["path"].astype(np.int64),
        kinds[rows] == KIND_CAMERA,
        (chosen["kind"] >> 3).astype(np.int64),
    )


def _directions(codes: F64) -> F64:
    """Octahedral: signed codes, float64[n, 2], to unit vectors float64[n, 3]."""
    u, v = (codes / _CODES).T
    z = 1.0 - np.abs(u) - np.abs(v)
    x = np.where(z < 0.0, (1.0 - np.abs(v)) * np.where(u < 0.0, -1.0, 1.0), u)
    y = np.where(z < 0.0, (1.0 - np.abs(u)) * np.where(v < 0.0, -1.0, 1.0), v)
    vectors = np.stack([x, y, z], axis=1)
    result: F64 = vectors / np.sqrt((vectors**2).sum(axis=1, keepdims=True))
    return result


def _colors(codes: npt.NDArray[np.uint8]) -> F64:
    """48 bits, uint8[n, 6], to float64[n, 3]."""
    words = np.zeros((len(codes), 8), np.uint8)
    words[:, :6] = codes
    whole = words.view("<u8").reshape(-1)
    scale = np.ldexp(1.0, (whole >> np.uint64(39)).astype(np.int32) - 256 - 13)
    mantissas = np.stack([(whole >> np.uint64(13 * channel)) & np.uint64(0x1FFF) for channel in range(3)], axis=1)
    result: F64 = mantissas * scale[:, None]
    return result
