"""Print the constants of src/scenefold/render/ggx_albedo.py: what GGX reflects of even light, by quadrature.

    python tools/make_ggx_albedo.py

With wo fixed, the integral over wi of D V cos(wi) is taken over visible normals (Heitz 2018), where what is left of the integrand
is G2 / G1 = (1 + L_o) / (1 + L_o + L_i), smooth and at most 1. Gauss-Legendre over the half disk on one side of the plane of
incidence; its radius is sqrt(s (2 - s)), which takes the root's kink out of the rim.
"""

from __future__ import annotations

import base64
import math
import textwrap

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
NODES = 48
ALPHA_MIN = 1e-3
POINTS = 96


def albedo(cosine: float, alpha: float, points: int = POINTS) -> tuple[float, float]:
    """(E, B): what GGX reflects towards the cosine with a Fresnel term of 1, and with one of (1 - V.H)^5."""
    node, weight = np.polynomial.legendre.leggauss(points)
    node, weight = (node + 1) / 2, weight / 2
    s, v = np.meshgrid(node, node, indexing="ij")
    weights = np.outer(weight * 2 * (1 - node), weight)
    radius, angle = np.sqrt(s * (2 - s)), np.pi * (v - 0.5)
    x, z = math.sqrt(max(1 - cosine * cosine, 0.0)), cosine
    length = math.hypot(alpha * x, z)
    sx, sz = alpha * x / length, z / length
    across, up = radius * np.cos(angle), radius * np.sin(angle)
    half = (1 + sz) / 2
    up = (1 - half) * np.sqrt(np.maximum(1 - across**2, 0)) + half * up
    out = np.sqrt(np.maximum(1 - across**2 - up**2, 0))
    normal = np.stack([alpha * (out * sx - up * sz), alpha * across, np.maximum(up * sx + out * sz, 1e-12)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    towards = x * normal[0] + z * normal[2]
    height = 2 * towards * normal[2] - z
    leaves = height > 0
    height = np.where(leaves, height, 1.0)
    hidden_o = (math.sqrt(1 + (alpha * x / z) ** 2) - 1) / 2
    hidden_i = (np.sqrt(1 + alpha**2 * np.maximum(1 - height**2, 0) / height**2) - 1) / 2
    share = np.where(leaves, (1 + hidden_o) / (1 + hidden_o + hidden_i), 0.0) * weights
    return float(share.sum()), float((share * np.clip(1 - towards, 0, 1) ** 5).sum())


def table() -> npt.NDArray[np.uint32]:
    """uint32[NODES, NODES]: rows by roughness, columns by the root of the cosine, both from 0 to 1; 65535 (1 - E) + 2^16 · 65535 B."""
    steps = np.arange(NODES) / (NODES - 1)
    both = np.array([[albedo(max(step**2, 1e-4), max(rough**2, ALPHA_MIN)) for step in steps] for rough in steps])
    whole: npt.NDArray[np.uint32] = np.floor(np.clip(both, 0, 1) * 65535 + 0.5).astype(np.uint32)
    return (np.uint32(65535) - whole[..., 0]) + (whole[..., 1] << np.uint32(16))


if __name__ == "__main__":
    print("\n".join(textwrap.wrap(base64.b64encode(table().astype("<u4").tobytes()).decode(), 128)))
