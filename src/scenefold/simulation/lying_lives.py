"""What a lying node does to make the living look dead, and the dead alive (specs/17-simulation.md, Lies).

It broadcasts its own status without end, as if the dice said so each time. Asked whether it hears another, it says no, or brings
a proof: of its own making, or one that the other signed for an earlier question.
"""

from __future__ import annotations

from collections import OrderedDict

from scenefold.base.ids import NodeId
from scenefold.crypto import ALIVE_DOMAIN
from scenefold.peer import NodeContext
from scenefold.peer.membership.proofs import signable
from scenefold.simulation import laws
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.liar import Liar, Scope
from scenefold.simulation.lying_answers import Honest, overlay
from scenefold.wire import Packet, PingBroadcast, ProbeFor, ProbeResult, encode_packet

KEPT_MAX = 64


class LyingLives:
    """Of one liar."""

    def __init__(self, liar: Liar, cluster: Cluster) -> None:
        self._liar = liar
        self._cluster = cluster
        self._context: NodeContext | None = None
        self._kept: OrderedDict[NodeId, bytes] = OrderedDict()

    def possess(self, context: NodeContext) -> None:
        """Speak for one life of the node."""
        overlay(context, ProbeFor, self._probed)
        self._context = context

    async def flood(self) -> None:
        """Broadcast once more than the dice say."""
        context = self._context
        if context is None or context is not self._liar.node.context:
            return
        self._liar.lies.told["broadcasts"] += 1
        data, datagrams = encode_packet(PingBroadcast((context.own.signed(),))), context.gossip._datagrams
        for node in list(context.roster.peers):
            if not datagrams.is_open:
                # It ends just now.
                return
            await datagrams.send(data, node)

    async def _probed(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, ProbeFor) or not isinstance(answer, ProbeResult):
            return answer
        node = packet.target.node
        kept = self._kept.get(node)
        if answer.proof:
            self._kept[node] = answer.proof
            if len(self._kept) > KEPT_MAX:
                self._kept.popitem(last=False)
        if not self._liar.chance(Scope.STATUSES):
            return answer
        self._liar.lies.told["proofs"] += 1
        match self._liar.dice.randrange(3):
            case 0:
                proof = b""
            case 1 if kept is not None:
                proof = kept
            case _:
                proof = self._liar.key.sign(ALIVE_DOMAIN, signable(packet.target, packet.nonce))
        self._look_at(packet, proof, peer)
        return ProbeResult(target=packet.target, proof=proof)

    def _look_at(self, packet: ProbeFor, proof: bytes, peer: str) -> None:
        """Whoever is told this does not believe it."""
        slot = self._cluster.slot_of(int(peer.removeprefix("node:")))
        node, target = self._cluster.running.get(slot), packet.target
        if node is None or node.context is None or target.node == self._liar.node.node_id:
            return
        if node.context.gossip.proofs.is_right(target, packet.nonce, proof):
            told = f"n{slot} believes n{self._liar.node.slot} that n{self._cluster.slot_of(target.node)} lives"
            self._cluster.watch.violated(laws.VERIFIED, told, slots=(slot, self._liar.node.slot))
