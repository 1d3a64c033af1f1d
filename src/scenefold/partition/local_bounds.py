"""Bounds by what neighbours say alone (Algorithm 3; specs/28-rebalancing.md, Local bounds).

A node with more than its share withdraws around its fullest bin and says so; what it left is for the neighbour on
that side. What is said may be old when it arrives: `agree` makes bounds out of any words.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.bounds import checked_counts

Floats = npt.NDArray[np.float64]


def withdraw(
    low: float, high: float, counts: npt.ArrayLike, mean: float, *, fixed_low: bool = False, fixed_high: bool = False
) -> tuple[float, float]:
    """A node's new bounds, from the histogram of its own span low .. high and the mean count of it and its neighbours.

    Unchanged unless its own count is above the mean. A fixed bound stays, and the node then grows from there.
    """
    tally = checked_counts(counts)
    if not low <= high or not mean >= 0.0:
        raise LocalFault("a span ascends, and a mean count is not negative")
    if tally.sum() <= mean or (fixed_low and fixed_high):
        return low, high
    if fixed_low:
        return low, _edge(low, high, len(tally), _grown(tally, 0, mean))
    if fixed_high:
        return _edge(low, high, len(tally), len(tally) - _grown(tally[::-1], 0, mean)), high
    first, last, held = _around_the_fullest(tally, mean)
    rest = mean - held
    upper, lower = float(last), float(first)
    if rest > 0.0 and last < len(tally):
        upper += min(1.0, rest / tally[last]) if tally[last] > 0.0 else 1.0
    elif rest > 0.0 and first > 0:
        lower -= min(1.0, rest / tally[first - 1]) if tally[first - 1] > 0.0 else 1.0
    return _edge(low, high, len(tally), lower), _edge(low, high, len(tally), upper)


def agree(bounds: npt.ArrayLike, words: list[tuple[float, float] | None]) -> Floats:
    """Bounds out of the present ones, f64[N + 1], and what nodes said of theirs (None: nothing): f64[N + 1], ascending.

    Where both neighbours of a bound moved it, the middle; where one did, there. The outermost bounds stay. Words
    from another time may contradict each other: no bound then passes the one before it.
    """
    old = np.asarray(bounds, np.float64).reshape(-1)
    if len(words) != len(old) - 1 or len(words) < 1 or not (np.diff(old) >= 0.0).all():
        raise LocalFault("bounds ascend, and every node between two of them has a word or None")
    new = old.copy()
    for i in range(1, len(words)):
        before, behind = words[i - 1], words[i]
        said = [word for word in (before[1] if before else old[i], behind[0] if behind else old[i]) if word != old[i]]
        if said:
            new[i] = sum(said) / len(said)
    return np.clip(np.maximum.accumulate(new), old[0], old[-1])


def _around_the_fullest(tally: Floats, mean: float) -> tuple[int, int, float]:
    """Bins first .. last - 1 around the fullest one: to the left up to half the mean, then right up to the mean."""
    first = int(np.argmax(tally))
    last, held = first + 1, float(tally[first])
    if held >= mean:
        return first, last, held
    while first > 0 and held + tally[first - 1] < 0.5 * mean:
        first -= 1
        held += float(tally[first])
    while last < len(tally) and held + tally[last] < mean:
        held += float(tally[last])
        last += 1
    return first, last, held


def _grown(tally: Floats, start: int, mean: float) -> float:
    """How many bins from `start` on, the last one in part, hold the mean."""
    running = np.cumsum(tally[start:])
    whole = int(np.searchsorted(running, mean))
    if whole >= len(running):
        return float(len(running))
    before = float(running[whole - 1]) if whole else 0.0
    return whole + (mean - before) / float(running[whole] - before) if running[whole] > before else float(whole)


def _edge(low: float, high: float, bins: int, place: float) -> float:
    return min(max(low + (high - low) * (place / bins), low), high) if math.isfinite(place) else low
