"""Who is in this cluster: RequestTable (39).

Who stands on the line, and in which order, says the cluster's log; what each says of itself, the roster.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import FIRST, Location
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import Packet, RequestTable, RespondTable, Status


class Members:
    """Answers about members."""

    def __init__(self, own: OwnStatus, roster: Roster, registry: Callable[[], Registry]) -> None:
        self._own = own
        self._roster = roster
        self._registry = registry

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestTable, self._on_table)

    def table(self) -> list[Status]:
        """A status of every node on the line, from left to right, those that own nothing included.

        One that was never heard stands there unsigned, with Lamport time 0; a founder with its founding arc.
        """
        return [self._own.signed() if node == self._own.me else self._status_of(node) for node in self._registry().order]

    def _status_of(self, node: NodeId) -> Status:
        heard = self._roster.status(node)
        if heard is not None:
            return heard
        registry = self._registry()
        known, founding = registry.current(node), registry.founding_arc(node)
        return Status(
            lamport=0,
            node=node,
            incarnation=NO_INCARNATION if known is None else known.incarnation,
            boot=0,
            address=address_of(node),
            left_fence=None if founding is None or founding.first == FIRST else Location.from_number(founding.first.number - 1),
            right_bound=None if founding is None else founding.last,
        )

    async def _on_table(self, _packet: RequestTable, peer: str) -> Packet:
        # Nodes have the log themselves: what was never heard tells them nothing, and while a cluster starts that is most.
        is_node = node_of(peer) is not None
        return RespondTable(statuses=tuple(status for status in self.table() if status.lamport or not is_node))
