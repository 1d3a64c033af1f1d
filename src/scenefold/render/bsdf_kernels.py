"""What surfaces are made of: Schlick's term, frames, the lobes of Lambert and GGX.

Directions are in the shading frame, z along the normal; `wo` and `wi` both point away from the surface. All functions take lanes, or numbers.
Sampling of visible normals after Heitz, Sampling the GGX Distribution of Visible Normals (JCGT 2018).
"""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.lane_values_kernels import select
from scenefold.render.math_kernels import INVERSE_PI, sine_cosine_of_turns


@njit(error_model="numpy", _nrt=False, forceinline=True)
def luminance(r, g, b):  # type: ignore[no-untyped-def]
    """Rec. 709 luminance of a linear colour."""
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


@njit(error_model="numpy", _nrt=False, forceinline=True)
def grazing_of(cosine):  # type: ignore[no-untyped-def]
    """(1 - cosine)^5."""
    m = min(max(1.0 - cosine, 0.0), 1.0)
    m2 = m * m
    return m2 * m2 * m


@njit(error_model="numpy", _nrt=False, forceinline=True)
def fresnel(f0, f90, cosine):  # type: ignore[no-untyped-def]
    """Schlick's approximation of reflectance at an angle, from that at normal incidence and at grazing angles; glTF prescribes it."""
    return f0 + (f90 - f0) * grazing_of(cosine)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def dielectric_reflection(ior, weight, r, g, b):  # type: ignore[no-untyped-def]
    """(red, green, blue at normal incidence, grazing) of KHR_materials_specular's weight and colour; 1 for both is a plain dielectric."""
    ratio = (ior - 1.0) / (ior + 1.0)
    f0 = ratio * ratio
    return min(f0 * r, 1.0) * weight, min(f0 * g, 1.0) * weight, min(f0 * b, 1.0) * weight, weight


@njit(error_model="numpy", _nrt=False, forceinline=True)
def frame_of(nx, ny, nz):  # type: ignore[no-untyped-def]
    """Two unit vectors that make a right-handed frame with the unit normal (Duff et al., JCGT 2017)."""
    sign = select(nz >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@njit(error_model="numpy", _nrt=False, forceinline=True)
def into_frame(frame, x, y, z):  # type: ignore[no-untyped-def]
    """A vector's coordinates in a frame: nine reals, three unit vectors."""
    return (
        x * frame[0] + y * frame[1] + z * frame[2],
        x * frame[3] + y * frame[4] + z * frame[5],
        x * frame[6] + y * frame[7] + z * frame[8],
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def out_of_frame(frame, x, y, z):  # type: ignore[no-untyped-def]
    """The vector that has these coordinates in the frame."""
    return (
        x * frame[0] + y * frame[3] + z * frame[6],
        x * frame[1] + y * frame[4] + z * frame[7],
        x * frame[2] + y * frame[5] + z * frame[8],
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_cosine(u, v):  # type: ignore[no-untyped-def]
    """A direction with density cos / pi."""
    s, c = sine_cosine_of_turns(v)
    r = math.sqrt(u)
    return r * c, r * s, math.sqrt(max(0.0, 1.0 - u))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_visible_normal(x, y, z, alpha, u, v):  # type: ignore[no-untyped-def]
    """A microfacet normal as seen from (x, y, z), z > 0."""
    sx, sy, sz = alpha * x, alpha * y, z
    scale = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx * scale, sy * scale, sz * scale
    flat = sx * sx + sy * sy
    tilted = flat > 1e-14
    inverse = 1.0 / math.sqrt(select(tilted, flat, 1.0))
    ax, ay, az = select(tilted, -sy * inverse, 1.0), select(tilted, sx * inverse, 0.0), 0.0
    bx, by, bz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    s, c = sine_cosine_of_turns(v)
    r = math.sqrt(u)
    p, q = r * c, r * s
    half = 0.5 * (1.0 + sz)
    q = (1.0 - half) * math.sqrt(max(0.0, 1.0 - p * p)) + half * q
    h = math.sqrt(max(0.0, 1.0 - p * p - q * q))
    nx, ny, nz = p * ax + q * bx + h * sx, p * ay + q * by + h * sy, p * az + q * bz + h * sz
    nx, ny, nz = alpha * nx, alpha * ny, max(1e-9, nz)
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@njit(error_model="numpy", _nrt=False, forceinline=True)
def reflect_ggx(wox, woy, woz, wix, wiy, wiz, alpha):  # type: ignore[no-untyped-def]
    """(value, density, cosine to the half vector) of a GGX mirror that reflects everything: without cosine, per steradian; wo, wi above."""
    hx, hy, hz = wox + wix, woy + wiy, woz + wiz
    scale = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    cosine = wox * hx + woy * hy + woz * hz
    # D / (4 o i (1 + L_o + L_i)) and D / (4 o (1 + L_o)), Smith's L being (root / cosine - 1) / 2, over one division.
    # D's denominator from the sine: 1 + cos^2 (alpha^2 - 1) would lose all its digits in single precision.
    a2 = alpha * alpha
    d = hz * hz * a2 + (hx * hx + hy * hy)
    root_o = math.sqrt(woz * woz + a2 * (wox * wox + woy * woy))
    root_i = math.sqrt(wiz * wiz + a2 * (wix * wix + wiy * wiy))
    one, both = woz + root_o, root_o * wiz + root_i * woz
    common = a2 * (0.5 * INVERSE_PI) / (d * d * one * both)
    return common * one, common * both, cosine
