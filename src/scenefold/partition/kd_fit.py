"""Cuts of a k-d tree that share a sample and cut little geometry (partitions.md, k-d; specs/28-rebalancing.md, Ours)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.partition.boxes import Cut

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

BAND = 0.004
"""How far from its share a cut may be for a better plane, of the smaller side's share."""
CANDIDATES = 17
"""Planes that are tried on each axis."""
LAYER = 2.0**-8
"""Of the part's side: hits that near to a plane lie on it, as far as their next rays can tell."""
_IMBALANCE, _GEOMETRY, _ON_PLANE = 4.0, 0.25, 1.0
"""What a cut costs: the excess of its heavier side, the geometry on both sides, the hits near its plane, as parts of one."""
_STAY = 0.1
"""A present axis stays unless another is cheaper by this."""


class Sample(NamedTuple):
    """Points f64[n, 3] that count `shares` f64[n], and boxes of geometry f64[m, 2, 3]."""

    points: Floats
    shares: Floats
    geometry: Floats


def fit_cuts(sample: Sample, box: Floats, nodes: int, present: list[Cut] | None = None, damping: float = 0.0) -> list[Cut]:
    """N - 1 cuts, root first: at weighted medians, each across the axis where it costs least.

    Of `present` cuts, axes stay where no other is much better, and planes then move by 1 - damping of the way.
    """
    low, high = box[0].copy(), box[1].copy()
    if len(sample.points):
        low, high = np.minimum(low, sample.points.min(axis=0)), np.maximum(high, sample.points.max(axis=0))
    return _fitted(sample, low, high, nodes, present, damping)


def _fitted(sample: Sample, low: Floats, high: Floats, nodes: int, present: list[Cut] | None, damping: float) -> list[Cut]:
    if nodes == 1:
        return []
    lower = nodes // 2
    old = present[0] if present and present[0].lower == lower else None
    axis, plane = _choice(sample, low, high, lower / nodes, old)
    if old is not None and old.axis == axis:
        plane = min(max(old.plane + (1.0 - damping) * (plane - old.plane), float(low[axis])), float(high[axis]))
    else:
        old = None
    under, over = high.copy(), low.copy()
    under[axis] = over[axis] = plane
    is_lower = sample.points[:, axis] <= plane
    first = Sample(sample.points[is_lower], sample.shares[is_lower], sample.geometry[sample.geometry[:, 0, axis] <= plane])
    second = Sample(sample.points[~is_lower], sample.shares[~is_lower], sample.geometry[sample.geometry[:, 1, axis] > plane])
    before, behind = (present[1:lower], present[lower:]) if present and old is not None else (None, None)
    return [
        Cut(axis, plane, lower),
        *_fitted(first, low, under, lower, before, damping),
        *_fitted(second, over, high, nodes - lower, behind, damping),
    ]


def _choice(sample: Sample, low: Floats, high: Floats, share: float, old: Cut | None) -> tuple[int, float]:
    if float(sample.shares.sum()) <= 0.0:
        axis = int(np.argmax(high - low)) if old is None else old.axis
        return axis, float(0.5 * (low[axis] + high[axis]))
    found = [_on_axis(sample, axis, float(high[axis] - low[axis]), share) for axis in range(3)]
    best = min(range(3), key=lambda axis: found[axis][0])
    if old is not None and found[old.axis][0] <= found[best][0] + _STAY:
        best = old.axis
    return best, min(max(found[best][1], float(low[best])), float(high[best]))


def _on_axis(sample: Sample, axis: int, side: float, share: float) -> tuple[float, float]:
    """What the best plane across this axis costs, and where it lies."""
    order = np.argsort(sample.points[:, axis], kind="stable")
    places, running = sample.points[order, axis], np.cumsum(sample.shares[order])
    total = float(running[-1])
    ends = _candidates(places, running, share * total, BAND * min(share, 1.0 - share) * total)
    if len(ends) == 0:  # all on one plane: it belongs to the lower side
        return _IMBALANCE / share, float(places[0])
    planes = 0.5 * places[ends - 1] + 0.5 * places[ends]
    planes = np.where(planes < places[ends], planes, places[ends - 1])
    under = running[ends - 1] / total
    excess = np.maximum(under / share, (1.0 - under) / (1.0 - share)) - 1.0
    edge = LAYER * side
    near = np.searchsorted(places, planes + edge, "right"), np.searchsorted(places, planes - edge, "left")
    padded = np.append(0.0, running)
    layer = (padded[near[0]] - padded[near[1]]) / total
    begins, finishes = np.sort(sample.geometry[:, 0, axis]), np.sort(sample.geometry[:, 1, axis])
    cut = np.searchsorted(begins, planes, "left") - np.searchsorted(finishes, planes, "right")
    costs = _IMBALANCE * excess + _ON_PLANE * layer + _GEOMETRY * cut / max(len(begins), 1)
    best = int(np.argmin(costs))
    return float(costs[best]), float(planes[best])


def _candidates(places: Floats, running: Floats, target: float, band: float) -> Indices:
    """How many points may lie below a plane: some of what the band allows, and the nearest outside on both sides."""
    possible = np.flatnonzero(places[1:] > places[:-1]) + 1
    if len(possible) == 0:
        return possible
    held = running[possible - 1]
    first, last = np.searchsorted(held, [target - band, target + band])
    first, last = max(int(first) - 1, 0), min(int(last), len(possible) - 1)
    picked: Indices = possible[np.unique(np.linspace(first, last, CANDIDATES).round().astype(np.intp))]
    return picked
