"""Mitsuba's own sensor and integrator for a job: what a comparison takes, so that nothing of ours decides where rays begin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import JobNumbers
from scenefold.render.renderers.mitsuba.library import Mitsuba


def integrator_of(mitsuba: Mitsuba, numbers: JobNumbers) -> Any:
    """Path tracing with next-event estimation through surfaces that let light pass. LocalFault for a job that clamps: Mitsuba does not."""
    if min(numbers.clamp_direct, numbers.clamp_indirect) < math.inf:
        raise LocalFault("mitsuba does not clamp contributions", remedy="render without clamps, or with embree")
    return mitsuba.mi.load_dict({"type": "volpath", "max_depth": numbers.depth, "rr_depth": numbers.roulette_from})


def sensor_of(mitsuba: Mitsuba, numbers: JobNumbers) -> Any:
    """The job's camera with a film of its size, box filter, independent samples. LocalFault for an orthographic one with a lens: Mitsuba has none."""
    mi = mitsuba.mi
    camera = numbers.camera
    position, up, forward = camera[0:3], camera[6:9], camera[9:12]
    film = {
        "type": "hdrfilm",
        "width": numbers.width,
        "height": numbers.height,
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    look = mi.ScalarTransform4f().look_at(position.tolist(), (position + forward).tolist(), up.tolist())
    common = {"film": film, "sampler": {"type": "independent"}}
    if camera[14] == 0.0:
        degrees = float(np.degrees(2.0 * np.arctan(camera[13])))
        lens = {"fov": degrees, "fov_axis": "y", "near_clip": 1e-4 * _diagonal(numbers), "far_clip": 1e4 * _diagonal(numbers)}
        if camera[15] == 0.0:
            return mi.load_dict({"type": "perspective", "to_world": look, **lens, **common})
        blur = {"aperture_radius": float(camera[15]), "focus_distance": float(camera[16])}
        return mi.load_dict({"type": "thinlens", "to_world": look, **lens, **blur, **common})
    if camera[15] > 0.0:
        raise LocalFault("Mitsuba has no orthographic camera with a lens", remedy="choose a perspective camera")
    # Mitsuba's view is 2 wide before `scale`; a film that is not square is as high as its shape makes it.
    scaled = look @ mi.ScalarTransform4f().scale([float(camera[12]), float(camera[12]), 1.0])
    return mi.load_dict({"type": "orthographic", "to_world": scaled, "near_clip": 0.0, "far_clip": 1e4 * _diagonal(numbers), **common})


def _diagonal(numbers: JobNumbers) -> float:
    return float(np.linalg.norm(numbers.box_high - numbers.box_low))
