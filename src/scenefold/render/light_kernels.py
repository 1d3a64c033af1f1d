"""Next-event estimation: one light sample for a shaded point, and the matching density when a path hits a light.

The choice among sky, punctual lights and emitters depends on the job alone, the choice of an emitter on its
power: so the node where a path later finds the emitter can tell the same density from what it sees there.
"""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.arrays import LightColumn
from scenefold.render.bsdf_kernels import frame_of, luminance
from scenefold.render.math_kernels import INVERSE_PI, sine_cosine_of_turns, uniform
from scenefold.render.space_kernels import box_span, diagonal_of_box, offset_origin

DIMENSION_CHOICE = 3
DIMENSION_POINT_U = 4
DIMENSION_POINT_V = 5
DIMENSION_ALIAS = 6

_KIND, _POSITION, _DIRECTION, _COLOR = LightColumn.KIND, LightColumn.POSITION, LightColumn.DIRECTION, LightColumn.COLOR
_COS_INNER, _COS_OUTER, _PROBABILITY = LightColumn.COS_INNER, LightColumn.COS_OUTER, LightColumn.PROBABILITY


@njit(error_model="numpy", _nrt=False)
def sky_pdf(job):  # type: ignore[no-untyped-def]
    """Density per steradian with which next-event estimation asks for a sky direction above the surface."""
    return job.choose_sky * 0.5 * INVERSE_PI


@njit(error_model="numpy", _nrt=False)
def emitter_pdf(job, radiance_r, radiance_g, radiance_b, squared_distance, cosine):  # type: ignore[no-untyped-def]
    """Density per steradian of sampling a point of an emitter that is seen at this distance and cosine.

    Emitters are chosen by luminance x area, points uniformly by area: the area cancels.
    """
    power = luminance(radiance_r, radiance_g, radiance_b) * job.inverse_emitter_power
    return job.choose_emitter * power * squared_distance / cosine


@njit(error_model="numpy", _nrt=False)
def _far_end(px, py, pz, dx, dy, dz, job):  # type: ignore[no-untyped-def]
    """Where a direction leaves the job's box: the end of a shadow ray towards something infinitely far."""
    _, t_out = box_span(px, py, pz, dx, dy, dz, job.box_low, job.box_high)
    return px + dx * t_out, py + dy * t_out, pz + dz * t_out


@njit(error_model="numpy", _nrt=False)
def sample_light(scene, job, key, bounce, px, py, pz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """A light sample for the point p whose geometric normal (to the viewer's side) is n.

    Returns (found, wx, wy, wz, end x, y, z, r, g, b, pdf): unit direction, end point of the shadow ray,
    radiance divided by the sample's probability, and the density per steradian for multiple importance
    sampling (0 for lights that no other technique can find).
    """
    choice = uniform(key, bounce, DIMENSION_CHOICE)
    u, v = uniform(key, bounce, DIMENSION_POINT_U), uniform(key, bounce, DIMENSION_POINT_V)
    nothing = (False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if choice < job.choose_sky:
        s, c = sine_cosine_of_turns(v)
        r = math.sqrt(max(0.0, 1.0 - u * u))
        ax, ay, az, bx, by, bz = frame_of(nx, ny, nz)
        x, y, z = r * c, r * s, u
        wx, wy, wz = x * ax + y * bx + z * nx, x * ay + y * by + z * ny, x * az + y * bz + z * nz
        ex, ey, ez = _far_end(px, py, pz, wx, wy, wz, job)
        pdf = sky_pdf(job)
        return True, wx, wy, wz, ex, ey, ez, job.sky[0] / pdf, job.sky[1] / pdf, job.sky[2] / pdf, pdf
    choice -= job.choose_sky
    if choice < job.choose_punctual:
        return _sample_punctual(scene, job, choice / job.choose_punctual, px, py, pz)
    if not job.choose_emitter > 0.0:
        return nothing
    return _sample_emitter(scene, job, uniform(key, bounce, DIMENSION_ALIAS), u, v, px, py, pz)


@njit(error_model="numpy", _nrt=False)
def _sample_punctual(scene, job, choice, px, py, pz):  # type: ignore[no-untyped-def]
    lights = scene.punctual_lights
    last = lights.shape[0] - 1
    index = 0
    while index < last and choice >= lights[index, _PROBABILITY]:
        choice -= lights[index, _PROBABILITY]
        index += 1
    weight = 1.0 / (lights[index, _PROBABILITY] * job.choose_punctual)
    r, g, b = lights[index, _COLOR] * weight, lights[index, _COLOR + 1] * weight, lights[index, _COLOR + 2] * weight
    lx, ly, lz = lights[index, _DIRECTION], lights[index, _DIRECTION + 1], lights[index, _DIRECTION + 2]
    if lights[index, _KIND] == 2.0:
        ex, ey, ez = _far_end(px, py, pz, -lx, -ly, -lz, job)
        return True, -lx, -ly, -lz, ex, ey, ez, r, g, b, 0.0
    ex, ey, ez = lights[index, _POSITION], lights[index, _POSITION + 1], lights[index, _POSITION + 2]
    wx, wy, wz = ex - px, ey - py, ez - pz
    squared = wx * wx + wy * wy + wz * wz
    if not squared > 1e-20:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    scale = 1.0 / math.sqrt(squared)
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    falloff = 1.0 / squared
    if lights[index, _KIND] == 1.0:
        cosine = -(wx * lx + wy * ly + wz * lz)
        inner, outer = lights[index, _COS_INNER], lights[index, _COS_OUTER]
        angular = min(max((cosine - outer) / max(inner - outer, 1e-3), 0.0), 1.0)
        falloff *= angular * angular
    return True, wx, wy, wz, ex, ey, ez, r * falloff, g * falloff, b * falloff, 0.0


@njit(error_model="numpy", _nrt=False)
def _sample_emitter(scene, job, alias, u, v, px, py, pz):  # type: ignore[no-untyped-def]
    nothing = (False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    count = scene.emitter_threshold.shape[0]
    scaled = alias * count
    index = min(int(scaled), count - 1)
    if scaled - index >= scene.emitter_threshold[index]:
        index = int(scene.emitter_alias[index])
    corner = scene.emitter_vertices[index]
    root = math.sqrt(u)
    b0, b1 = 1.0 - root, root * (1.0 - v)
    b2 = 1.0 - b0 - b1
    x0, y0, z0 = float(corner[0, 0]), float(corner[0, 1]), float(corner[0, 2])
    e1x, e1y, e1z = corner[1, 0] - x0, corner[1, 1] - y0, corner[1, 2] - z0
    e2x, e2y, e2z = corner[2, 0] - x0, corner[2, 1] - y0, corner[2, 2] - z0
    ex, ey, ez = x0 + b1 * e1x + b2 * e2x, y0 + b1 * e1y + b2 * e2y, z0 + b1 * e1z + b2 * e2z
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    double_area = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not double_area > 1e-30:
        return nothing
    nx, ny, nz = nx / double_area, ny / double_area, nz / double_area
    wx, wy, wz = ex - px, ey - py, ez - pz
    squared = wx * wx + wy * wy + wz * wz
    if not squared > 1e-20:
        return nothing
    scale = 1.0 / math.sqrt(squared)
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    cosine = -(wx * nx + wy * ny + wz * nz)
    if cosine < 0.0 and scene.emitter_two_sided[index] != 0:
        cosine, nx, ny, nz = -cosine, -nx, -ny, -nz
    if not cosine > 1e-6:
        return nothing
    radiance = scene.emitter_radiance[index]
    r, g, b = float(radiance[0]), float(radiance[1]), float(radiance[2])
    pdf = emitter_pdf(job, r, g, b, squared, cosine)
    if not pdf > 1e-30:
        return nothing
    # The end point lies a little in front of the emitter, so that the emitter does not shadow itself.
    sx, sy, sz = offset_origin(ex, ey, ez, nx, ny, nz, diagonal_of_box(job.box_low, job.box_high))
    return True, wx, wy, wz, float(sx), float(sy), float(sz), r / pdf, g / pdf, b / pdf, pdf
