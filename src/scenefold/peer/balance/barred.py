"""Who could write nothing that it owns, since its blacklist allows no other node to hold copies: it is given nothing (specs/13-balance.md, Barred).

That is its administrator's will for that node, but not for what others own. Which spaces there are plays no part: nodes know different
ones, and must come to the same answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scenefold.base.ids import NodeId
from scenefold.base.prefixes import AddressPrefix, forbids
from scenefold.peer.balance.seams import HasRegistry
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus

BARRED_REST_S = 30.0
"""So long a node has been barred before it gives away what it owns: a slip of the hand is taken back sooner."""


def barred(nodes: Sequence[NodeId], blacklists: Mapping[NodeId, Sequence[AddressPrefix]]) -> frozenset[NodeId]:
    """Of these nodes those whose blacklists allow none of the others."""
    return frozenset(
        node
        for node in nodes
        if len(nodes) > 1 and (listed := blacklists.get(node, ())) and all(forbids(listed, other, owner=node) for other in nodes)
    )


class Barred:
    """The same of all nodes in the log, by their newest statuses. Used from the Trio thread only."""

    def __init__(self, roster: Roster, log: HasRegistry, own: OwnStatus) -> None:
        self._roster = roster
        self._log = log
        self._own = own

    def now(self, *, without: NodeId | None = None) -> frozenset[NodeId]:
        """Who is barred. `without`: a node that is leaving, and holds nothing afterwards."""
        nodes = [node for node in self._log.registry.order if node != without]
        return barred(nodes, {node: listed for node in nodes if (listed := self._blacklist(node))})

    def _blacklist(self, node: NodeId) -> tuple[AddressPrefix, ...]:
        if node == self._own.me:
            return self._own.blacklist.prefixes
        status = self._roster.status(node)
        return () if status is None else status.blacklist
