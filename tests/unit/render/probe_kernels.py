"""Loops over the render kernels' scalar functions, so that tests can call them on arrays."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from scenefold.render import (
    bsdf_kernels,
    clear_coat_kernels,
    energy_kernels,
    light_kernels,
    metallic_roughness_kernels,
    precise_kernels,
    record_kernels,
    space_kernels,
    texture_kernels,
)

_sine_cosine, _log2, _exp2, _power, _path_key = (
    precise_kernels.sine_cosine_of,
    precise_kernels.log2_of,
    precise_kernels.exp2_of,
    precise_kernels.power_of,
    precise_kernels.path_key,
)
_box_span, _t_of_step, _step_after, _offset = (
    space_kernels.box_span,
    space_kernels.t_of_step,
    space_kernels.step_after,
    space_kernels.offset_origin,
)
_sample_texture = texture_kernels.sample_texture
_surface, _evaluate = metallic_roughness_kernels.metallic_roughness, metallic_roughness_kernels.evaluate
_coat, _coated, _sample_coat = clear_coat_kernels.coat_of, clear_coat_kernels.coated, clear_coat_kernels.sample_coat
_rough, _albedo = energy_kernels.rough_of, energy_kernels.albedo_of
_visible_normal, _cosine, _frame = (
    bsdf_kernels.sample_visible_normal,
    bsdf_kernels.sample_cosine,
    bsdf_kernels.frame_of,
)
_emitter_pdf = light_kernels.emitter_pdf
_kind_of, _t_done_of, _path_of, _color_of, _origin_of, _end_of, _set_t_done, _keep = (
    record_kernels.kind_of,
    record_kernels.t_done_of,
    record_kernels.path_of,
    record_kernels.color_code_of,
    record_kernels.origin_of,
    record_kernels.end_of,
    record_kernels.set_t_done,
    record_kernels.keep_channels,
)


@njit(cache=True, error_model="numpy")
def elementary(x: Any, turns: Any) -> Any:
    """[n, 4]: sine and cosine of turns, log2 of x, and powers of two from 2^-1000 to 2^1000 by turns."""
    out = np.empty((x.size, 4))
    for i in range(x.size):
        out[i, 0], out[i, 1] = _sine_cosine(turns[i])
        out[i, 2], out[i, 3] = _log2(x[i]), _exp2(turns[i] * 2000.0 - 1000.0)
    return out


@njit(cache=True, error_model="numpy")
def powers(base: Any, exponent: Any) -> Any:
    """base^exponent"""
    out = np.empty(base.size)
    for i in range(base.size):
        out[i] = _power(base[i], exponent[i])
    return out


@njit(cache=True, error_model="numpy")
def path_keys(seed: Any, frame: Any, pixels: Any, samples: Any) -> Any:
    """uint64[n]"""
    out = np.empty(pixels.size, np.uint64)
    for i in range(pixels.size):
        out[i] = _path_key(seed, frame, pixels[i], samples[i])
    return out


@njit(cache=True, error_model="numpy")
def read_fields(rays: Any, i: Any) -> Any:
    """(kind, step, path, colour code, origin, end)"""
    return _kind_of(rays, i), _t_done_of(rays, i), _path_of(rays, i), _color_of(rays, i), _origin_of(rays, i), _end_of(rays, i)


@njit(cache=True, error_model="numpy")
def set_t_done(rays: Any, i: Any, step: Any) -> None:
    """Write a ray's certificate."""
    _set_t_done(rays, i, step)


@njit(cache=True, error_model="numpy")
def keep_channels(rays: Any, i: Any, channels: Any) -> Any:
    """Whether anything is left of the colour with these channels alone."""
    return _keep(rays, i, channels)


@njit(cache=True, error_model="numpy")
def spans(origins: Any, ways: Any, low: Any, high: Any) -> Any:
    """f64[n, 2]: t_in, t_out"""
    out = np.empty((origins.shape[0], 2))
    for i in range(origins.shape[0]):
        o, d = origins[i], ways[i]
        out[i, 0], out[i, 1] = _box_span(o[0], o[1], o[2], d[0], d[1], d[2], low, high)
    return out


@njit(cache=True, error_model="numpy")
def next_step(t: Any, t_in: Any, t_out: Any, step: Any) -> Any:
    """(the step after t, where it lies)"""
    following = _step_after(t, t_in, t_out, step)
    return following, _t_of_step(following, t_in, t_out)


@njit(cache=True, error_model="numpy")
def place_of_step(step: Any, t_in: Any, t_out: Any) -> Any:
    """Where a step lies."""
    return _t_of_step(step, t_in, t_out)


@njit(cache=True, error_model="numpy")
def offsets(points: Any, normals: Any, diagonal: Any) -> Any:
    """f32[n, 3]"""
    out = np.empty((points.shape[0], 3), np.float32)
    for i in range(points.shape[0]):
        p, n = points[i], normals[i]
        out[i, 0], out[i, 1], out[i, 2] = _offset(p[0], p[1], p[2], n[0], n[1], n[2], diagonal)
    return out


@njit(cache=True, error_model="numpy")
def texture_samples(textures: Any, texels: Any, linear_of_srgb: Any, texture: Any, uvs: Any, wrap_s: Any, wrap_t: Any, nearest: Any) -> Any:
    """f64[n, 4]"""
    out = np.empty((uvs.shape[0], 4))
    for i in range(uvs.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = _sample_texture(
            textures, texels, linear_of_srgb, texture, uvs[i, 0], uvs[i, 1], wrap_s, wrap_t, nearest
        )
    return out


@njit(cache=True, error_model="numpy")
def frames(normals: Any) -> Any:
    """f64[n, 2, 3]"""
    out = np.empty((normals.shape[0], 2, 3))
    for i in range(normals.shape[0]):
        n = normals[i]
        out[i, 0, 0], out[i, 0, 1], out[i, 0, 2], out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = _frame(n[0], n[1], n[2])
    return out


@njit(cache=True, error_model="numpy")
def evaluations(wo: Any, wi: Any, base: Any, metallic: Any, alpha: Any, reflection: Any, transmission: Any) -> Any:
    """f64[n, 4]: value and density for directions f64[n, 3], towards f64[n, 3]."""
    out = np.empty((wi.shape[0], 4))
    for i in range(wi.shape[0]):
        seen = _surface(wo[i, 0], wo[i, 1], wo[i, 2], base[0], base[1], base[2], metallic, alpha, reflection, transmission)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = _evaluate(seen, wi[i, 0], wi[i, 1], wi[i, 2])
    return out


@njit(cache=True, error_model="numpy")
def scattered(wo: Any, base: Any, metallic: Any, alpha: Any, reflection: Any, transmission: Any, numbers: Any) -> Any:
    """Directions f64[n, 3] drawn as the shader does, from f64[n, 3]: lobe, u, v."""
    out = np.empty((numbers.shape[0], 3))
    seen = _surface(wo[0], wo[1], wo[2], base[0], base[1], base[2], metallic, alpha, reflection, transmission)
    for i in range(numbers.shape[0]):
        u, v = numbers[i, 1], numbers[i, 2]
        if numbers[i, 0] < seen.pick:
            hx, hy, hz = _visible_normal(wo[0], wo[1], wo[2], alpha, u, v)
            cosine = 2.0 * (wo[0] * hx + wo[1] * hy + wo[2] * hz)
            out[i, 0], out[i, 1], out[i, 2] = cosine * hx - wo[0], cosine * hy - wo[1], cosine * hz - wo[2]
        else:
            out[i, 0], out[i, 1], out[i, 2] = _cosine(u, v)
    return out


@njit(error_model="numpy", forceinline=True)
def _coat_over(strength: Any, alpha: Any, normal: Any, wo: Any) -> Any:
    # Never hand an array to what returns it within a tuple: render kernels count no references, so these loops would give back one too many.
    upright = (normal[0], normal[1], normal[2])
    return _coat(strength, alpha, normal[0], normal[1], normal[2], -wo[0], -wo[1], -wo[2], upright)


@njit(cache=True, error_model="numpy")
def coated_evaluations(strength: Any, alpha: Any, normal: Any, wo: Any, wi: Any, below: Any) -> Any:
    """f64[n, 2]: value times cosine and density of a coat over Lambert of this albedo, whose normal is z."""
    out = np.empty((wi.shape[0], 2))
    coat = _coat_over(strength, alpha, normal, wo)
    for i in range(wi.shape[0]):
        x, y, z = wi[i, 0], wi[i, 1], wi[i, 2]
        f = below / np.pi if z > 0.0 else 0.0
        value, _, _, pdf, cosine = _coated(coat, x, y, z, f, f, f, max(z, 0.0) / np.pi, z)
        out[i, 0], out[i, 1] = value * cosine, pdf
    return out


@njit(cache=True, error_model="numpy")
def coat_scattered(strength: Any, alpha: Any, normal: Any, wo: Any, numbers: Any) -> Any:
    """Directions f64[n, 3] of the same, from f64[n, 3]; (0, 0, 0) where one leaves the coat downwards."""
    out = np.zeros((numbers.shape[0], 3))
    coat = _coat_over(strength, alpha, normal, wo)
    for i in range(numbers.shape[0]):
        lobe, u, v = numbers[i, 0], numbers[i, 1], numbers[i, 2]
        if lobe < coat.pick:
            x, y, z, leaves = _sample_coat(coat, lobe / coat.pick, u, v)
            if leaves:
                out[i, 0], out[i, 1], out[i, 2] = x, y, z
        else:
            out[i, 0], out[i, 1], out[i, 2] = _cosine(u, v)
    return out


@njit(cache=True, error_model="numpy")
def albedos(alpha: Any, cosines: Any) -> Any:
    """f64[n, 4]: what a single bounce misses, the grazing part, and their means."""
    out = np.empty((cosines.shape[0], 4))
    rough = _rough(alpha)
    for i in range(cosines.shape[0]):
        out[i, 0], out[i, 1] = _albedo(rough, cosines[i])
        out[i, 2], out[i, 3] = rough.missing, rough.grazing
    return out


@njit(cache=True, error_model="numpy")
def emitter_density(job: Any, radiance: Any, squared: Any, cosine: Any) -> Any:
    """The density with which a point of an emitter is sampled."""
    return _emitter_pdf(job, radiance[0], radiance[1], radiance[2], squared, cosine)
