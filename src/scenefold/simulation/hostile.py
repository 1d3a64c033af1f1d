"""Hostile faults: a network that plays datagrams again and changes them, and a member that answers reads with wrong bytes.

The network keeps what was sent lately and sends it again, now and then with a bit turned over, to whom it was for. A liar is a
node like all others, but for the records in its answers: other bytes, or another record. What an owner withholds or puts
back to an older version cannot be told while there is one copy, and is not done here.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import trio

from scenefold.crypto import PLACED_BY_NODE, RecordHeader, object_of
from scenefold.peer.handlers import Handlers
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.faults import Fault, Kind
from scenefold.wire import DAMAGED_RECORD, GetMany, GetManyReply, Packet, RecordBytes

FLIPPED = 0.3
"""Share of the datagrams that are played again with a bit turned over."""
LIES = 0.3
"""Share of the records that a liar answers wrongly."""
KEPT_MAX = 32
"""Records that a liar remembers, to give them for others."""
LOOK_S = 0.2


class HostileFaults:
    """The network and liars at work."""

    def __init__(
        self, cluster: Cluster, begins: Callable[[Fault], None], ends: Callable[[Fault], None], is_over: Callable[[], bool]
    ) -> None:
        self._cluster = cluster
        self._begins, self._ends, self._is_over = begins, ends, is_over
        self._dice = random.Random(f"hostile/{cluster.net.seed}")
        self._liars: dict[int, _Liar] = {}

    def lies_in_wait(self, fault: Fault) -> None:
        """What is played again was sent before the fault begins."""
        if fault.kind is Kind.REPLAY:
            self._cluster.net.keep_datagrams()

    async def befall(self, fault: Fault) -> None:
        if fault.kind is Kind.REPLAY:
            await self._replay(fault)
        else:
            await self._lie(fault)

    async def _replay(self, fault: Fault) -> None:
        self._begins(fault)
        while self._cluster.net.now < fault.end_s and not self._is_over():
            flip = self._dice.random() < FLIPPED
            self._cluster.net.play_again(self._dice, self._flipped if flip else None)
            await trio.sleep(1 / fault.amount)
        self._ends(fault)

    async def _lie(self, fault: Fault) -> None:
        node = self._cluster.nodes[fault.slots[0]]
        liar = self._liars.setdefault(node.slot, _Liar(node, self._dice, self._told))
        self._begins(fault)
        liar.at_work += 1
        try:
            while self._cluster.net.now < fault.end_s and not self._is_over():
                # It lies on after a restart.
                liar.possess()
                await trio.sleep(LOOK_S)
        finally:
            liar.at_work -= 1
        self._ends(fault)

    def _told(self) -> None:
        self._cluster.watch.lied_at = self._cluster.net.now
        self._cluster.watch.counts["lies"] += 1

    def _flipped(self, data: bytes) -> bytes:
        return flipped(data, self._dice)


class _Liar:
    """What answers reads in place of a node's own handler. It lies while it is at work."""

    def __init__(self, node: Node, dice: random.Random, told: Callable[[], None]) -> None:
        self.at_work = 0
        self._node = node
        self._dice = dice
        self._told = told
        self._kept: deque[RecordBytes] = deque(maxlen=KEPT_MAX)
        self._possessed: Handlers | None = None

    def possess(self) -> None:
        """Take the place of the handler of the node's present life."""
        context = self._node.context
        if context is None or context.handlers is self._possessed:
            return
        self._possessed = context.handlers
        honest, senders = context.handlers._table[GetMany]

        async def lie(packet: Packet, peer: str) -> Packet | None:
            answer = await honest(packet, peer)
            return self._twisted(answer) if self.at_work and isinstance(answer, GetManyReply) else answer

        context.handlers._table[GetMany] = (lie, senders)

    def _twisted(self, answer: GetManyReply) -> GetManyReply:
        return replace(answer, records=tuple(self._wrong(record) for record in answer.records))

    def _wrong(self, record: RecordBytes | None) -> RecordBytes | None:
        if record is None or record == DAMAGED_RECORD:
            return record
        kept, dice = list(self._kept), self._dice
        self._kept.append(record)
        if dice.random() >= LIES:
            return record
        self._told()
        match dice.randrange(4):
            case 0:
                return replace(record, ciphertext=flipped(record.ciphertext, dice))
            case 1:
                return replace(record, signature=flipped(record.signature, dice))
            case 2:
                return replace(record, header=flipped(record.header, dice))
            case _:
                # An older version of the same one would be a rollback, which nobody can tell.
                others = [other for other in kept if _place_of(other) != _place_of(record)]
                return dice.choice(others) if others else replace(record, ciphertext=record.ciphertext[:-1])


def _place_of(record: RecordBytes) -> tuple[int, int, bytes]:
    header = RecordHeader.decode(record.header)
    name = object_of(header) if header.placement == PLACED_BY_NODE else header.location
    return header.scene, header.space, name


def flipped(data: bytes, dice: random.Random) -> bytes:
    """The bytes with one bit turned over."""
    bit = dice.randrange(8 * len(data))
    return data[: bit // 8] + bytes((data[bit // 8] ^ 1 << bit % 8,)) + data[bit // 8 + 1 :]
