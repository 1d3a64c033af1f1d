"""Who could not write what it owned, since its blacklist leaves it too few holders of copies: it is given nothing (specs/13-balance.md, Barred).

A place that is owned by such a node refuses writes, and what lies there counts on its own disk alone. That is its administrator's
will for that node, but not for what other nodes own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from scenefold.base.ids import NodeId
from scenefold.base.prefixes import AddressPrefix, forbids
from scenefold.peer.balance.seams import HasRegistry
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus

Blacklists = Mapping[NodeId, tuple[AddressPrefix, ...]]


def barred(nodes: Sequence[NodeId], blacklists: Blacklists, needed: int) -> frozenset[NodeId]:
    """Of these nodes those whose blacklists allow fewer of the others than a write needs beside its owner; nobody where that holds for all.

    `needed`: nodes that must have a record before a write counts, the owner among them. Where there are fewer nodes than that, all of
    them are enough: that is nobody's blacklist's doing.
    """
    others = min(needed, len(nodes)) - 1
    found = {
        node
        for node in nodes
        if (listed := blacklists.get(node, ())) and sum(not forbids(listed, other, owner=node) for other in nodes) < others
    }
    return frozenset() if len(found) == len(nodes) else frozenset(found)


class Barred:
    """The same of all nodes in the log, by their newest statuses. Used from the Trio thread only."""

    def __init__(self, roster: Roster, log: HasRegistry, own: OwnStatus, needed: Callable[[], int]) -> None:
        """`needed`: what the most demanding of all known spaces asks of a write."""
        self._roster = roster
        self._log = log
        self._own = own
        self._needed = needed
        self._about: tuple[object, ...] = ()
        self._found: frozenset[NodeId] = frozenset()

    def now(self, *, without: NodeId | None = None) -> frozenset[NodeId]:
        """Who is barred. `without`: a node that is leaving, and holds nothing afterwards."""
        nodes = tuple(node for node in self._log.registry.order if node != without)
        blacklists = {node: listed for node in nodes if (listed := self._blacklist(node))}
        about = nodes, blacklists, self._needed()
        if about != self._about:
            self._found, self._about = barred(*about), about
        return self._found

    def _blacklist(self, node: NodeId) -> tuple[AddressPrefix, ...]:
        if node == self._own.me:
            return self._own.blacklist.prefixes
        status = self._roster.status(node)
        return () if status is None else status.blacklist
