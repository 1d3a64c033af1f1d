"""Loops over the render kernels' scalar functions, so that tests can call them on arrays."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from scenefold.render import bsdf_kernels, light_kernels, math_kernels, record_kernels, space_kernels, texture_kernels

_sine_cosine, _log2, _exp2, _power = (
    math_kernels.sine_cosine_of_turns,
    math_kernels.log2_of,
    math_kernels.exp2_of,
    math_kernels.power_of,
)
_encode_direction, _decode_direction = math_kernels.encode_direction, math_kernels.decode_direction
_encode_color, _decode_color = math_kernels.encode_color, math_kernels.decode_color
_encode_pdf, _decode_pdf = math_kernels.encode_pdf, math_kernels.decode_pdf
_uniform, _path_key = math_kernels.uniform, math_kernels.path_key
_box_span, _t_of_step, _step_after, _offset = (
    space_kernels.box_span,
    space_kernels.t_of_step,
    space_kernels.step_after,
    space_kernels.offset_origin,
)
_sample_texture = texture_kernels.sample_texture
_evaluate, _visible_normal, _cosine, _frame = (
    bsdf_kernels.evaluate,
    bsdf_kernels.sample_visible_normal,
    bsdf_kernels.sample_cosine,
    bsdf_kernels.frame_of,
)
_sample_light, _emitter_pdf = light_kernels.sample_light, light_kernels.emitter_pdf
_write_path_ray, _write_shadow_ray = record_kernels.write_path_ray, record_kernels.write_shadow_ray
_kind_of, _bounce_of, _t_done_of, _path_of = (
    record_kernels.kind_of,
    record_kernels.bounce_of,
    record_kernels.t_done_of,
    record_kernels.path_of,
)
_color_of, _pdf_of, _origin_of, _end_of, _set_t_done = (
    record_kernels.color_code_of,
    record_kernels.pdf_code_of,
    record_kernels.origin_of,
    record_kernels.end_of,
    record_kernels.set_t_done,
)


@njit(cache=True, error_model="numpy")
def elementary(x: Any, turns: Any) -> Any:
    """[n, 4]: sine and cosine of turns, log2 and exp2 of x."""
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
def direction_codes(vectors: Any) -> Any:
    """uint32[n, 2]"""
    out = np.empty((vectors.shape[0], 2), np.uint32)
    for i in range(vectors.shape[0]):
        out[i, 0], out[i, 1] = _encode_direction(vectors[i, 0], vectors[i, 1], vectors[i, 2])
    return out


@njit(cache=True, error_model="numpy")
def directions(codes: Any) -> Any:
    """f64[n, 3]"""
    out = np.empty((codes.shape[0], 3))
    for i in range(codes.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = _decode_direction(codes[i, 0], codes[i, 1])
    return out


@njit(cache=True, error_model="numpy")
def color_codes(colors: Any, keys: Any) -> Any:
    """uint64[n] of f64[n, 3], rounded with these keys."""
    out = np.empty(keys.size, np.uint64)
    for i in range(keys.size):
        out[i] = _encode_color(colors[i, 0], colors[i, 1], colors[i, 2], keys[i], 3, 8)
    return out


@njit(cache=True, error_model="numpy")
def colors(codes: Any) -> Any:
    """f64[n, 3]"""
    out = np.empty((codes.size, 3))
    for i in range(codes.size):
        out[i, 0], out[i, 1], out[i, 2] = _decode_color(codes[i])
    return out


@njit(cache=True, error_model="numpy")
def pdf_codes(densities: Any) -> Any:
    """int64[n]"""
    out = np.empty(densities.size, np.int64)
    for i in range(densities.size):
        out[i] = _encode_pdf(densities[i])
    return out


@njit(cache=True, error_model="numpy")
def pdfs(codes: Any) -> Any:
    """f64[n]"""
    out = np.empty(codes.size)
    for i in range(codes.size):
        out[i] = _decode_pdf(codes[i])
    return out


@njit(cache=True, error_model="numpy")
def path_keys(seed: Any, frame: Any, pixels: Any, samples: Any) -> Any:
    """uint64[n]"""
    out = np.empty(pixels.size, np.uint64)
    for i in range(pixels.size):
        out[i] = _path_key(seed, frame, pixels[i], samples[i])
    return out


@njit(cache=True, error_model="numpy")
def uniforms(keys: Any, bounce: Any, dimension: Any) -> Any:
    """f64[n]"""
    out = np.empty(keys.size)
    for i in range(keys.size):
        out[i] = _uniform(keys[i], bounce, dimension)
    return out


@njit(cache=True, error_model="numpy")
def write_path(rays: Any, i: Any, origin: Any, codes: Any, pdf: Any, color: Any, path: Any, kind: Any, bounce: Any, step: Any) -> Any:
    """Write one path ray."""
    _write_path_ray(rays, i, origin[0], origin[1], origin[2], codes[0], codes[1], pdf, color, path, kind, bounce, step)


@njit(cache=True, error_model="numpy")
def write_shadow(rays: Any, i: Any, origin: Any, end: Any, color: Any, path: Any, kind: Any, bounce: Any, step: Any) -> Any:
    """Write one shadow ray, and its step after that."""
    _write_shadow_ray(rays, i, origin[0], origin[1], origin[2], end[0], end[1], end[2], color, path, kind, bounce)
    _set_t_done(rays, i, step)


@njit(cache=True, error_model="numpy")
def read_fields(rays: Any, i: Any) -> Any:
    """(kind, bounce, step, path, colour code, pdf code, origin, end)"""
    return (
        _kind_of(rays, i),
        _bounce_of(rays, i),
        _t_done_of(rays, i),
        _path_of(rays, i),
        _color_of(rays, i),
        _pdf_of(rays, i),
        _origin_of(rays, i),
        _end_of(rays, i),
    )


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
def evaluations(wo: Any, wi: Any, base: Any, metallic: Any, alpha: Any, f0: Any, transmission: Any, choose_coat: Any) -> Any:
    """f64[n, 4]: value and density for directions f64[n, 3], towards f64[n, 3]."""
    out = np.empty((wi.shape[0], 4))
    for i in range(wi.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = _evaluate(
            wo[i, 0],
            wo[i, 1],
            wo[i, 2],
            wi[i, 0],
            wi[i, 1],
            wi[i, 2],
            base[0],
            base[1],
            base[2],
            metallic,
            alpha,
            f0,
            transmission,
            choose_coat,
        )
    return out


@njit(cache=True, error_model="numpy")
def scattered(wo: Any, alpha: Any, choose_coat: Any, numbers: Any) -> Any:
    """Directions f64[n, 3] drawn as the shader does, from f64[n, 3]: lobe, u, v."""
    out = np.empty((numbers.shape[0], 3))
    for i in range(numbers.shape[0]):
        u, v = numbers[i, 1], numbers[i, 2]
        if numbers[i, 0] < choose_coat:
            hx, hy, hz = _visible_normal(wo[0], wo[1], wo[2], alpha, u, v)
            cosine = 2.0 * (wo[0] * hx + wo[1] * hy + wo[2] * hz)
            out[i, 0], out[i, 1], out[i, 2] = cosine * hx - wo[0], cosine * hy - wo[1], cosine * hz - wo[2]
        else:
            out[i, 0], out[i, 1], out[i, 2] = _cosine(u, v)
    return out


@njit(cache=True, error_model="numpy")
def light_samples(scene: Any, job: Any, keys: Any, point: Any, normal: Any) -> Any:
    """f64[n, 11]: found, direction, end, radiance by probability, density."""
    out = np.empty((keys.size, 11))
    for i in range(keys.size):
        found, wx, wy, wz, ex, ey, ez, r, g, b, pdf = _sample_light(
            scene, job, keys[i], 2, point[0], point[1], point[2], normal[0], normal[1], normal[2]
        )
        out[i, 0] = 1.0 if found else 0.0
        out[i, 1], out[i, 2], out[i, 3], out[i, 4], out[i, 5], out[i, 6] = wx, wy, wz, ex, ey, ez
        out[i, 7], out[i, 8], out[i, 9], out[i, 10] = r, g, b, pdf
    return out


@njit(cache=True, error_model="numpy")
def emitter_density(job: Any, radiance: Any, squared: Any, cosine: Any) -> Any:
    """The density with which a point of an emitter is sampled."""
    return _emitter_pdf(job, radiance[0], radiance[1], radiance[2], squared, cosine)
