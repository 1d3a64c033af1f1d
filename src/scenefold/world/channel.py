"""Many requests on one connection, the asking side (design: wire, ports and carriers).

Each request gets an id of its own on this connection, and its answer may come in any order. When the connection is
lost, all that wait learn it at once. An answer that nobody waits for any more is dropped.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.limits import REQUESTS_IN_FLIGHT_MAX
from scenefold.base.printable import printable
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, decode_packet, encode_frame
from scenefold.world.outbox import Outbox
from scenefold.world.ports import Connection, ConnectionLost
from scenefold.world.quiet import QuietLog
from scenefold.world.tasks import background_tasks

RECEIVE_BYTES = 256 * 1024
FLUSH_S_MAX = 5.0
_ID_MODULUS = 1 << 32

_log = logging.getLogger("scenefold.world.channel")


@dataclass(slots=True, eq=False)
class _Pending:
    """A request that waits. `answer` is set before `done`; an exception in it is raised."""

    done: trio.Event = field(default_factory=trio.Event)
    answer: Packet | Exception | None = None

    def finish(self, answer: Packet | Exception) -> None:
        self.answer = answer
        self.done.set()


class Channel:
    """A connection to ask on; made by `open_channel`."""

    def __init__(self, connection: Connection, where: str, quiet: QuietLog) -> None:
        self._quiet = quiet
        self._connection = connection
        self._where = where
        self._outbox = Outbox(connection)
        self._pending: dict[int, _Pending] = {}
        self._slots = trio.CapacityLimiter(REQUESTS_IN_FLIGHT_MAX)
        self._last_id = 0
        self._lost: str | None = None
        self.closed = trio.Event()

    @property
    def peer(self) -> str:
        """The name in the peer's certificate."""
        return self._connection.peer

    @property
    def connection(self) -> Connection:
        return self._connection

    @property
    def is_open(self) -> bool:
        return self._lost is None

    async def request(self, packet: Packet, timeout_s: float) -> Packet:
        """Ask and wait for the answer; the packet's own request id is replaced.

        Unreachable if none comes within `timeout_s` seconds or the connection is lost; Refused if the answer is a
        Fault, with its reason; PeerFault if the answer is malformed; LocalFault if the packet cannot be sent.
        """
        with trio.move_on_after(timeout_s):
            async with self._slots:
                return await self._exchange(packet)
        raise self._unreachable(f"no answer within {timeout_s:g} s")

    def end(self, why: str) -> None:
        """Talk to this peer no more: who waits for an answer hears why, at once."""
        self._lose(why)

    async def send(self, packet: Packet) -> None:
        """Send without an answer. Returns once the packet is on its way; Unreachable if the connection is lost."""
        await self._put(replace(packet, request_id=0))

    async def _exchange(self, packet: Packet) -> Packet:
        number = self._free_id()
        pending = self._pending[number] = _Pending()
        try:
            await self._put(replace(packet, request_id=number))
            await pending.done.wait()
        finally:
            del self._pending[number]
        if isinstance(pending.answer, Exception):
            raise pending.answer
        assert pending.answer is not None
        if isinstance(pending.answer, Fault):
            raise Refused(pending.answer.reason, printable(pending.answer.text), where=self._where)
        return pending.answer

    async def _put(self, packet: Packet) -> None:
        if self._lost is not None:
            raise self._unreachable(self._lost)
        try:
            await self._outbox.put(encode_frame(packet))
        except ConnectionLost as error:
            raise self._unreachable(self._lost or str(error)) from None

    def _free_id(self) -> int:
        # 0 is for packets without an answer. Few ids are in use, so the next free one is near.
        while True:
            self._last_id = (self._last_id + 1) % _ID_MODULUS
            if self._last_id and self._last_id not in self._pending:
                return self._last_id

    async def run(self) -> None:
        """Send and receive until the connection ends."""
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._until_lost, self._outbox.run, nursery.cancel_scope)
                await self._until_lost(self._receive, nursery.cancel_scope)
                nursery.cancel_scope.cancel()
        finally:
            self._lose("the connection is closed")

    async def flush(self) -> None:
        """Let what was handed over leave, then take no more."""
        await self._outbox.finish()

    async def _until_lost(self, half: Callable[[], Awaitable[None]], both: trio.CancelScope) -> None:
        try:
            await half()
        except (ConnectionLost, PeerFault) as error:
            self._lose(str(error))
            both.cancel()

    async def _receive(self) -> None:
        reader = FrameReader()
        while data := await self._connection.receive(RECEIVE_BYTES):
            for frame in reader.feed(data):
                self._answer(frame)
        if not reader.at_boundary:
            self._complain("truncated", "the connection ended within a frame")
        self._lose("the peer closed the connection")

    def _answer(self, frame: bytes) -> None:
        number: int | None
        answer: Packet | Exception
        try:
            answer = decode_packet(frame, version=self._connection.version)
            number = answer.request_id
        except MalformedPacket as error:
            self._complain("malformed", str(error))
            answer, number = error, error.request_id
        pending = self._pending.get(number) if number else None
        if pending is not None:
            pending.finish(answer)
        elif isinstance(answer, Fault) and not number:
            raise PeerFault(f"the peer ended the connection: {answer.text}")

    def _lose(self, why: str) -> None:
        """Nothing here awaits: from the first loss on, no task sees this channel as open."""
        if self._lost is not None:
            return
        self._lost = why
        for pending in self._pending.values():
            pending.finish(self._unreachable(why))
        self.closed.set()

    def _complain(self, kind: str, text: str) -> None:
        self._quiet.say(trio.current_time(), self._where, kind, text)

    def _unreachable(self, why: str) -> Unreachable:
        return Unreachable(f"the node does not answer: {why}", where=self._where, remedy="see that it runs, then try again")


@asynccontextmanager
async def open_channel(connection: Connection, where: str = "", quiet: QuietLog | None = None) -> AsyncIterator[Channel]:
    """A channel on a fresh connection, which it closes at the end. `where` names the peer in errors.

    `quiet`, shared by the channels of a process, keeps a bad peer from flooding the log.
    """
    channel = Channel(connection, where or connection.peer, quiet or QuietLog(_log))
    try:
        async with background_tasks() as nursery:
            nursery.start_soon(channel.run)
            yield channel
            with trio.move_on_after(FLUSH_S_MAX):
                await channel.flush()
    finally:
        await connection.aclose()
