"""Next-event estimation: one light sample for a shaded point, and the matching density when a path hits a light.

The choice among sky, punctual lights and emitters depends on the job alone, the choice of an emitter on its
power: so the node where a path later finds the emitter can tell the same density from what it sees there.
Points are lanes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.arrays import LightColumn
from scenefold.render.bsdf_kernels import frame_of, luminance
from scenefold.render.dice_kernels import PAIR_LIGHT, PAIR_LIGHT_POINT, column_of, pair, pair_of_words, unit_of
from scenefold.render.environment_kernels import environment_at, sample_environment
from scenefold.render.lane_values_kernels import alike, any_lane, gather, opposite, real_of_whole, select
from scenefold.render.math_kernels import INVERSE_PI, decode_direction, sine_cosine_of_turns
from scenefold.render.space_kernels import box_span, offset_origin
from scenefold.render.surface_kernels import texture_of_uses

_KIND, _POSITION, _DIRECTION, _COLOR = LightColumn.KIND, LightColumn.POSITION, LightColumn.DIRECTION, LightColumn.COLOR
_COS_INNER, _COS_OUTER, _PROBABILITY = LightColumn.COS_INNER, LightColumn.COS_OUTER, LightColumn.PROBABILITY
_SPOT, _DIRECTIONAL = 1.0, 2.0


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sky_pdf(job):  # type: ignore[no-untyped-def]
    """Density per steradian with which next-event estimation asks for a sky direction above the surface."""
    return job.choose_sky * 0.5 * INVERSE_PI


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sky_at(scene, job, code_u, code_v):  # type: ignore[no-untyped-def]
    """(r, g, b, pdf): radiance of the environment from coded directions, and with which density next-event estimation asks for them."""
    if job.has_environment:
        wx, wy, wz = decode_direction(code_u, code_v)
        r, g, b, pdf = environment_at(scene, job, wx, wy, wz)
        return r, g, b, pdf * job.choose_sky
    example = real_of_whole(code_u)
    return alike(job.sky[0], example), alike(job.sky[1], example), alike(job.sky[2], example), alike(sky_pdf(job), example)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def emitter_pdf(job, radiance_r, radiance_g, radiance_b, squared_distance, cosine):  # type: ignore[no-untyped-def]
    """Density per steradian of sampling a point of an emitter that is seen at this distance and cosine.

    Emitters are chosen by luminance x area, points uniformly by area: the area cancels.
    """
    power = luminance(radiance_r, radiance_g, radiance_b) * (job.inverse_emitter_power * job.choose_emitter)
    return power * squared_distance / cosine


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _far_end(px, py, pz, dx, dy, dz, job):  # type: ignore[no-untyped-def]
    """Where a direction leaves the job's box: the end of a shadow ray towards something infinitely far."""
    _, t_out = box_span(px, py, pz, dx, dy, dz, job.box_low, job.box_high)
    return px + dx * t_out, py + dy * t_out, pz + dz * t_out


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _chosen(flag, sample, other):  # type: ignore[no-untyped-def]
    """Of two light samples one: the first where the flag is set."""
    return (
        select(flag, sample[0], other[0]),
        select(flag, sample[1], other[1]),
        select(flag, sample[2], other[2]),
        select(flag, sample[3], other[3]),
        select(flag, sample[4], other[4]),
        select(flag, sample[5], other[5]),
        select(flag, sample[6], other[6]),
        select(flag, sample[7], other[7]),
        select(flag, sample[8], other[8]),
        select(flag, sample[9], other[9]),
        select(flag, sample[10], other[10]),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_light(scene, job, dice, px, py, pz, nx, ny, nz, through, scratch):  # type: ignore[no-untyped-def]
    """A light sample for the point p whose geometric normal (to the viewer's side) is n; scratch: uint32[SCRATCH_WORDS] to work in.

    through: whether light from behind counts as well; where it does not, an even sky is asked above the surface only.

    Returns (found, wx, wy, wz, end x, y, z, r, g, b, pdf): unit direction, end point of the shadow ray,
    radiance divided by the sample's probability, and the density per steradian for multiple importance
    sampling (0 for lights that no other technique can find). Where nothing was found the rest means nothing.
    """
    choice, alias = pair_of_words(job, dice, PAIR_LIGHT)
    choice = unit_of(choice)
    u, v = pair(job, dice, PAIR_LIGHT_POINT)
    zero = alike(0.0, px)
    sample = (alike(False, px), zero, zero, zero, zero, zero, zero, zero, zero, zero, zero)
    to_sky = choice < job.choose_sky
    rest = choice - job.choose_sky
    to_punctual = (rest < job.choose_punctual) & opposite(to_sky)
    to_emitter = opposite(to_sky | to_punctual)
    if any_lane(to_sky):
        sample = _chosen(to_sky, _sample_sky(scene, job, u, v, px, py, pz, nx, ny, nz, through), sample)
    if any_lane(to_punctual):
        sample = _chosen(to_punctual, _sample_punctual(scene, job, rest / job.choose_punctual, px, py, pz), sample)
    if job.choose_emitter > 0.0 and any_lane(to_emitter):
        sample = _chosen(to_emitter, _sample_emitter(scene, job, alias, u, v, px, py, pz, scratch), sample)
    return sample


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _sample_sky(scene, job, u, v, px, py, pz, nx, ny, nz, through):  # type: ignore[no-untyped-def]
    if job.has_environment:
        wx, wy, wz, r, g, b, pdf = sample_environment(scene, job, u, v)
        pdf = pdf * job.choose_sky
        ex, ey, ez = _far_end(px, py, pz, wx, wy, wz, job)
        return pdf > 1e-30, wx, wy, wz, ex, ey, ez, r / pdf, g / pdf, b / pdf, pdf
    s, c = sine_cosine_of_turns(v)
    u, sides = select(through, 2.0 * u - 1.0, u), select(through, 2.0, 1.0)
    r = math.sqrt(max(0.0, 1.0 - u * u))
    ax, ay, az, bx, by, bz = frame_of(nx, ny, nz)
    x, y, z = r * c, r * s, u
    wx, wy, wz = x * ax + y * bx + z * nx, x * ay + y * by + z * ny, x * az + y * bz + z * nz
    ex, ey, ez = _far_end(px, py, pz, wx, wy, wz, job)
    # Where both sides are asked, either is half as often; weights go by the density of one, which is all that who finds the sky can know.
    pdf = sky_pdf(job)
    r, g, b = sides * (job.sky[0] / pdf), sides * (job.sky[1] / pdf), sides * (job.sky[2] / pdf)
    return alike(True, px), wx, wy, wz, ex, ey, ez, r, g, b, alike(pdf, px)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _sample_punctual(scene, job, choice, px, py, pz):  # type: ignore[no-untyped-def]
    lights = scene.punctual_lights
    last = lights.shape[0] - 1
    index = alike(np.uint32(0), px)
    goes_on = alike(True, px)
    for step in range(last):
        goes_on = goes_on & (choice >= lights[step, _PROBABILITY])
        if not any_lane(goes_on):
            break
        choice = select(goes_on, choice - lights[step, _PROBABILITY], choice)
        index = select(goes_on, np.uint32(step + 1), index)
    kind = gather(lights, (index, _KIND))
    weight = 1.0 / (gather(lights, (index, _PROBABILITY)) * job.choose_punctual)
    r, g, b = gather(lights, (index, _COLOR)), gather(lights, (index, _COLOR + 1)), gather(lights, (index, _COLOR + 2))
    r, g, b = r * weight, g * weight, b * weight
    lx, ly, lz = gather(lights, (index, _DIRECTION)), gather(lights, (index, _DIRECTION + 1)), gather(lights, (index, _DIRECTION + 2))
    ex, ey, ez = gather(lights, (index, _POSITION)), gather(lights, (index, _POSITION + 1)), gather(lights, (index, _POSITION + 2))
    wx, wy, wz = ex - px, ey - py, ez - pz
    squared = wx * wx + wy * wy + wz * wz
    scale = 1.0 / math.sqrt(squared)
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    falloff = 1.0 / squared
    cosine = -(wx * lx + wy * ly + wz * lz)
    inner, outer = gather(lights, (index, _COS_INNER)), gather(lights, (index, _COS_OUTER))
    angular = min(max((cosine - outer) / max(inner - outer, 1e-3), 0.0), 1.0)
    falloff = select(kind == _SPOT, falloff * (angular * angular), falloff)
    near = (squared > 1e-20, wx, wy, wz, ex, ey, ez, r * falloff, g * falloff, b * falloff, alike(0.0, px))
    is_far = kind == _DIRECTIONAL
    if not any_lane(is_far):
        return near
    ex, ey, ez = _far_end(px, py, pz, -lx, -ly, -lz, job)
    return _chosen(is_far, (alike(True, px), -lx, -ly, -lz, ex, ey, ez, r, g, b, alike(0.0, px)), near)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _sample_emitter(scene, job, alias, u, v, px, py, pz, scratch):  # type: ignore[no-untyped-def]
    index, rest = column_of(alias, scene.emitter_threshold.shape[0])
    kept = rest < gather(scene.emitter_threshold, (index,))
    index = select(kept, index, gather(scene.emitter_alias, (index,)))
    corners = scene.emitter_vertices
    root = math.sqrt(u)
    b0, b1 = 1.0 - root, root * (1.0 - v)
    b2 = 1.0 - b0 - b1
    x0, y0, z0 = gather(corners, (index, 0, 0)), gather(corners, (index, 0, 1)), gather(corners, (index, 0, 2))
    e1x, e1y, e1z = gather(corners, (index, 1, 0)) - x0, gather(corners, (index, 1, 1)) - y0, gather(corners, (index, 1, 2)) - z0
    e2x, e2y, e2z = gather(corners, (index, 2, 0)) - x0, gather(corners, (index, 2, 1)) - y0, gather(corners, (index, 2, 2)) - z0
    ex, ey, ez = x0 + b1 * e1x + b2 * e2x, y0 + b1 * e1y + b2 * e2y, z0 + b1 * e1z + b2 * e2z
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    double_area = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / double_area, ny / double_area, nz / double_area
    wx, wy, wz = ex - px, ey - py, ez - pz
    squared = wx * wx + wy * wy + wz * wz
    scale = 1.0 / math.sqrt(squared)
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    cosine = -(wx * nx + wy * ny + wz * nz)
    turned = (cosine < 0.0) & (gather(scene.emitter_two_sided, (index,)) != np.uint32(0))
    cosine, nx, ny, nz = select(turned, -cosine, cosine), select(turned, -nx, nx), select(turned, -ny, ny), select(turned, -nz, nz)
    radiance = scene.emitter_radiance
    r, g, b = gather(radiance, (index, 0)), gather(radiance, (index, 1)), gather(radiance, (index, 2))
    pdf = emitter_pdf(job, r, g, b, squared, cosine)
    found = (double_area > 1e-30) & (squared > 1e-20) & (cosine > 1e-6) & (pdf > 1e-30)
    if scene.has_emitter_maps:
        # The density is of the mean; what is sent out is the texel.
        uses = gather(scene.emitter_uses, (index,))
        mapped = uses >= 0.0
        if any_lane(mapped):
            tu, tv = _coordinates_at(scene, index, b0, b1, b2)
            tr, tg, tb, _ = texture_of_uses(scene, uses, (tu, tv, tu, tv, alike(0.0, tu), alike(0.0, tu)), scratch)
            emissive = scene.emitter_emissive
            r = select(mapped, tr * gather(emissive, (index, 0)), r)
            g = select(mapped, tg * gather(emissive, (index, 1)), g)
            b = select(mapped, tb * gather(emissive, (index, 2)), b)
    # The end point lies a little in front of the emitter, so that the emitter does not shadow itself.
    sx, sy, sz = offset_origin(ex, ey, ez, nx, ny, nz, gather(scene.emitter_reach, (index,)))
    return found, wx, wy, wz, sx, sy, sz, r / pdf, g / pdf, b / pdf, pdf


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _coordinates_at(scene, index, b0, b1, b2):  # type: ignore[no-untyped-def]
    """Texture coordinates of points of emitters, by their barycentric coordinates."""
    corners = scene.emitter_uvs
    return (
        b0 * gather(corners, (index, 0, 0)) + b1 * gather(corners, (index, 1, 0)) + b2 * gather(corners, (index, 2, 0)),
        b0 * gather(corners, (index, 0, 1)) + b1 * gather(corners, (index, 1, 1)) + b2 * gather(corners, (index, 2, 1)),
    )
