"""Print the constants of src/scenefold/render/glass_albedo.py: what a rough boundary of glass gives on of even light, by quadrature.

    python tools/make_glass_albedo.py

As make_ggx_albedo.py: with wo fixed, over visible normals, where what is left of the integrand is G2 / G1; each normal mirrors the share
that Fresnel's exact term says, and bends the rest, if the outcome lies on the side where it belongs.
"""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from make_ggx_albedo import ALPHA_MIN, facets_seen

ROUGHNESSES, COSINES, INDICES = 24, 24, 16
INDEX_MIN, INDEX_MAX = 1.0 + 2.0**-10, 2000.0
POINTS = 192


def albedos(cosine: float, alpha: float, etas: Sequence[float], points: int = POINTS) -> list[float]:
    """What is mirrored and bent together, as shares of the light from a cosine, for indices on the far side by that on this side."""
    seen = facets_seen(cosine, alpha, points)
    towards = np.clip(seen.towards, 0, 1)
    mirrored, found = seen.shares(2 * towards * seen.upwards - cosine), []
    for eta in etas:
        squared = 1 - (1 - towards**2) / eta**2
        beyond = np.sqrt(np.maximum(squared, 0))
        crosswise, lengthwise = (towards - eta * beyond) / (towards + eta * beyond), (eta * towards - beyond) / (eta * towards + beyond)
        fresnel = np.where(squared > 0, (crosswise**2 + lengthwise**2) / 2, 1.0)
        bent = seen.shares(cosine / eta - (towards / eta - beyond) * seen.upwards)
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
