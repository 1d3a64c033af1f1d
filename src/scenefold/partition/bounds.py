"""Bounds on one dimension, fitted to where the work is (thesis 3.3.7; partitions.md, Bounded radial).

The global form: march through a histogram from its leftmost bin; where the running count crosses one node's
share, interpolate linearly inside the bin, and that is the next bound. O(nodes + bins). Counts are integers, so
the order in which samples arrived leaves no trace.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

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

    Where one share would need more than half a turn, its node gets half a turn and the others share the rest
    evenly. Spans are then limited to what a cell may be (`limit_spans`). Without any work: equal spans.
    """
    tally = checked_counts(counts)
    total = float(tally.sum())
    if total == 0.0:
        return even_bounds(nodes)
    bounds = np.concatenate([[0.0], _crossings(tally, even_bounds(nodes) * total), [1.0]])
    widest = int(np.argmax(np.diff(bounds)))
    if nodes > 2 and bounds[widest + 1] - bounds[widest] > SPAN_MAX:
        bounds = _around_the_widest(tally, bounds, widest)
    return limit_spans(bounds[1:-1])


def equal_shares(counts: npt.ArrayLike, nodes: int) -> Floats:
    """N - 1 inner bounds that give every node the same share of a histogram of [0, 1): the march, without limits."""
    tally = checked_counts(counts)
    total = float(tally.sum())
    return _crossings(tally, even_bounds(nodes) * total) if total > 0.0 else even_bounds(nodes)


def shares_between(counts: npt.ArrayLike, bounds: npt.ArrayLike) -> Floats:
    """Work of a histogram of [0, 1) between each two of ascending bounds, spread evenly within bins: f64[len - 1]."""
    return np.diff(np.interp(np.asarray(bounds, np.float64), *running_count(checked_counts(counts))))


def running_count(tally: Floats) -> tuple[Floats, Floats]:
    """Edges of the bins in [0, 1], and what lies before each: f64[bins + 1] twice."""
    return np.arange(len(tally) + 1) / len(tally), np.concatenate([[0.0], np.cumsum(tally)])


def checked_counts(counts: npt.ArrayLike) -> Floats:
    """As f64[bins]; LocalFault if it is no histogram."""
    tally = np.asarray(counts, np.float64).reshape(-1)
    if len(tally) == 0 or not (tally >= 0.0).all() or not np.isfinite(tally).all():
        raise LocalFault("a histogram has at least one bin, and counts that are finite and not negative")
    return tally


def _crossings(tally: Floats, wanted: Sequence[float] | Floats) -> Floats:
    """Where the running count crosses each of the ascending numbers wanted: the march."""
    places = np.empty(len(wanted))
    running, place = 0.0, 0
    for i, target in enumerate(wanted):
        while place < len(tally) - 1 and running + tally[place] < target:
            running += tally[place]
            place += 1
        inside = (target - running) / tally[place] if tally[place] > 0.0 else 1.0
        places[i] = (place + min(max(inside, 0.0), 1.0)) / len(tally)
    return places


def _around_the_widest(tally: Floats, bounds: Floats, widest: int) -> Floats:
    """All N + 1 bounds anew, with a span of half a turn for one node, where that leaves the others equal shares.

    Half a turn slides along the span that was too wide; what it uncovers on its left falls to the nodes on
    the left, and so on the right. The left ones' share grows with the slide, so bisection finds the balance.
    """
    edges, running = running_count(tally)
    total = float(running[-1])
    left, right = widest, len(bounds) - 2 - widest

    def uncovered(start: float) -> tuple[float, float]:
        return float(np.interp(start, edges, running)), total - float(np.interp(start + SPAN_MAX, edges, running))

    least, most = float(bounds[widest]), float(bounds[widest + 1]) - SPAN_MAX
    if left == 0:
        most = 0.0
    elif right == 0:
        least = 1.0 - SPAN_MAX
    for _ in range(60):
        start = 0.5 * (least + most)
        on_left, on_right = uncovered(start)
        if on_left * right < on_right * left:
            least = start
        else:
            most = start
    before, behind = uncovered(most)
    first = _crossings(tally, [before * node / left for node in range(1, left)])
    last = _crossings(tally, [total - behind * node / right for node in range(right - 1, 0, -1)])
    return np.concatenate([[0.0] * (left > 0), first, [most, most + SPAN_MAX], last, [1.0] * (right > 0)])


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
