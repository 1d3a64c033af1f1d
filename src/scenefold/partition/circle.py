"""Bounds on a circle, of which none is fixed (thesis 3.3.7, Radial; specs/28-rebalancing.md, Bounds).

Any rotation of the bounds has a fit with equal shares; the one is taken that moves them least, counted in work.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.partition.bounds import checked_counts, fit_bounds, running_count, shares_between

Floats = npt.NDArray[np.float64]


def turned(counts: npt.ArrayLike, turn: float) -> Floats:
    """The histogram as seen from `turn` on: f64[bins], what lay across a new bin's edge being split evenly."""
    tally = checked_counts(counts)
    edges = running_count(tally)[0] + turn % 1.0
    return np.diff(_before(tally, edges))


def fit_circle(counts: npt.ArrayLike, bounds: npt.ArrayLike) -> tuple[float, Floats]:
    """By how much of a turn bound 0 moves, and the inner bounds from there: float in (-1, 1), f64[N - 1].

    `bounds` are the present inner bounds, from bound 0 at 0. Two nodes turn their diameter to the nearest place
    where it halves the work; one node, and a histogram without work, stay.
    """
    tally, inner = checked_counts(counts), np.asarray(bounds, np.float64).reshape(-1)
    nodes, total = len(inner) + 1, float(tally.sum())
    if nodes == 1 or total == 0.0:
        return 0.0, inner
    if nodes == 2:
        return _diameter(tally), inner
    # Where bounds are, in work, less where they would be if they began at 0: bound 0 goes to the mean.
    start = float(np.mean(_before(tally, np.append(0.0, inner)) / total - np.arange(nodes) / nodes))
    turn = _place(tally, start % 1.0) + np.floor(start)
    return turn, fit_bounds(turned(tally, turn), nodes)


def largest_on_circle(counts: npt.ArrayLike, turn: float, bounds: npt.ArrayLike) -> float:
    """The largest share of work between two bounds that follow each other, bound 0 lying at `turn`."""
    inner = np.asarray(bounds, np.float64).reshape(-1)
    tally = checked_counts(counts)
    return float(np.diff(_before(tally, turn % 1.0 + np.concatenate([[0.0], inner, [1.0]]))).max())


def largest_on_line(counts: npt.ArrayLike, bounds: npt.ArrayLike) -> float:
    """The largest share of work between two bounds of [0, 1] that follow each other."""
    inner = np.asarray(bounds, np.float64).reshape(-1)
    return float(shares_between(counts, np.concatenate([[0.0], inner, [1.0]])).max())


def _before(tally: Floats, places: Floats) -> Floats:
    """Work before each place, from 0 on, through as many turns as it takes."""
    turns = np.floor(places)
    edges, running = running_count(tally)
    work: Floats = np.interp(places - turns, edges, running) + turns * running[-1]
    return work


def _place(tally: Floats, share: float) -> float:
    """The place in [0, 1] that this share of the work lies before."""
    edges, running = running_count(tally)
    return float(np.interp(share * running[-1], running, edges))


def _diameter(tally: Floats) -> float:
    """The least turn, to either side, after which both half turns hold the same work."""
    steps = np.arange(len(tally) + 1) / (2.0 * len(tally))
    places = np.concatenate([-steps[:0:-1], steps])
    excess = _before(tally, places + 0.5) - _before(tally, places) - 0.5 * float(tally.sum())
    found = [0.0] if excess[len(tally)] == 0.0 else []
    for i in np.flatnonzero(excess[:-1] * excess[1:] <= 0.0):
        rise = excess[i + 1] - excess[i]
        share = -excess[i] / rise if rise != 0.0 else 0.0
        found.append(float(places[i] + share * (places[i + 1] - places[i])))
    return min(found, key=abs)
