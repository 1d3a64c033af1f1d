"""Is there a gap beside my arc that I am responsible for? (specs/12-line.md, Adoption). Pure.

A survey is a generator: it gives the node to ask next, takes that node's `Bound`, and returns the gap, or None. Empty
nodes that it passed are asked twice: only if none of them has changed in between was there a moment at which all of
them were empty with nothing on its way. `Unsettled` says that the answers do not fit together yet.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.rules import Bound, Standing

Survey = Generator[NodeId, Bound, Arc | None]


class Unsettled(Exception):
    """Bounds are on their way, or moved while they were asked for: ask again later."""


def surveys(holding: Holding, standing: Standing, me: NodeId) -> list[Survey]:
    """What this node has to find out, by its arc and its place in the order: nothing, one or two surveys."""
    rank = standing.rank(me)
    lefts, rights = tuple(reversed(standing.order[:rank])), standing.order[rank + 1 :]
    if holding.arc is None:
        return [survey_everyone(holding, standing, rights)] if rank == 0 else []
    found: list[Survey] = []
    if holding.arc.first != FIRST:
        found.append(survey_left(holding, standing, lefts))
    if holding.arc.last != LAST:
        found.append(survey_right(holding, standing, rights))
    return found


def survey_left(holding: Holding, standing: Standing, lefts: Sequence[NodeId]) -> Survey:
    """The gap between the next arc to the left and our own; `lefts`: the nodes left of us, the nearest first."""
    assert holding.arc is not None
    first = holding.arc.first
    passed: list[tuple[NodeId, Bound]] = []
    begin: Location | None = FIRST
    for node in lefts:
        bound = yield from _ask(standing, node)
        if bound.right_bound is not None and bound.right_bound.next() == first:
            return None
        _settled(holding, Side.LEFT, node, bound)
        if bound.right_bound is not None:
            if bound.right_bound >= first:
                raise Unsettled(f"{address_of(node)} says that its arc reaches into this node's")
            begin = bound.right_bound.next()
            break
        passed.append((node, bound))
    yield from _confirmed(passed)
    assert begin is not None
    return Arc(begin, Location.from_number(first.number - 1))


def survey_right(holding: Holding, standing: Standing, rights: Sequence[NodeId]) -> Survey:
    """From our arc to the line's end, if nobody to the right of us has an arc."""
    assert holding.arc is not None
    if not (yield from _all_empty(holding, standing, rights)):
        return None
    begin = holding.arc.last.next()
    assert begin is not None
    return Arc(begin, LAST)


def survey_everyone(holding: Holding, standing: Standing, others: Sequence[NodeId]) -> Survey:
    """The whole line, for the first node in the order, if nobody at all has an arc."""
    return WHOLE_LINE if (yield from _all_empty(holding, standing, others)) else None


def _all_empty(holding: Holding, standing: Standing, nodes: Sequence[NodeId]) -> Generator[NodeId, Bound, bool]:
    passed: list[tuple[NodeId, Bound]] = []
    for node in nodes:
        bound = yield from _ask(standing, node)
        if bound.right_bound is not None:
            return False
        _settled(holding, Side.RIGHT, node, bound)
        passed.append((node, bound))
    yield from _confirmed(passed)
    return True


def _ask(standing: Standing, node: NodeId) -> Generator[NodeId, Bound, Bound]:
    """A node's answer. A founder that has not registered owns its founding arc; there is nobody to ask."""
    if standing.current(node) is None:
        seat = standing.founding_arc(node)
        return Bound(None if seat is None else seat.last, 0)
    return (yield node)


def _settled(holding: Holding, side: Side, node: NodeId, bound: Bound) -> None:
    if bound.is_open:
        raise Unsettled(f"a bound of {address_of(node)} is on its way")
    if holding.is_open(side):
        raise Unsettled("a bound of this node is on its way")


def _confirmed(passed: Sequence[tuple[NodeId, Bound]]) -> Generator[NodeId, Bound, None]:
    """Ask the empty nodes once more: none of them may have changed."""
    for node, before in passed:
        if (yield node) != before:
            raise Unsettled(f"the bounds of {address_of(node)} moved during the survey")
