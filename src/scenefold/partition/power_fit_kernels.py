"""Points shared softly between power cells, compiled (specs/28-rebalancing.md, Ours)."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

_NOTHING = 32.0
"""Softnesses above the least power: what is farther has less than 1e-13 of a point."""


@njit(nogil=True, cache=True, error_model="numpy")
def shared(points, shares, centroids, weights, softness, masses, bend):
    """Softly shared points: fills masses f64[N], and bend f64[N, N] if it has rows; returns the dual, f64.

    `points` f64[n, 3] count `shares` f64[n]. A point's part in a cell goes with exp(-power / softness). `bend` is
    the derivative of masses by weights.
    """
    nodes = centroids.shape[0]
    powers = np.empty(nodes)
    parts = np.empty(nodes)
    near = np.empty(nodes, np.int64)
    masses[:] = 0.0
    bend[:] = 0.0
    dual = 0.0
    for node in range(nodes):
        dual += weights[node] / nodes
    for i in range(points.shape[0]):
        least = math.inf
        for node in range(nodes):
            ex, ey, ez = points[i, 0] - centroids[node, 0], points[i, 1] - centroids[node, 1], points[i, 2] - centroids[node, 2]
            power = ex * ex + ey * ey + ez * ez - weights[node]
            powers[node] = power
            least = min(least, power)
        count = 0
        total = 0.0
        for node in range(nodes):
            above = (powers[node] - least) / softness
            if above < _NOTHING:
                near[count] = node
                parts[count] = math.exp(-above)
                total += parts[count]
                count += 1
        dual += shares[i] * (least - softness * math.log(total))
        for k in range(count):
            parts[k] /= total
            masses[near[k]] += shares[i] * parts[k]
        if bend.shape[0] > 0:
            for k in range(count):
                bend[near[k], near[k]] += shares[i] * parts[k] / softness
                for m in range(count):
                    bend[near[k], near[m]] -= shares[i] * parts[k] * parts[m] / softness
    return dual


@njit(nogil=True, cache=True, error_model="numpy")
def largest(points, shares, centroids, weights):
    """The largest share of a cell, each point belonging to one alone: f64."""
    masses = np.zeros(centroids.shape[0])
    for i in range(points.shape[0]):
        least = math.inf
        best = 0
        for node in range(centroids.shape[0]):
            ex, ey, ez = points[i, 0] - centroids[node, 0], points[i, 1] - centroids[node, 1], points[i, 2] - centroids[node, 2]
            power = ex * ex + ey * ey + ez * ez - weights[node]
            if power < least:
                least = power
                best = node
        masses[best] += shares[i]
    return masses.max()
