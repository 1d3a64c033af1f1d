"""Print the constants of src/scenefold/render/glass_albedo.py: what a rough boundary of glass gives on of even light, by quadrature.

    python tools/make_glass_albedo.py

As make_ggx_albedo.py: with wo fixed, over visible normals, where what is left of the integrand is G2 / G1; each normal mirrors the share
that Fresnel's exact term says, and bends the rest, if the outcome lies on the side where it belongs.
"""

from __future__ import annotations

import base64
import math
import textwrap
from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
ROUGHNESSES, COSINES, INDICES = 24, 24, 16
ALPHA_MIN = 1e-3
INDEX_MIN, INDEX_MAX = 1.0 + 2.0**-10, 2000.0
POINTS = 192


@cache
def _points(count: int) -> tuple[F64, F64, F64]:
    node, weight = np.polynomial.legendre.leggauss(count)
    node, weight = (node + 1) / 2, weight / 2
    s, v = np.meshgrid(node, node, indexing="ij")
    return np.sqrt(s * (2 - s)), np.pi * (v - 0.5), np.outer(weight * 2 * (1 - node), weight)


def albedos(cosine: float, alpha: float, etas: Sequence[float], points: int = POINTS) -> list[float]:
    """What is mirrored and bent together, as shares of the light from a cosine, for indices on the far side by that on this side."""
    radius, angle, weights = _points(points)
    x, z = math.sqrt(max(1 - cosine * cosine, 0.0)), cosine
    length = math.hypot(alpha * x, z)
    sx, sz = alpha * x / length, z / length
    across, up = radius * np.cos(angle), radius * np.sin(angle)
    half = (1 + sz) / 2
    up = (1 - half) * np.sqrt(np.maximum(1 - across**2, 0)) + half * up
    out = np.sqrt(np.maximum(1 - across**2 - up**2, 0))
    normal = np.stack([alpha * (out * sx - up * sz), alpha * across, np.maximum(up * sx + out * sz, 1e-12)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    towards = np.clip(x * normal[0] + z * normal[2], 0, 1)
    hidden_o = (math.sqrt(1 + (alpha * x / z) ** 2) - 1) / 2

    def shares(height: F64) -> F64:
        leaves = height > 0
        height = np.where(leaves, height, 1.0)
        hidden_i = (np.sqrt(1 + alpha**2 * np.maximum(1 - height**2, 0) / height**2) - 1) / 2
        found: F64 = np.where(leaves, (1 + hidden_o) / (1 + hidden_o + hidden_i), 0.0) * weights
        return found

    mirrored, found = shares(2 * towards * normal[2] - z), []
    for eta in etas:
        squared = 1 - (1 - towards**2) / eta**2
        beyond = np.sqrt(np.maximum(squared, 0))
        crosswise, lengthwise = (towards - eta * beyond) / (towards + eta * beyond), (eta * towards - beyond) / (eta * towards + beyond)
        fresnel = np.where(squared > 0, (crosswise**2 + lengthwise**2) / 2, 1.0)
        bent = shares(z / eta - (towards / eta - beyond) * normal[2])
        found.append(float((fresnel * mirrored + (1 - fresnel) * bent).sum()))
    return found


def table() -> npt.NDArray[np.uint32]:
    """uint32[ROUGHNESSES, COSINES, INDICES]: by roughness, the root of the cosine, and that of (ior - 1) / (ior + 1), each from 0 to 1;
    65535 times the albedo from without, and from within in the upper half."""
    roots = (np.arange(INDICES) / (INDICES - 1)) ** 2
    indices = [min(max((1 + root) / max(1 - root, 1e-6), INDEX_MIN), INDEX_MAX) for root in roots]
    etas = [*indices, *(1 / index for index in indices)]
    cosines = [max((step / (COSINES - 1)) ** 2, 1e-4) for step in range(COSINES)]
    alphas = [max((step / (ROUGHNESSES - 1)) ** 2, ALPHA_MIN) for step in range(ROUGHNESSES)]
    found = np.array([[albedos(cosine, alpha, etas) for cosine in cosines] for alpha in alphas])
    whole: npt.NDArray[np.uint32] = np.floor(np.clip(found, 0, 1) * 65535 + 0.5).astype(np.uint32)
    return whole[..., :INDICES] + (whole[..., INDICES:] << np.uint32(16))


if __name__ == "__main__":
    print("\n".join(textwrap.wrap(base64.b64encode(table().astype("<u4").tobytes()).decode(), 136)))
