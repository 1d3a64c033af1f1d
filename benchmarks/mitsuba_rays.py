"""How many rays Mitsuba's path integrator casts for a path: its rules once more, as an integrator that counts in place of light.

A path goes on while it has met less than `depth` surfaces, is not absorbed and survives roulette, as Mitsuba documents them (`path`).
At each surface but the last one ray asks for a light, unless the light's sample is worth nothing anyway.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scenefold.render.renderers.mitsuba.library import Mitsuba

SAMPLES = 8
"""A pixel: the count needs no quiet image."""
_SURVIVAL_MAX = 0.95


def rays_per_path(mitsuba: Mitsuba, scene: Any, sensor: Any, depth: int, roulette_from: int) -> float | None:
    """Segments and shadow rays, the mean of all paths of an image; None with a variant that goes ray by ray."""
    if not mitsuba.is_wavefront:
        return None
    mi, dr = mitsuba.mi, mitsuba.dr
    width, height = (int(side) for side in sensor.film().crop_size())
    count = width * height * SAMPLES
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    index = dr.arange(mi.UInt32, count) // SAMPLES
    place = mi.Point2f(mi.Float(index % width), mi.Float(index // width)) + sampler.next_2d()
    ray, _ = sensor.sample_ray(0.0, 0.0, place / mi.Point2f(float(width), float(height)), mi.Point2f(0.5))
    active, throughput, rays = mi.Bool(True), mi.Spectrum(1.0), mi.UInt32(0)
    dr.make_opaque(active, throughput, rays)
    context = mi.BSDFContext()
    for met in range(depth):
        si = scene.ray_intersect(ray, active)
        rays += dr.select(active, mi.UInt32(1), mi.UInt32(0))
        active &= si.is_valid()
        if met + 1 >= depth:
            break
        bsdf = si.bsdf(ray)
        asks = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        lamp, _ = scene.sample_emitter_direction(si, sampler.next_2d(), test_visibility=False, active=asks)
        rays += dr.select(asks & (lamp.pdf > 0.0), mi.UInt32(1), mi.UInt32(0))
        sample, weight = bsdf.sample(context, si, sampler.next_1d(), sampler.next_2d(), active)
        throughput *= dr.select(active, weight, mi.Spectrum(1.0))
        brightest = dr.max(throughput)
        active &= brightest > 0.0
        if met + 1 >= roulette_from:
            survives = dr.minimum(brightest, _SURVIVAL_MAX)
            active &= sampler.next_1d() < survives
            throughput *= dr.select(active, dr.rcp(dr.maximum(survives, 1e-6)), mi.Float(1.0))
        ray = si.spawn_ray(si.to_world(sample.wo))
        dr.eval(ray, active, throughput, rays)
    return float(np.array(rays, np.float64).mean())
