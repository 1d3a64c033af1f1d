"""The ports of a log on a node that runs: other nodes by its connections, the world as its line and its roster see it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.consensus import Learn, Message
from scenefold.consensus.packets import packet_of, pages_of
from scenefold.peer.logs.intake import Intake
from scenefold.peer.logs.logs import Logs
from scenefold.peer.membership.roster import Roster
from scenefold.peer.peers import Peers
from scenefold.peer.routing import Routing
from scenefold.wire import Member, Packet
from scenefold.world import Clock, Links, Priority, QuietLog

SEND_S_MAX = 2.0
"""For a packet to leave, with the connection that it may take, or for a piece of what is before it. Who is silent holds up nobody but himself; who is
slow is not gone."""
LOOK_S = 0.1
"""So long what the roster says of everybody is not asked for anew: a log looks at each event."""

WasRemoved = Callable[[bytes], bool]
"""Whether the cluster's log has removed an incarnation: none comes back."""

_log = logging.getLogger("scenefold.peer.logs")


class LinkCarrier:
    """A `Carrier` for any log; what it sends is counted in `logs`."""

    def __init__(self, clock: Clock, peers: Peers, logs: Logs) -> None:
        self._clock, self._peers, self._logs = clock, peers, logs
        self._quiet = QuietLog(_log)

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        for packet in self._packets(message, more):
            await self._tell(target, packet)

    def _packets(self, message: Message, more: Sequence[Learn]) -> Iterable[Packet]:
        return pages_of((message, *more)) if isinstance(message, Learn) else (packet_of(message),)

    async def _tell(self, target: NodeId, packet: Packet) -> None:
        try:
            await self._peers.tell(target, Priority.HIGH, packet, SEND_S_MAX, while_it_moves=True)
            self._logs.packets_sent += 1
        except (Refused, PeerFault) as problem:
            # Its program is older, or its key counts no more: this node reaches it as little as one that is away.
            raise Unreachable(problem.what, where=address_of(target)) from problem
        except LocalFault as problem:
            self._quiet.say(self._clock.now(), address_of(target), type(packet).__name__, f"something of a log is not sent: {problem}")


class NodeSurroundings:
    """`Surroundings` for any log."""

    def __init__(self, clock: Clock, me: NodeId, routing: Routing, roster: Roster, was_removed: WasRemoved) -> None:
        self._clock, self._me, self._routing, self._roster, self._was_removed = clock, me, routing, roster, was_removed
        self._alive: frozenset[NodeId] = frozenset()
        self._looked_at = float("-inf")

    def line(self) -> tuple[NodeId, ...]:
        return self._routing.members

    def reachable(self) -> frozenset[NodeId]:
        return self.alive()

    def alive(self) -> frozenset[NodeId]:
        now = self._clock.now()
        if now - self._looked_at >= LOOK_S:
            self._alive = frozenset(self._roster.alive()) - {self._me}
            self._looked_at = now
        return self._alive

    def is_gone(self, member: Member) -> bool:
        return self._was_removed(member.incarnation)

    def silent_s(self, node: NodeId) -> float | None:
        """How long ago there was a sign of life of a node; None if that is not known."""
        heard_at = self._roster.heard_at(node)
        return None if heard_at is None else self._clock.now() - heard_at

    def is_current(self, member: Member) -> bool:
        """Whether a node is this incarnation, as far as is known here."""
        return self._roster.incarnation(member.node) == member.incarnation


class NodePorts:
    """All that logs need of their node: one of each for all of them."""

    def __init__(
        self, clock: Clock, me: NodeId, peers: Peers, routing: Routing, roster: Roster, links: Links, was_removed: WasRemoved
    ) -> None:
        self.logs = Logs()
        self.carrier = LinkCarrier(clock, peers, self.logs)
        self.around = NodeSurroundings(clock, me, routing, roster, was_removed)
        self.intake = Intake(clock, self.logs)
        links.on_lost = self._lost

    def _lost(self, address: str, priority: Priority) -> None:
        """A connection is refused, or has ended: what was sent to that node may not have come."""
        if priority is Priority.HIGH:
            self.logs.lost(node_id_of(address))
