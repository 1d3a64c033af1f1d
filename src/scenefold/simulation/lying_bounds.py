"""What a lying node says of bounds: it gives away what is another's, and leaves others gaps there (specs/17-simulation.md, Lies).

As a giver it offers a neighbour, with its own arc, what lies beyond it and is somebody else's, and has it claim that at once. Asked
for its bound, it names one behind somebody else's arc, so that all of that seems to be nobody's. Only what its victim has heard of
the true owner can keep it from believing that; so the lie is told where it has heard something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer import NodeContext
from scenefold.peer.handlers import node_of
from scenefold.peer.line.holding import handover_id
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.disks import arc_of
from scenefold.simulation.liar import Liar, Scope
from scenefold.simulation.lying_answers import Honest, overlay
from scenefold.wire import BoundConfirmed, ClaimRange, ConfirmBound, DropHandover, HandoverReply, OfferRange, Packet
from scenefold.world import Priority

OFFER_S_MAX = 2.0
UNANSWERED_S = 15.0
"""A claim that was not answered may be judged so long after."""


class LyingBounds:
    """Of one liar."""

    def __init__(self, liar: Liar, cluster: Cluster) -> None:
        self._liar = liar
        self._cluster = cluster
        self._context: NodeContext | None = None
        self._ask: Any = None
        self._takes_nothing_until = 0.0

    def possess(self, context: NodeContext) -> None:
        """Confirm bounds for one life of the node."""
        overlay(context, ConfirmBound, self._confirm)
        overlay(context, OfferRange, self._taken)
        overlay(context, ClaimRange, self._taken)
        peers: Any = context.peers
        self._context, self._ask = context, peers.ask

    async def offer_others(self) -> None:
        """Give a neighbour what is another's."""
        context = self._context
        if context is None or context is not self._liar.node.context or not self._liar.chance(Scope.HANDOVERS):
            return
        registry = context.cluster_log.registry
        if not registry.stands(context.me):
            return
        rank, order = registry.rank(context.me), registry.order
        for receiver, beyond in ((rank + 1, order[:rank][::-1]), (rank - 1, order[rank + 1 :])):
            if not 0 <= receiver < len(order):
                continue
            found = self._node(order[receiver])
            piece = None if found is None else self._piece(found, beyond)
            if found is not None and piece is not None:
                with trio.move_on_after(OFFER_S_MAX):
                    await self._give(context, found, piece)

    async def _give(self, context: NodeContext, receiver: Node, piece: Arc) -> None:
        registered = context.cluster_log.registry.current(receiver.node_id)
        if registered is None:
            return
        line: Any = context.line
        name = handover_id(line._parts.keeper.holding.revision + 1, self._liar.dice.randbytes(8))
        position = context.cluster_log.registry.position
        offer = OfferRange(name, context.own.member, registered.member, piece.first, piece.last, 0, 0, position)
        self._liar.lies.told["what is another's is offered"] += 1
        self._takes_nothing_until = self._cluster.net.now + UNANSWERED_S
        try:
            for packet in (offer, ClaimRange(name, piece.first, piece.last), DropHandover(name)):
                reply = await self._ask(receiver.node_id, Priority.LOW, packet, HandoverReply, OFFER_S_MAX)
                if reply.reason:
                    self._takes_nothing_until = 0.0
                    return
        except (Refused, Unreachable, PeerFault, RuntimeError):
            # The last: its life has ended in the midst of it, and with it what it asks by.
            return

    async def _taken(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        if isinstance(packet, OfferRange | ClaimRange) and self._cluster.net.now < self._takes_nothing_until:
            return HandoverReply(handover=packet.handover, reason=int(RejectReason.BUSY), text="it is lying just now")
        return await honest(packet, peer)

    async def _confirm(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, ConfirmBound) or not isinstance(answer, BoundConfirmed) or answer.reason:
            return answer
        context, asker = self._context, self._node(node_of(peer))
        if context is None or asker is None or not self._liar.chance(Scope.HANDOVERS):
            return answer
        registry = context.cluster_log.registry
        if not registry.stands(context.me) or registry.rank(asker.node_id) < registry.rank(context.me):
            return answer
        gap = self._piece(asker, registry.order[: registry.rank(context.me)][::-1])
        if gap is None:
            return answer
        self._liar.lies.told["a bound behind another's arc"] += 1
        bound = FIRST if gap.first == FIRST else Location.from_number(gap.first.number - 1)
        return replace(answer, right_bound=bound, pending=False)

    def _piece(self, victim: Node, beyond: Sequence[NodeId]) -> Arc | None:
        """From the far end of another's arc, of which the victim has heard, to the victim's own arc."""
        context, own = victim.context, arc_of(victim.disk)
        if context is None or own is None:
            return None
        heard = context.roster.arcs()
        for node in beyond:
            owner = self._node(node)
            arc = None if owner is None else arc_of(owner.disk)
            if arc is None or heard.get(node) != arc:
                continue
            if arc.last < own.first:
                return Arc(arc.first, Location.from_number(own.first.number - 1))
            if own.last < arc.first:
                return Arc(Location.from_number(own.last.number + 1), arc.last)
        return None

    def _node(self, node: NodeId | None) -> Node | None:
        """A node that runs."""
        return None if node is None else self._cluster.running.get(self._cluster.slot_of(node))
