"""Many requests on one connection, the asking side (design: wire, ports and carriers).

Each request gets an id of its own on this connection, and its answer may come in any order. When the connection is
lost, all that wait learn it at once. An answer that nobody waits for any more is dropped unread; one that nobody asked for ends
the connection, or the peer could have us read for ever. Who asked decodes the answer, so it is paid for like all that is done for him.
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
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, decode_packet, encode_frame, request_id_of
from scenefold.world.asked import Asked
from scenefold.world.outbox import Outbox
from scenefold.world.ports import Connection, ConnectionLost
from scenefold.world.quiet import QuietLog
from scenefold.world.tasks import background_tasks

RECEIVE_BYTES = 256 * 1024
FLUSH_S_MAX = 5.0

_log = logging.getLogger("scenefold.world.channel")


@dataclass(slots=True, eq=False)
class _Pending:
    """A request that waits. `answer`, the bytes of a packet, is set before `done`; an exception in it is raised."""

    done: trio.Event = field(default_factory=trio.Event)
    answer: bytes | Exception = b""

    def finish(self, answer: bytes | Exception) -> None:
        self.answer = answer
        self.done.set()


class Channel:
    """A connection to ask on; made by `open_channel`."""

    def __init__(self, connection: Connection, where: str, quiet: QuietLog) -> None:
        self._quiet = quiet
        self._connection = connection
        self._where = where
        self._outbox = Outbox(connection)
        self._asked = Asked[_Pending]()
        self._slots = trio.CapacityLimiter(REQUESTS_IN_FLIGHT_MAX)
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
        Fault, with its reason; NotSpoken, a Refused like that, if the connection's version has no such packet; PeerFault if the
        answer is malformed; LocalFault if the packet cannot be sent.
        """
        with trio.move_on_after(timeout_s):
            async with self._slots:
                return await self._exchange(packet)
        raise self._unreachable(f"no answer within {timeout_s:g} s")

    @property
    def moved_at(self) -> float:
        """When a part of something that was sent last left, by Trio's clock."""
        return self._outbox.moved_at

    def end(self, why: str) -> None:
        """Talk to this peer no more: who waits for an answer hears why, at once."""
        self._lose(why)

    async def send(self, packet: Packet) -> None:
        """Send without an answer. Returns once the packet is on its way; Unreachable if the connection is lost."""
        await self._put(replace(packet, request_id=0))

    async def _exchange(self, packet: Packet) -> Packet:
        pending, was_sent = _Pending(), False
        number = self._asked.ask(pending)
        try:
            await self._put(replace(packet, request_id=number))
            was_sent = True
            await pending.done.wait()
        finally:
            self._asked.give_up(number, was_sent=was_sent)
        if isinstance(pending.answer, Exception):
            raise pending.answer
        answer = self._decoded(pending.answer)
        if isinstance(answer, Fault):
            raise Refused(answer.reason, printable(answer.text), where=self._where)
        return answer

    def _decoded(self, frame: bytes) -> Packet:
        try:
            return decode_packet(frame, version=self._connection.version)
        except MalformedPacket as error:
            self._complain("malformed", str(error))
            raise

    async def _put(self, packet: Packet) -> None:
        if self._lost is not None:
            raise self._unreachable(self._lost)
        try:
            await self._outbox.put(encode_frame(packet, version=self._connection.version))
        except ConnectionLost as error:
            raise self._unreachable(self._lost or str(error)) from None

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
            if isinstance(error, PeerFault):
                self._complain("ended", f"the connection is given up: {error}")
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
        """Pass a frame on to who waits for it. PeerFault if it is no answer to anything."""
        number = request_id_of(frame)
        if number == 0 and isinstance(farewell := decode_packet(frame, version=self._connection.version), Fault):
            raise PeerFault(f"the peer ended the connection: {printable(farewell.text)}")
        pending = self._asked.answered(number)
        if pending is not None:
            pending.finish(frame)

    def _lose(self, why: str) -> None:
        """Nothing here awaits: from the first loss on, no task sees this channel as open."""
        if self._lost is not None:
            return
        self._lost = why
        for pending in self._asked.waiting:
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
