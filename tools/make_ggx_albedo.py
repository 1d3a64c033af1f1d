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
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
NODES = 48
ALPHA_MIN = 1e-3
POINTS = 96


class Facets(NamedTuple):
    """Visible normals on one side of the plane of incidence, and how much of the light each has."""

    towards: F64
    """Cosine between the viewer's direction and the normal."""
    upwards: F64
    """The normal's own cosine with that of the surface."""
    weights: F64
    alpha: float
    hidden: float
    """Smith's Lambda of the viewer's direction."""

    def shares(self, height: F64) -> F64:
        """What light that goes on at these cosines has of it: G2 / G1, by weight; 0 where it goes below the surface."""
        leaves = height > 0
        height = np.where(leaves, height, 1.0)
        hidden = (np.sqrt(1 + self.alpha**2 * np.maximum(1 - height**2, 0) / height**2) - 1) / 2
        found: F64 = np.where(leaves, (1 + self.hidden) / (1 + self.hidden + hidden), 0.0) * self.weights
        return found


@cache
def _points(count: int) -> tuple[F64, F64, F64]:
    node, weight = np.polynomial.legendre.leggauss(count)
    node, weight = (node + 1) / 2, weight / 2
    s, v = np.meshgrid(node, node, indexing="ij")
    return np.sqrt(s * (2 - s)), np.pi * (v - 0.5), np.outer(weight * 2 * (1 - node), weight)


def facets_seen(cosine: float, alpha: float, points: int) -> Facets:
    """From a direction of this cosine."""
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
    return Facets(x * normal[0] + z * normal[2], normal[2], weights, alpha, (math.sqrt(1 + (alpha * x / z) ** 2) - 1) / 2)


def albedo(cosine: float, alpha: float, points: int = POINTS) -> tuple[float, float]:
    """(E, B): what GGX reflects towards the cosine with a Fresnel term of 1, and with one of (1 - V.H)^5."""
    seen = facets_seen(cosine, alpha, points)
    share = seen.shares(2 * seen.towards * seen.upwards - cosine)
    return float(share.sum()), float((share * np.clip(1 - seen.towards, 0, 1) ** 5).sum())


def table() -> npt.NDArray[np.uint32]:
    """uint32[NODES, NODES]: rows by roughness, columns by the root of the cosine, both from 0 to 1; 65535 (1 - E) + 2^16 · 65535 B."""
    steps = np.arange(NODES) / (NODES - 1)
    both = np.array([[albedo(max(step**2, 1e-4), max(rough**2, ALPHA_MIN)) for step in steps] for rough in steps])
    whole: npt.NDArray[np.uint32] = np.floor(np.clip(both, 0, 1) * 65535 + 0.5).astype(np.uint32)
    return (np.uint32(65535) - whole[..., 0]) + (whole[..., 1] << np.uint32(16))


if __name__ == "__main__":
    print("\n".join(textwrap.wrap(base64.b64encode(table().astype("<u4").tobytes()).decode(), 128)))
