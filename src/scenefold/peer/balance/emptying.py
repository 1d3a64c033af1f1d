"""To whom a leaving node gives how much next (specs/13-balance.md, Leaving). Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from scenefold.peer.line.ends import Side

PORTION_BYTES_MAX = 64 * 1024 * 1024
"""Of one handover: so much at most has to be copied again if the neighbour dies."""
PORTION_BYTES_MIN = 64 * 1024
"""A neighbour with less room counts as full, unless that is all there is to give."""
DRAIN_FILL_MAX = 0.97
"""A leaving node may fill its neighbours further than balancing would: they pass it on."""


@dataclass(frozen=True, slots=True)
class Portion:
    """What goes next. `is_all`: everything that is left, and the arc with it."""

    side: Side
    bytes: int
    is_all: bool


def room_of(used: int, capacity: int) -> int:
    """Bytes that a neighbour may still get; below 0 if it has too much already."""
    return int(capacity * DRAIN_FILL_MAX) - used


def next_portion(rooms: Mapping[Side, int], left: int) -> Portion | None:
    """The next of the `left` bytes, to the neighbour with more room; None if nobody has any."""
    roomy = [side for side in Side if rooms.get(side, -1) >= min(left, PORTION_BYTES_MIN)]
    if not roomy:
        return None
    side = max(roomy, key=lambda side: rooms[side])
    size = min(rooms[side], PORTION_BYTES_MAX)
    return Portion(side, left, is_all=True) if left <= size else Portion(side, size, is_all=False)
