"""The generator: camera rays of one pass, in the scattered pixel order (thesis 3.3.3).

Path number n of a job is pixel (n mod P) x stride mod P and sample n div P, P pixels in all; stride is coprime
to P and near the golden ratio of it, so that consecutive paths lie far apart and every pass covers the image.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.base.rays import KIND_CAMERA, PDF_DELTA
from scenefold.render.math_kernels import decode_direction, encode_color, encode_direction, path_key, uniform
from scenefold.render.record_kernels import write_path_ray
from scenefold.render.space_kernels import box_span

DIMENSION_PIXEL_X = 16
DIMENSION_PIXEL_Y = 17


def scattering_stride(pixels: int) -> int:
    """The multiplier of the scattered order for this many pixels: coprime to it, near its golden section."""
    stride = max(1, int(pixels * 0.6180339887498949))
    while math.gcd(stride, pixels) != 1:
        stride += 1
    return stride


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def generate_pass(job, first_path, out):  # type: ignore[no-untyped-def]
    """Write the camera rays of paths first_path .. first_path + len(out) - 1 to out, uint32[n, 9].

    A ray is born where it enters the job's box: seen from a camera far away, single precision would not tell
    one surface from the next. One that misses the box altogether is born with t_done 65535.
    """
    pixels = job.width * job.height
    camera = job.camera
    white = encode_color(1.0, 1.0, 1.0, np.uint64(0), 0, 0)
    for i in range(out.shape[0]):
        number = first_path + i
        pixel = (number % pixels) * job.stride % pixels
        key = path_key(job.seed, job.frame, pixel, number // pixels)
        x = ((pixel % job.width) + uniform(key, 0, DIMENSION_PIXEL_X)) / job.width * 2.0 - 1.0
        y = 1.0 - ((pixel // job.width) + uniform(key, 0, DIMENSION_PIXEL_Y)) / job.height * 2.0
        x, y = x * camera[12], y * camera[13]
        ox, oy, oz = camera[0], camera[1], camera[2]
        dx, dy, dz = camera[9], camera[10], camera[11]
        if camera[14] == 0.0:
            dx, dy, dz = dx + x * camera[3] + y * camera[6], dy + x * camera[4] + y * camera[7], dz + x * camera[5] + y * camera[8]
        else:
            ox, oy, oz = ox + x * camera[3] + y * camera[6], oy + x * camera[4] + y * camera[7], oz + x * camera[5] + y * camera[8]
        code_u, code_v = encode_direction(dx, dy, dz)
        rx, ry, rz = decode_direction(code_u, code_v)
        t_in, t_out = box_span(ox, oy, oz, rx, ry, rz, job.box_low, job.box_high)
        if t_in <= t_out:
            ox, oy, oz = ox + rx * t_in, oy + ry * t_in, oz + rz * t_in
        fx, fy, fz = np.float32(ox), np.float32(oy), np.float32(oz)
        t_in, t_out = box_span(
            float(fx), float(fy), float(fz), float(np.float32(rx)), float(np.float32(ry)), float(np.float32(rz)), job.box_low, job.box_high
        )
        step = 0 if t_in <= t_out else 65535
        write_path_ray(out, i, fx, fy, fz, code_u, code_v, PDF_DELTA, white, i, KIND_CAMERA, 0, step)


@njit(error_model="numpy", _nrt=False)
def depth_of(job, px, py, pz):  # type: ignore[no-untyped-def]
    """How far a point is from the camera, or from its plane if the camera is orthographic."""
    camera = job.camera
    x, y, z = px - camera[0], py - camera[1], pz - camera[2]
    if camera[14] == 0.0:
        return math.sqrt(x * x + y * y + z * z)
    return max(x * camera[9] + y * camera[10] + z * camera[11], 0.0)
