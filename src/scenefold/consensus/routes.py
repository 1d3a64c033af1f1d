"""How a proposal travels: away from its originator in both directions of the line, and back (specs/25-consensus.md, Packets).

A route is a way to reach everybody with few packets, and nothing else. What counts is the set of facts that comes home, so
a route may be out of date, its members may have changed places, and one may be visited twice.
"""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet

from scenefold.base.ids import NodeId

Route = tuple[NodeId, ...]


def in_line(nodes: Iterable[NodeId], line: Route) -> Route:
    """Nodes in the order of the line, those that are not on it last."""
    ranks = {node: rank for rank, node in enumerate(line)}
    return tuple(sorted(nodes, key=lambda node: (ranks.get(node, len(ranks)), node)))


def arms(route: Route, origin: NodeId) -> tuple[Route, Route]:
    """Those left and those right of the originator, the nearest first."""
    rank = route.index(origin)
    return route[:rank][::-1], route[rank + 1 :]


def beyond(route: Route, origin: NodeId, me: NodeId) -> Route:
    """Those that lie away from the originator, the nearest first; nobody if this node, or the originator, is not on the route."""
    if me == origin or me not in route or origin not in route:
        return ()
    left, right = arms(route, origin)
    arm = left if me in left else right
    return arm[arm.index(me) + 1 :]


def homeward(route: Route, origin: NodeId, me: NodeId) -> Route:
    """Those between this node and the originator, the nearest first, and last the originator."""
    if me == origin or me not in route or origin not in route:
        return (origin,)
    left, right = arms(route, origin)
    arm = left if me in left else right
    return (*arm[: arm.index(me)][::-1], origin)


def first_of(nodes: Iterable[NodeId], reachable: AbstractSet[NodeId]) -> NodeId | None:
    """The nearest that can be reached."""
    return next((node for node in nodes if node in reachable), None)


def straight_to(route: Route, origin: NodeId, target: NodeId) -> Route:
    """A route that names everybody, as it must, and on which this target is the end of an arm, directly behind the originator's others."""
    others = tuple(node for node in route if node not in (origin, target))
    return (*others, origin, target)
