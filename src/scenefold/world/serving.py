"""Many requests on one connection, the answering side.

Each packet that arrives is handled in a task of its own, a bounded number and a bounded volume at a time, of a connection and of
all of a peer's (guests.py); beyond that nothing more is read, so the peer's sending stops by itself. They take turns with those of other
peers (turns.py). Few of them at a time may have an answer of a frame's size. What goes wrong with one request is answered with a Fault,
also when it goes wrong by a bug of ours: no packet shall end a node. What breaks the framing ends the connection, after a Fault that says so.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import replace

import trio

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError
from scenefold.base.limits import ANSWER_BYTES_MAX, FRAME_S_MAX, REQUEST_BYTES_HANDLED_MAX, REQUESTS_HANDLED_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire import Fault, FrameReader, MalformedPacket, NotSpoken, Packet, UnsupportedPacket, decode_packet, encode_frame
from scenefold.world.guests import BYTE_S, REQUEST_S, Budget, Guests, Room, Share
from scenefold.world.metering import charge_forged
from scenefold.world.outbox import Outbox
from scenefold.world.ports import Connection, ConnectionLost
from scenefold.world.quiet import QuietLog
from scenefold.world.surviving import BUG, ends_the_node, say_bug

Handler = Callable[[Packet, str], Awaitable[Packet | None]]
"""`handler(packet, peer name)` returns the answer, or None for none. What it raises becomes a Fault, but for DiskFailed."""

RECEIVE_BYTES = 256 * 1024
LINGER_S_MAX = 10.0
"""What a request may still take after its sender has closed the connection in order."""
BEGUN_BYTES_FREE = 64 * 1024
"""A larger frame counts against its peer's share from its first byte on."""
MALFORMED_MAX = 8
"""Malformed packets on one connection before it is closed."""
DRAIN_S_MAX = 1.0
FAULT_TEXT_CHARACTERS_MAX = 400

_log = logging.getLogger("scenefold.world.serving")


async def serve_connection(connection: Connection, handler: Handler, quiet: QuietLog | None = None, guests: Guests | None = None) -> None:
    """Answer a peer's packets until it closes the connection or breaks the framing. The caller closes it.

    `quiet`, shared by a node's connections, keeps a peer that comes again and again from flooding the log; `guests`, shared
    by those to one port, bounds what all connections of a peer bind together.
    """
    quiet = quiet or QuietLog(_log)
    with (guests or Guests()).admitted(connection.peer) as (share, scope):
        await _Serving(connection, handler, quiet, share).run()
    if scope.cancelled_caught:
        quiet.say(trio.current_time(), connection.peer, "many", "its oldest connection is closed: it has too many")


class _Serving:
    """One connection being served."""

    def __init__(self, connection: Connection, handler: Handler, quiet: QuietLog, share: Share) -> None:
        self._quiet = quiet
        self._connection = connection
        self._handler = handler
        self._outbox = Outbox(connection)
        self._budget = Budget(REQUESTS_HANDLED_MAX, REQUEST_BYTES_HANDLED_MAX)
        self._room = Room(ANSWER_BYTES_MAX)
        self._share = share
        self._bill = share.bill()
        """What reading and sending cost."""
        self._malformed = 0
        self._patience_s = FRAME_S_MAX
        self._begun_bytes = 0
        """Of the peer's share: a large frame that has begun to arrive."""

    async def run(self) -> None:
        async with trio.open_nursery() as everything:
            everything.start_soon(self._send, everything.cancel_scope)
            async with trio.open_nursery() as requests:
                try:
                    await self._bill.metered(self._receive(requests))
                except ConnectionLost as error:
                    self._complain("lost", str(error))
                    everything.cancel_scope.cancel()
                finally:
                    if self._begun_bytes:
                        self._share.budget.give_back(self._begun_bytes)
                requests.cancel_scope.deadline = trio.current_time() + LINGER_S_MAX
            await self._outbox.finish()

    async def _send(self, everything: trio.CancelScope) -> None:
        try:
            await self._bill.metered(self._outbox.run())
        except ConnectionLost as error:
            self._complain("lost", str(error))
            everything.cancel()

    async def _receive(self, requests: trio.Nursery) -> None:
        """Start a task for each packet; returns at the end of the stream or of our patience."""
        reader = FrameReader()
        while data := await self._more(reader):
            try:
                frames = reader.feed(data)
            except MalformedPacket as error:
                self._complain("framing", str(error))
                await self._put(encode_frame(_fault(0, RejectReason.LIMIT_EXCEEDED, error)))
                await self._drain()
                return
            for frame in frames:
                await self._budget.take(len(frame))
                if self._begun_bytes:
                    self._begun_bytes = 0
                else:
                    await self._share.budget.take(len(frame))
                self._patience_s = FRAME_S_MAX
                requests.start_soon(self._handle, frame)
            if reader.awaited_bytes > BEGUN_BYTES_FREE and not self._begun_bytes:
                await self._share.budget.take(reader.awaited_bytes)
                self._begun_bytes = reader.awaited_bytes
            if self._malformed > MALFORMED_MAX:
                self._complain("patience", f"closed after {self._malformed} malformed packets")
                return
        if not reader.at_boundary:
            self._complain("truncated", "the connection ended within a frame")

    async def _more(self, reader: FrameReader) -> bytes:
        """What arrives next. Who has begun a frame has to end it; time in which we do not read is ours."""
        if reader.at_boundary:
            return await self._connection.receive(RECEIVE_BYTES)
        began_at = trio.current_time()
        # What comes in the very moment in which patience ends may leave less than none of it.
        with trio.move_on_after(max(0.0, self._patience_s)):
            data = await self._connection.receive(RECEIVE_BYTES)
            self._patience_s -= trio.current_time() - began_at
            return data
        raise ConnectionLost(f"a frame did not arrive whole within {FRAME_S_MAX:g} s")

    async def _drain(self) -> None:
        """Let the peer read our last words: closing over unread bytes would reset the connection under them."""
        with trio.move_on_after(DRAIN_S_MAX):
            while await self._connection.receive(RECEIVE_BYTES):
                pass

    async def _handle(self, frame: bytes) -> None:
        async with AsyncExitStack() as held:
            held.callback(self._budget.give_back, len(frame))
            held.callback(self._share.budget.give_back, len(frame))
            turn, answer_bytes = await self._share.take_turn(), 0
            bill = self._share.bill(REQUEST_S + len(frame) * BYTE_S)
            try:
                answer_bytes = await bill.metered(self._respond(frame, held))
            finally:
                bill.close(answer_bytes * BYTE_S)
                self._share.end_turn(turn)

    async def _respond(self, frame: bytes, held: AsyncExitStack) -> int:
        """Handle a request and send the answer, which has so many bytes."""
        answer = await self._answer_to(frame, held)
        if answer is None:
            return 0
        answer_frame = self._frame_of(answer)
        await self._put(answer_frame)
        return len(answer_frame)

    async def _answer_to(self, frame: bytes, held: AsyncExitStack) -> Packet | None:
        """The answer to a packet. `held` keeps what must stay taken until the answer has left."""
        number = 0
        try:
            packet = self._decoded(frame)
            number = packet.request_id
            if size_bytes := packet.answer_bytes_max():
                await held.enter_async_context(self._room.taken(size_bytes))
                await held.enter_async_context(self._share.room.taken(size_bytes))
            answer = await self._handler(packet, self._connection.peer)
        except MalformedPacket as error:
            self._complain("malformed", str(error))
            # Id 0 would end the connection at the other side; but whoever waits there has a timeout.
            number = number or error.request_id or 0
            return _fault(number, RejectReason.ILL_FORMED, error) if number else None
        except ScenefoldError as error:
            if not isinstance(error, Refused):
                self._complain(type(error).__name__, str(error))
            return _fault(number, _reason(error), error) if number else None
        except Exception as error:  # whatever it is: the one who sent this is no reason to be away for all others
            if ends_the_node(error):
                raise
            say_bug(self._quiet, trio.current_time(), self._connection.peer, error)
            return _fault(number, RejectReason.NOT_READY, BUG) if number else None
        return replace(answer, request_id=number) if answer is not None and number else None

    def _decoded(self, frame: bytes) -> Packet:
        """The packet of a frame. Only what is none itself is held against the peer: what it holds may be others' words."""
        try:
            return decode_packet(frame, version=self._connection.version)
        except UnsupportedPacket:
            raise  # A packet of a later version is no sign of a broken peer.
        except MalformedPacket:
            self._malformed += 1
            charge_forged(1)
            raise

    def _frame_of(self, answer: Packet) -> bytes:
        try:
            return encode_frame(answer, version=self._connection.version)
        except LocalFault as error:
            # A handler's answer that fits no frame is its mistake, but only this request should suffer from it.
            self._complain("answer", str(error))
            return encode_frame(_fault(answer.request_id, RejectReason.TOO_LARGE_FOR_PACKET, error))
        except NotSpoken as error:
            return encode_frame(_fault(answer.request_id, error.reason, error))

    async def _put(self, frame: bytes) -> None:
        try:
            await self._outbox.put(frame)
        except ConnectionLost:
            return  # The sender has said so already, and is ending this connection.

    def _complain(self, kind: str, text: str) -> None:
        self._quiet.say(trio.current_time(), self._connection.peer, kind, text)


def _reason(error: ScenefoldError) -> RejectReason:
    if isinstance(error, Refused):
        return error.reason
    if isinstance(error, PeerFault):
        return RejectReason.ILL_FORMED
    return RejectReason.SIGNATURE_INVALID if isinstance(error, DamagedData) else RejectReason.NOT_READY


def _fault(number: int, reason: RejectReason, error: ScenefoldError) -> Fault:
    return Fault(request_id=number, reason=reason, text=str(error)[:FAULT_TEXT_CHARACTERS_MAX])
