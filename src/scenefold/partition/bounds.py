"""Bounds on one dimension, fitted to where the work is (thesis 3.3.7; partitions.md, Bounded radial).

The global form: march through a histogram from its leftmost bin; where the running count crosses one node's
share, interpolate linearly inside the bin, and that is the next bound. O(nodes + bins). Counts are integers, so
the order in which samples arrived leaves no trace.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.wedges import SPAN_MAX, SPAN_MIN

Floats = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

BINS = 4096
"""The thesis finds no difference between 2^8 and 2^12; 127 nodes want the finer end."""
_WEIGHT_SUM = 2**40
"""Weights become integers that sum to about this."""


def even_bounds(nodes: int) -> Floats:
    """N - 1 inner bounds of N equal spans."""
    return np.arange(1, nodes) / nodes


def whole_weights(weights: npt.ArrayLike | None, count: int) -> Counts:
    """Weights as integers in proportion, whose sums depend on no order; all 1 if there are none given."""
    if weights is None:
        return np.ones(count, np.int64)
    given = np.asarray(weights, np.float64).reshape(-1)
    if len(given) != count or not (given >= 0.0).all() or not np.isfinite(given).all():
        raise LocalFault("weights must be finite, not negative, and as many as samples")
    largest = float(given.max(initial=0.0))
    if largest == 0.0:
        return np.ones(count, np.int64)
    scaled = given / largest  # so that the sum cannot overflow
    return np.rint(scaled * (_WEIGHT_SUM / math.fsum(scaled))).astype(np.int64)


def histogram(fractions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, bins: int = BINS) -> Counts:
    """Work per bin of [0, 1): int64[bins]. Fractions outside count for the first or last bin."""
    places = np.asarray(fractions, np.float64).reshape(-1)
    shares = whole_weights(weights, len(places))
    counts = np.zeros(bins, np.int64)
    np.add.at(counts, np.clip(places * bins, 0, bins - 1).astype(np.int64), shares)
    return counts


def fit_bounds(counts: npt.ArrayLike, nodes: int) -> Floats:
    """N - 1 inner bounds that give every node the same share of a histogram of [0, 1), as far as wedges may be so.

    Spans are then limited to what makes cells convex and not degenerate (`limit_spans`), so that a node can be
    left with less than its share where all work lies in one direction. Without any work: equal spans.
    """
    tally = np.asarray(counts, np.float64).reshape(-1)
    if len(tally) == 0 or not (tally >= 0.0).all() or not np.isfinite(tally).all():
        raise LocalFault("a histogram has at least one bin, and counts that are finite and not negative")
    share = float(tally.sum()) / nodes
    if share == 0.0:
        return even_bounds(nodes)
    bounds = np.empty(nodes - 1)
    running, place = 0.0, 0
    for node in range(nodes - 1):
        wanted = share * (node + 1)
        while place < len(tally) - 1 and running + tally[place] < wanted:
            running += tally[place]
            place += 1
        inside = (wanted - running) / tally[place] if tally[place] > 0.0 else 1.0
        bounds[node] = (place + min(inside, 1.0)) / len(tally)
    return limit_spans(bounds)


def limit_spans(bounds: npt.ArrayLike) -> Floats:
    """The inner bounds moved as far as needed to make every span one that a wedge may have.

    At most half a turn, because a wider wedge is not convex; not thinner than any ray step. One node has no
    bounds, and two have half a turn each: they cannot move.
    """
    inner = np.asarray(bounds, np.float64).reshape(-1)
    nodes = len(inner) + 1
    if nodes <= 2:
        return even_bounds(nodes)
    limited = np.empty(nodes - 1)
    before = 0.0
    for i in range(nodes - 1):
        left = nodes - 1 - i
        least = max(before + SPAN_MIN, 1.0 - left * SPAN_MAX)
        most = min(before + SPAN_MAX, 1.0 - left * SPAN_MIN)
        before = limited[i] = min(max(float(inner[i]), least), most)
    return limited
