"""Whether numbers can still tell the places of a space apart, where its log puts it (specs/16-scene-log.md, Transforms).

float64 has 53 bits. A box that lies far from the origin, compared with its size, has fewer left for what is in it: at 1e15 a
box of one metre has eight places along an axis. An entry that would bring a space there is refused, for what is put there
would lie wrong for good.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.limits import SPACE_PLACE_BITS
from scenefold.scene.log.space import LoggedSpace

_SPARE_BITS = 3
"""Home times factor, plus offset, is rounded twice, the offset once before: with so many bits more no two places meet."""


class Loss(NamedTuple):
    """What is lost, and what to do, in words."""

    what: str
    remedy: str


def lost_by(space: LoggedSpace) -> Loss | None:
    """What is lost where the space lies now; None if nothing is."""
    low, high = space.world_box
    if not all(map(math.isfinite, (space.transform.factor, *space.transform.offset, *low, *high))):
        return Loss(f"space {space.id} would leave the range of numbers", "move or scale it by less")
    if space.transform.factor < sys.float_info.min:
        what = f"space {space.id} would be scaled by {space.transform.factor:g} in all, less than numbers hold with all their digits"
        return Loss(what, "make it less small")
    home = ([corner[axis] * space.transform.factor for corner in (space.low, space.high)] for axis in range(space.dimensions))
    for axis, scaled in enumerate(home):
        if not _resolved(low[axis], high[axis], (*scaled, space.transform.offset[axis])):
            where = f"from {low[axis]:g} to {high[axis]:g} on axis {axis}"
            what = f"space {space.id} would lie {where}, so far off for its size that numbers cannot tell its places apart"
            return Loss(what, "scale it up first, or leave it nearer to the origin")
    return None


def _resolved(low: float, high: float, parts: Sequence[float]) -> bool:
    """Whether there are 2^SPACE_PLACE_BITS places between low and high, `parts` being what they were summed from."""
    largest = max(map(abs, (low, high, *parts)))
    # Halves, for the extent of the largest boxes is no number.
    return high / 2 - low / 2 >= math.ulp(largest) * 2.0 ** (SPACE_PLACE_BITS + _SPARE_BITS - 1)
