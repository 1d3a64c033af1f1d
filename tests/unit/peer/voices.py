"""What nodes of a village say to each other, opened; and voices that say what a test likes."""

from __future__ import annotations

from random import Random

import trio
import trio.testing

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.crypto import DatagramKey, SealingKey, head_of
from scenefold.peer.datagrams import Exchange, Kind, unpacked
from scenefold.wire import Packet, decode_packet, encode_packet
from unit.peer.village import Node, Village, sealing_key_of

CLUSTER = bytes(16)
HIGH = 1


def opened(source: str, target: str, data: bytes) -> Packet | None:
    """The packet of a datagram on the high port; None if it is a challenge or an answer to one."""
    sender, hearer = node_id_of(source), node_id_of(target)
    secret = sealing_key_of(hearer).agree(sealing_key_of(sender).public)
    content = unpacked(DatagramKey(secret, CLUSTER, HIGH, sender, hearer, head_of(data).salt).open(data))
    return decode_packet(content.packet) if content.kind is Kind.PACKET else None


class Voice:
    """Speaks on the high port as a node that does not run: answers challenges, and says what a test likes."""

    def __init__(self, them: Village, sender: NodeId, key: SealingKey | None = None) -> None:
        self._them, self._sender = them, sender
        own = key or sealing_key_of(sender)
        self._exchange = Exchange(sender, CLUSTER, HIGH, own, lambda node: sealing_key_of(node).public, Random(sender).randbytes)
        self._source = address_of(sender)

    def sealed(self, packet: Packet | bytes, target: NodeId) -> bytes:
        data = self._exchange.seal(target, packet if isinstance(packet, bytes) else encode_packet(packet))
        assert data is not None
        return data

    async def say(self, packet: Packet | bytes, target: NodeId) -> None:
        """Say something to a node, and answer what it asks back."""
        ether = self._them.ether
        sent = len(ether.sent)
        ether.send(self.sealed(packet, target), self._source, address_of(target))
        for _ in range(3):
            await trio.testing.wait_all_tasks_blocked()
            for source, to, data in list(ether.sent[sent:]):
                if (node_id_of(source), to) == (target, self._source):
                    for reply in self._exchange.take(data, source, trio.current_time())[1].replies:
                        ether.send(reply, self._source, address_of(target))
            sent = len(ether.sent)


async def say(node: Node, packet: Packet, target: NodeId) -> None:
    """A node that runs says something that it would not say by itself."""
    await node.gossip._datagrams.send(encode_packet(packet), target)
    await trio.testing.wait_all_tasks_blocked()
