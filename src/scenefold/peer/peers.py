"""The other members, as this node asks them: by id, with our mini status, and with an ear for theirs."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.routing import Routing
from scenefold.wire import ROWS, Packet
from scenefold.world import Links, Priority, World

A = TypeVar("A", bound=Packet)
UNHEARD_S = 5.0
"""So long a member that was not heard yet may be one that lives."""


def priority_of(packet: Packet) -> Priority:
    """The port that the table of packets gives for this class."""
    return Priority.HIGH if "high" in ROWS[packet.TYPE].carrier else Priority.LOW


class Peers:
    """Requests to other members. What they answer keeps the roster fresh, and so does their silence."""

    def __init__(self, world: World, links: Links, own: OwnStatus, roster: Roster, routing: Routing) -> None:
        self._world = world
        self._links = links
        self._own = own
        self._roster = roster
        self._routing = routing

    async def ask(self, member: NodeId, priority: Priority, packet: Packet, answer: type[A], timeout: float) -> A:
        """Ask a member; Unreachable, Refused, or PeerFault if it answers with something else.

        A node may ask itself over the network, too, so that a service need not know which member it is.
        """
        address = address_of(member)
        try:
            reply = await self._links.request(address, priority, self._stamped(packet), timeout)
        except Unreachable:
            self._roster.note_refusal(member)
            raise
        if reply.mini_status is not None and reply.mini_status.node == member:
            self._roster.hear_mini(reply.mini_status, self._world.clock.now())
        if not isinstance(reply, answer):
            raise PeerFault(f"a {type(packet).__name__} was answered with a {type(reply).__name__}", where=address)
        return reply

    async def tell(self, member: NodeId, priority: Priority, packet: Packet, timeout: float, *, while_it_moves: bool = False) -> None:
        """Send a packet that has no answer; Unreachable if it cannot leave. `while_it_moves`: as of `Links.send`."""
        try:
            await self._links.send(address_of(member), priority, self._stamped(packet), timeout, while_it_moves=while_it_moves)
        except Unreachable:
            self._roster.note_refusal(member)
            raise

    def others(self, *, first: NodeId | None = None) -> list[NodeId]:
        """The other members in the order to ask them: `first`, those believed alive, the rest."""
        others = [member for member in self._routing.members if member != self._own.me]
        return sorted(others, key=lambda member: (member != first, not self._roster.is_believed_alive(member), member))

    def witnesses(self) -> list[NodeId]:
        """The other members that seem alive, so that they can tell what this node may not know; Refused (16) if it is none itself.

        One that was never heard counts for a while: this node may have started a moment ago.
        """
        if self._own.me not in self._routing.members:
            raise Refused(RejectReason.NOT_READY, "this node is no member of the cluster yet", remedy="try again in a while")
        now = self._world.clock.now()
        return [member for member in self._routing.members if member != self._own.me and self._may_live(member, now)]

    def _may_live(self, member: NodeId, now: float) -> bool:
        if self._roster.is_believed_alive(member):
            return True
        since = self._roster.proof_at(member)
        return self._roster.is_unheard(member) and since is not None and now - since < UNHEARD_S

    def _stamped(self, packet: Packet) -> Packet:
        return replace(packet, mini_status=self._own.mini())
