"""Range queries of other nodes in single datagrams, answered on UDP low (thesis C.4; specs/18-data.md, Ranges).

For looking quickly whether anything lies in a small piece: a question and its answer are one signed packet each, with no
connection. An answer that would not fit one is refused with reason 6, so that the asker halves its question. Whatever gets
lost is asked again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import DATAGRAM_OVERHEAD_BYTES, ReplayWindow, StrangeVersion, parse_datagram, sign_datagram, verify_datagram
from scenefold.peer.ranges import Ranges, range_rejection
from scenefold.peer.registry import Registry
from scenefold.peer.status import OwnStatus
from scenefold.wire import MalformedPacket, Packet, QueryRange, decode_packet, encode_packet
from scenefold.world import Datagrams, Priority, QuietLog, World

ANSWER_LOCATIONS_MAX = 64
"""More than fit a datagram, so that an answer that was cut short never fits."""
QUESTIONS_MAX = 64
"""Questions that wait for their turn; beyond it they are dropped, as the network would do."""
ANSWERERS = 4
"""Questions that are answered at a time."""
PACKET_BYTES_MAX = DATAGRAM_BYTES_MAX - DATAGRAM_OVERHEAD_BYTES

P = TypeVar("P", bound=Packet)

_log = logging.getLogger("scenefold.peer.ranges")


class RangeDatagrams:
    """Answers on the low-priority UDP port of one node."""

    def __init__(self, world: World, own: OwnStatus, registry: Callable[[], Registry], ranges: Ranges) -> None:
        self._world = world
        self._own = own
        self._registry = registry
        self._ranges = ranges
        self._datagrams: Datagrams | None = None
        self._entrance, self._questions = trio.open_memory_channel[tuple[NodeId, QueryRange]](QUESTIONS_MAX)
        self._windows: dict[NodeId, tuple[bytes, ReplayWindow]] = {}
        self._quiet = QuietLog(_log)
        self.dropped = 0
        """Datagrams that did not verify, came twice, or found no room, since the start."""

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve until cancelled. Started once the port is open; LocalFault if it cannot be had."""
        datagrams = self._datagrams = await self._world.network.open_datagrams(address_of(self._own.me), Priority.LOW)
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._listen, datagrams)
                for _ in range(ANSWERERS):
                    nursery.start_soon(self._answer_all)
                task_status.started()
        finally:
            self._datagrams = None
            with trio.CancelScope(shield=True):
                await datagrams.aclose()

    async def _listen(self, datagrams: Datagrams) -> None:
        while True:
            data, source = await datagrams.receive()
            try:
                sender, packet = self._opened(data)
            except (DamagedData, MalformedPacket) as problem:
                self._drop(
                    source.address, "version" if isinstance(problem, StrangeVersion) else "forged", f"a datagram is dropped: {problem}"
                )
                continue
            if isinstance(packet, QueryRange):
                try:
                    self._entrance.send_nowait((sender, packet))
                except trio.WouldBlock:
                    self._drop(source.address, "busy", "a range query is dropped: there are too many")
            else:
                self._drop(source.address, "unexpected", f"a {type(packet).__name__} has no business here")

    def _opened(self, data: bytes) -> tuple[NodeId, Packet]:
        datagram = parse_datagram(data)
        member = self._registry().current(datagram.sender)
        # Unlike a status, a question costs a look at the disk, so each datagram counts once, and only if it is for us.
        if member is None or datagram.sender == self._own.me or datagram.target != self._own.me:
            raise DamagedData(f"it is from {address_of(datagram.sender)} for {address_of(datagram.target)}")
        window = self._window(datagram.sender, member.incarnation)
        if not window.is_fresh(datagram.counter):
            raise DamagedData("it was there before")
        payload = verify_datagram(datagram, member.key)
        window.accept(datagram.counter)
        return datagram.sender, decode_packet(payload)

    def _window(self, sender: NodeId, incarnation: bytes) -> ReplayWindow:
        """What was seen of a node. One that was wiped counts from the beginning, under another incarnation."""
        known = self._windows.get(sender)
        if known is None or known[0] != incarnation:
            known = self._windows[sender] = incarnation, ReplayWindow()
        return known[1]

    async def _answer_all(self) -> None:
        while True:
            sender, question = await self._questions.receive()
            try:
                answer = await self._ranges.answer(question, ANSWER_LOCATIONS_MAX, ask=False)
            except Refused as refusal:
                answer = range_rejection(question, refusal.reason)
            packet = _with_id(answer, question.request_id)
            if len(encode_packet(self._stamped(packet))) > PACKET_BYTES_MAX:
                packet = _with_id(range_rejection(question, RejectReason.TOO_LARGE_FOR_PACKET), question.request_id)
            await self._send(packet, sender)

    # --------------------------------------------------------------------------------------------------- speaking

    async def _send(self, packet: Packet, target: NodeId) -> None:
        assert self._datagrams is not None, "run comes first"
        payload = encode_packet(self._stamped(packet))
        data = sign_datagram(self._own.key, self._own.me, self._own.next(), payload, target=target)
        await self._datagrams.send(data, address_of(target))

    def _stamped(self, packet: Packet) -> Packet:
        return replace(packet, mini_status=self._own.mini())

    def _drop(self, source: str, kind: str, text: str) -> None:
        self.dropped += 1
        self._quiet.say(self._world.clock.now(), source, kind, text)


def _with_id(packet: P, request_id: int) -> P:
    return replace(packet, request_id=request_id)
