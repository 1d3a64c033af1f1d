"""What a camera ray meets first: albedo, normal and depth for the film's layers (specs/08-passes.md, *Sums of a pass*)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.arrays import F64, I32, JobNumbers
from scenefold.render.record_columns import PathRays
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.sum_columns import DEPTH_END

_UNIT = 2.0**24
_ALBEDO_MAX = 100.0


def note_first_hits(mitsuba: Mitsuba, scene: Any, numbers: JobNumbers, chosen: PathRays, aovs: I32) -> None:
    """Write the features of camera rays that hit something into int32[paths, 8]. Alpha and glass count as hit."""
    camera = np.flatnonzero(chosen.is_camera)
    if not len(camera) or not mitsuba.is_wavefront:
        return
    mi, dr = mitsuba.mi, mitsuba.dr
    ray = mi.Ray3f(mi.Point3f(chosen.origins[camera].T), mi.Vector3f(chosen.directions[camera].T))
    hit = scene.ray_intersect(ray)
    albedo = _rows(hit.bsdf().eval_diffuse_reflectance(hit, hit.is_valid()))
    normals, points = _rows(dr.select(dr.dot(hit.sh_frame.n, ray.d) > 0.0, -hit.sh_frame.n, hit.sh_frame.n)), _rows(hit.p)
    found = np.array(hit.is_valid(), np.bool_)
    rows = chosen.paths[camera][found]
    diagonal = float(np.linalg.norm(numbers.box_high - numbers.box_low))
    aovs[rows, 0:3] = _whole(np.minimum(albedo[found], _ALBEDO_MAX))
    aovs[rows, 3:6] = _whole(normals[found])
    aovs[rows, 6] = _whole(np.clip((_depths(numbers, points[found]) - numbers.camera[17]) / diagonal, 0.0, DEPTH_END))
    aovs[rows, 7] = 1


def _rows(vectors: Any) -> F64:
    """float64[n, 3] of Mitsuba's column-wise vectors."""
    return np.array(vectors, np.float64).reshape(3, -1).T


def _whole(values: F64) -> I32:
    return np.floor(values * _UNIT + 0.5).astype(np.int32)


def _depths(numbers: JobNumbers, points: F64) -> F64:
    """From the camera, or from its plane if it is orthographic."""
    away = points - numbers.camera[0:3]
    if numbers.camera[14] == 0.0:
        result: F64 = np.sqrt((away**2).sum(axis=1))
        return result
    along: F64 = np.maximum(away @ numbers.camera[9:12], 0.0)
    return along
