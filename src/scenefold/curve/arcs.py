"""A box of cells to few arcs of the line (specs/02-curves.md, Arcs).

The best cover of a box by k arcs is its *hull* on the line, from its first location to its last, without the
k - 1 longest *gaps*: runs of the line within the hull that lie outside the box. So we look for long gaps: down
the curve's tree level by level, keeping the nodes that the box cuts (the *frontier*). Children outside the box
are gaps, which grow when a neighbouring node is cut up further. What a deeper level finds is shorter than what
is known, so the search stops one level after enough gaps are known. Then two walks down the tree find where
each candidate truly begins and ends, and the longest stay out. Arcs begin and end in the box.

Bounds: when more than 4·limit + 256 nodes of a level are cut, only the limit + 32 with most outside the box are
cut up further and the others count as covered, which costs some tightness. A box that is exactly k <= limit arcs
cuts at most 2k nodes of any level, since an arc begins or ends in each: so it never comes to that, and its cover
is exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.base.location import LOCATION_BYTES
from scenefold.curve import arc_kernels

Words = npt.NDArray[np.uint64]

WORDS_BYTES = 3 * 8


def cover(low: Words, high: Words, inverse_one: npt.NDArray[np.uint32], levels: int, limit: int) -> list[tuple[bytes, bytes]]:
    """At most `limit` ascending arcs that cover the cells low..high of a curve with this one-level table."""
    hull, gaps, unit = arc_kernels.find_gaps(low, high, inverse_one, levels, limit)
    exact = unit == 0.0
    # An end may be off by a node at either side, so a shorter gap may turn out the longer one.
    candidates = _longest(gaps, limit - 1, len(gaps) if exact else 4 * limit + 64, 2.0 * unit)
    sides = arc_kernels.sides_of_gaps(candidates, exact, low, high, inverse_one, levels)
    sides = _longest(sides, limit - 1, limit - 1, 0.0)
    ends = np.concatenate([hull[:1], sides.reshape(-1, 3), hull[1:]])
    # Of three words of 64 bits the first 20 bytes are the location.
    text = ends.astype(">u8").tobytes()
    locations = [text[at : at + LOCATION_BYTES] for at in range(0, len(text), WORDS_BYTES)]
    return list(zip(locations[::2], locations[1::2], strict=True))


def _longest(runs: Words, wanted: int, count_max: int, growth: float) -> Words:
    """At most `count_max` runs, in order: those that may be among the `wanted` longest if each can grow by `growth`."""
    if len(runs) <= wanted:
        return runs
    if wanted == 0:
        return runs[:0]
    lengths = arc_kernels.lengths(runs)
    ranked = np.argsort(-lengths, kind="stable")[:count_max]
    least = lengths[ranked[wanted - 1]] - growth
    longest: Words = runs[np.sort(ranked[lengths[ranked] >= least])]
    return longest
