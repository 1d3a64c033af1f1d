"""Weights of power cells that share a sample (partitions.md, Power; specs/28-rebalancing.md, Ours).

Such weights make a concave function of them greatest: the dual of the cheapest transport of the sample to the
centroids. Points of a sample belong to one cell or another, which has no second derivative, so points are first shared
between cells by a soft minimum of powers, which hardens level by level: Newton's method with steps that are halved
until the dual climbs and no cell starves (Kitagawa, Merigot and Thibert 2019, for the damping).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault

Floats = npt.NDArray[np.float64]

SAMPLE_MAX = 16384
"""Points that are looked at, evenly out of those given."""
_HARD = 2e-4
"""The last level's softness, of the sample's variance a cell."""
_SOFT = 0.3
"""The first level's, or more."""
_FED = 0.1
"""Of its share: what every cell is to have when the first level begins. From less, a step of Newton's leads anywhere."""
_HARDER = 0.35
"""The softness of a level, of that before it."""
_STEPS = 16
_HALVINGS = 12
_CLOSE = 2e-3
"""A level is done when no cell is farther from its share than this part of it."""
_NO_BEND = np.zeros((0, 0))


class _Sample(NamedTuple):
    """In units in which the points' variance is 1 and their shares sum to 1."""

    points: Floats
    shares: Floats
    centroids: Floats


def fit_weights(centroids: Floats, start: Floats, points: Floats, shares: Floats) -> Floats:
    """Weights f64[N] of centroids f64[N, 3] whose cells share points f64[n, 3] of `shares` f64[n] well, from `start` on.

    The best ones that were met, by the largest share; `start` if none are better. Their mean is that of `start`.
    """
    from scenefold.partition.power_fit_kernels import largest

    if len(start) != len(centroids) or len(points) != len(shares):
        raise LocalFault("every centroid has a weight, and every point a share")
    if len(centroids) == 1 or float(shares.sum()) <= 0.0:
        return start
    stride = -(-len(points) // SAMPLE_MAX)
    points, masses = points[::stride], shares[::stride]
    masses = masses / masses.sum()
    middle = masses @ points
    scale = float(masses @ ((points - middle) ** 2).sum(axis=1)) or 1.0
    unit = scale**0.5
    sample = _Sample((points - middle) / unit, masses, (centroids - middle) / unit)
    weights = (start - start.mean()) / scale
    best, least = weights, largest(*sample, weights)
    last = _HARD * len(centroids) ** (-2.0 / 3.0)
    softness = _soft_enough(sample, weights, last)
    while softness > last:
        softness = max(softness * _HARDER, last)
        weights = _newton(sample, weights, softness)
        found = largest(*sample, weights)
        if found < least:
            best, least = weights, found
    fitted: Floats = best * scale + start.mean()
    return fitted


def _soft_enough(sample: _Sample, weights: Floats, last: float) -> float:
    """A softness at which no cell starves: as it grows without end, all cells have the same."""
    from scenefold.partition.power_fit_kernels import shared

    masses = np.empty(len(weights))
    softness = last * _SOFT / _HARD
    for _ in range(100):
        shared(*sample, weights, softness, masses, _NO_BEND)
        if masses.min() * len(weights) >= _FED:
            break
        softness /= _HARDER
    return softness


def _newton(sample: _Sample, weights: Floats, softness: float) -> Floats:
    from scenefold.partition.power_fit_kernels import shared

    nodes = len(weights)
    share = 1.0 / nodes
    masses, tried_masses, bend = np.empty(nodes), np.empty(nodes), np.empty((nodes, nodes))
    dual = shared(*sample, weights, softness, masses, bend)
    floor = 0.5 * min(share, float(masses.min()))
    for _ in range(_STEPS):
        slope = share - masses
        steepness = np.trace(bend) / nodes
        if np.abs(slope).max() < _CLOSE * share or steepness < 1e-200:  # no point is shared: nothing leads anywhere
            break
        # A constant changes nothing: fixed at 0. The rest keeps a little steepness where a cell has nearly nothing.
        bend += steepness * (1e-9 * np.eye(nodes) + 1.0 / nodes)
        step = np.linalg.solve(bend, slope)
        for halving in range(_HALVINGS):
            tried = weights + step * 0.5**halving
            then = shared(*sample, tried, softness, tried_masses, _NO_BEND)
            if then > dual and tried_masses.min() >= floor:
                break
        else:
            break
        weights = tried
        dual = shared(*sample, weights, softness, masses, bend)
    centred: Floats = weights - weights.mean()
    return centred
