"""Whether to give a piece of one's arc to a neighbour, and how much (thesis Algorithm 5; specs/13-balance.md). Pure.

Algorithm 5 compares a node's used proportion with its neighbours' and moves items until the two meet. That is diffusion:
along a chain of N nodes it takes some N^2 rounds, and every node between gives and takes back. But every node knows
the whole table. If all shall be equally full, each has a *fair share*, its capacity's part of all that is stored; and
what must cross a bound is what lies left of it less the shares of those who stand there, its *flow*. Everybody
gives just the flow over their own bounds, so each byte crosses each bound once, and a node may pass on more than it
has: it gives what it can, and the rest when that has come.

    node        A     B     C     D            flow over a bound = (used left of it) - (shares left of it)
    used       40     0     0     0
    share      10    10    10    10
    flow          30    20    10               A gives B 30, B gives C 20, C gives D 10

A flow does not change when something moves on one side of its bound, so old news of far nodes do little harm. Where the table
ends for us, at a neighbour that is not heard or takes nothing, the line is cut, and shares are those of the piece: where the
piece is two nodes, the rule is Algorithm 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.peer.line.ends import Side

TOLERANCE = 0.05
"""Nodes are in balance when their used proportions are within this of the mean, of the mean."""
FLOW_TOLERANCE = TOLERANCE * 0.4
"""Of the smaller share at a bound: flows below it are left alone. A node has two bounds: both together, and the news
that are a little old, stay below TOLERANCE."""
IMBALANCE_MIN = 2 * FLOW_TOLERANCE
"""Where nobody is farther from the mean, nobody gives anything: each byte of ownership that passes has its copies moved as well."""
BYTES_MIN = 64 * 1024
"""Flows below it are left alone: it is one full record."""
FILL_MAX = 0.9
"""Nobody is filled above this by balancing: a node that is that full needs the rest for its own writers."""


@dataclass(frozen=True, slots=True)
class NodeFill:
    """How full a node is, as far as is known here. `open`: it is heard, its fill is known, and it would take a piece."""

    used: int
    capacity: int
    open: bool = True


@dataclass(frozen=True, slots=True)
class Give:
    """Give about so many bytes to the neighbour on that side. `is_rest`: whoever gives shall own nothing."""

    side: Side
    bytes: int
    is_rest: bool = False


def fair_shares(fills: Sequence[NodeFill]) -> list[float]:
    """What each of these nodes would hold if all were equally full."""
    capacity = sum(fill.capacity for fill in fills)
    used = sum(fill.used for fill in fills)
    return [used * fill.capacity / capacity if capacity else 0.0 for fill in fills]


def gives(line: Sequence[NodeFill], me: int, changes: Sequence[int] = ()) -> list[Give]:
    """What the node at index `me` of the line should give now: to each side at most once; nothing if all is well.

    `changes`: how much the news of each node have changed since all of them were heard (news.py).
    """
    first, last = piece_around(line, me)
    piece = line[first : last + 1]
    here = me - first
    changed = changes[first : last + 1] if changes else [0] * len(piece)
    spare = piece[here].used - BYTES_MIN
    if imbalance(piece) <= IMBALANCE_MIN:
        return []
    shares = fair_shares(piece)
    found: list[Give] = []
    leftwards = flow(piece, here - 1)
    wanted = [(leftwards + piece[here].used - shares[here], Side.RIGHT, here), (-leftwards, Side.LEFT, here - 1)]
    # The larger need first: what is given to one side is gone for the other.
    for amount, side, bound in sorted(wanted, key=lambda want: -want[0]):
        target = here + (1 if side is Side.RIGHT else -1)
        if amount <= 0 or not 0 <= target < len(piece):
            continue
        amount = min(amount - _doubt(piece, bound, changed), spare, _room(piece[target]))
        if amount >= max(BYTES_MIN, FLOW_TOLERANCE * min(shares[here], shares[target])):
            found.append(Give(side, int(amount)))
            spare -= int(amount)
    return found


def the_rest(line: Sequence[NodeFill], me: int) -> list[Give]:
    """What goes from who shall own nothing: what it has, to either open neighbour that has room; the one with more room first."""
    first, last = piece_around(line, me)
    rooms = {side: _room(line[at]) for side, at in ((Side.LEFT, me - 1), (Side.RIGHT, me + 1)) if first <= at <= last}
    sides = sorted((side for side, room in rooms.items() if room >= BYTES_MIN), key=lambda side: -rooms[side])
    return [Give(side, int(min(line[me].used, rooms[side])), is_rest=True) for side in sides]


def flow(piece: Sequence[NodeFill], bound: int) -> float:
    """What must cross the right bound of the node at index `bound`, rightwards if positive; 0 at both ends of the piece."""
    shares = fair_shares(piece)
    return sum(fill.used - share for fill, share in zip(piece[: bound + 1], shares[: bound + 1], strict=True))


def imbalance(line: Sequence[NodeFill]) -> float:
    """The largest distance of a node's used proportion from that of all, of that; 0 if nothing is stored."""
    shares = fair_shares(line)
    return max((abs(fill.used - share) / share for fill, share in zip(line, shares, strict=True) if share > 0), default=0.0)


def piece_around(line: Sequence[NodeFill], me: int) -> tuple[int, int]:
    """First and last index of the nodes around `me` that can pass something on to each other."""
    first = last = me
    while first > 0 and line[first - 1].open:
        first -= 1
    while last + 1 < len(line) and line[last + 1].open:
        last += 1
    return first, last


def _room(fill: NodeFill) -> float:
    return fill.capacity * FILL_MAX - fill.used


def _doubt(piece: Sequence[NodeFill], bound: int, changed: Sequence[int]) -> float:
    """How far the flow over a bound may be wrong: what is wrong on the left counts by the right side's part of all
    shares, and the other way round."""
    capacity = sum(fill.capacity for fill in piece)
    left = sum(fill.capacity for fill in piece[: bound + 1]) / capacity if capacity else 0.0
    return abs(sum(changed[: bound + 1])) * (1 - left) + abs(sum(changed[bound + 1 :])) * left
