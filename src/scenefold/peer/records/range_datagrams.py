"""Range queries of other nodes in single datagrams, answered on UDP low (thesis C.4; specs/18-data.md, Ranges).

For looking quickly whether anything lies in a small piece: a question and its answer are one packet each, with no
connection. An answer that would not fit one is refused with reason 6, so that the asker halves its question. Whatever gets
lost is asked again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SealingPublicKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.datagrams import PACKET_BYTES_MAX, SealedDatagrams
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.records.ranges import Ranges, range_rejection
from scenefold.wire import MalformedPacket, Packet, QueryRange, decode_packet, encode_packet
from scenefold.world import Priority, QuietLog, World
from scenefold.world.surviving import surviving

ANSWER_LOCATIONS_MAX = 64
"""More than fit a datagram, so that an answer that was cut short never fits."""
QUESTIONS_MAX = 64
"""Questions that wait for their turn; beyond it they are dropped, as the network would do."""
ANSWERERS = 4
"""Questions that are answered at a time."""

P = TypeVar("P", bound=Packet)

_log = logging.getLogger("scenefold.peer.records.ranges")


class RangeDatagrams:
    """Answers on the low-priority UDP port of one node."""

    def __init__(self, world: World, own: OwnStatus, cluster_id: bytes, registry: Callable[[], Registry], ranges: Ranges) -> None:
        self._world = world
        self._own = own
        self._registry = registry
        self._ranges = ranges
        self._datagrams = SealedDatagrams(world, own.me, cluster_id, Priority.LOW, own.secrets.sealing, self._sealing_key_of, _log)
        self._entrance, self._questions = trio.open_memory_channel[tuple[NodeId, QueryRange]](QUESTIONS_MAX)
        self._quiet = QuietLog(_log)
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Datagrams that did not count, held no question, or found no room, since the start."""
        return self._dropped + self._datagrams.dropped.total()

    def _sealing_key_of(self, node: NodeId) -> SealingPublicKey | None:
        # Unlike a status, a question costs a look at the disk, so only members may ask.
        member = self._registry().current(node)
        return None if member is None else member.sealing_key

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve until cancelled. Started once the port is open; LocalFault if it cannot be had."""
        await self._datagrams.open()
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._listen)
                for _ in range(ANSWERERS):
                    nursery.start_soon(self._answer_all)
                task_status.started()
        finally:
            with trio.CancelScope(shield=True):
                await self._datagrams.aclose()

    async def _listen(self) -> None:
        while True:
            sender, data = await self._datagrams.receive()
            try:
                packet = decode_packet(data)
            except MalformedPacket as problem:
                self._drop(sender, "malformed", f"a datagram is dropped: {problem}")
                continue
            if isinstance(packet, QueryRange):
                try:
                    self._entrance.send_nowait((sender, packet))
                except trio.WouldBlock:
                    self._drop(sender, "busy", "a range query is dropped: there are too many")
            else:
                self._drop(sender, "unexpected", f"a {type(packet).__name__} has no business here")

    async def _answer_all(self) -> None:
        while True:
            sender, question = await self._questions.receive()
            with surviving(self._quiet, self._world.clock.now(), address_of(sender)):
                await self._answer(question, sender)

    async def _answer(self, question: QueryRange, sender: NodeId) -> None:
        try:
            # Who asks so asks again by himself, and a few who wait would hold up all others.
            answer = await self._ranges.answer(question, ANSWER_LOCATIONS_MAX, ask=False, patience_s=0.0)
        except Refused as refusal:
            answer = range_rejection(question, refusal.reason)
        packet = _with_id(answer, question.request_id)
        if len(encode_packet(self._stamped(packet))) > PACKET_BYTES_MAX:
            packet = _with_id(range_rejection(question, RejectReason.TOO_LARGE_FOR_PACKET), question.request_id)
        await self._send(packet, sender)

    # --------------------------------------------------------------------------------------------------- speaking

    async def _send(self, packet: Packet, target: NodeId) -> None:
        await self._datagrams.send(encode_packet(self._stamped(packet)), target)

    def _stamped(self, packet: Packet) -> Packet:
        return replace(packet, mini_status=self._own.mini())

    def _drop(self, source: NodeId, kind: str, text: str) -> None:
        self._dropped += 1
        self._quiet.say(self._world.clock.now(), address_of(source), kind, text)


def _with_id(packet: P, request_id: int) -> P:
    return replace(packet, request_id=request_id)
