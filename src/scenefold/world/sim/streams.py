"""TCP with TLS of a simulated network (port `Connection`): two pipes, one for each direction (pipes.py)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import trio

from scenefold.base.ids import KeyId
from scenefold.world.ports import ConnectionLost
from scenefold.world.sim.machines import Point, Process
from scenefold.world.sim.pipes import Ending, Introduction, Pipe

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet

PIECE_BYTES_MAX = 64 * 1024


class SimConnection:
    """One end of a connection, in the hands of a process."""

    def __init__(
        self, net: SimNet, process: Process, peer: str, version: int, outgoing: Pipe, incoming: Pipe, peer_key: KeyId | None = None
    ) -> None:
        self.peer = peer
        self.peer_key = peer_key
        self.version = version
        self._net = net
        self._process = process
        self._out = outgoing
        self._in = incoming
        self._lost: str | None = None
        self._is_closed = False
        self._is_sending = self._is_receiving = False
        outgoing.end_here = incoming.end_there = self
        process.connections[self] = None

    @property
    def is_gone(self) -> bool:
        """What arrives here is answered with a reset."""
        return self._is_closed or self._lost is not None or not self._process.is_alive

    async def send(self, data: bytes | memoryview) -> None:
        if self._is_sending:
            raise trio.BusyResourceError("another task sends on this connection")
        self._is_sending = True
        try:
            await trio.lowlevel.checkpoint()
            data = bytes(data)
            for start in range(0, len(data), PIECE_BYTES_MAX):
                await self._send_piece(data[start : start + PIECE_BYTES_MAX])
        except trio.Cancelled:
            self._lost = self._lost or "a send on it was cancelled"
            raise
        finally:
            self._is_sending = False

    async def _send_piece(self, piece: bytes) -> None:
        self._check()
        while not self._out.has_room:
            await self._out.writers.park()
            self._check()
        if self._process.passes(Point.BEFORE_SEND):
            self._net.trace_piece("tcp-send", self._out, piece)
            self._out.send(piece)
            self._process.passes(Point.AFTER_SEND)

    def _check(self) -> None:
        if self._lost is not None:
            raise ConnectionLost(self._lost)

    async def receive(self, count_max: int) -> bytes:
        assert count_max >= 1
        if self._is_receiving:
            raise trio.BusyResourceError("another task receives from this connection")
        self._is_receiving = True
        try:
            if self._in.unread or self._in.ended is not None or self._is_closed or self._lost is not None:
                await trio.lowlevel.checkpoint()  # Else there is a wait.
            while True:
                if self._is_closed:
                    raise ConnectionLost("the connection is closed")
                if self._in.unread:
                    return self._in.take(count_max)
                if self._in.ended is Ending.ORDERLY:
                    return b""
                if self._in.ended is not None:
                    raise ConnectionLost(self._in.ended.value)
                self._check()
                await self._in.readers.park()
        finally:
            self._is_receiving = False

    async def aclose(self) -> None:
        self.close()
        await trio.lowlevel.checkpoint()

    def introduce(self, introduction: Introduction) -> None:
        self._out.send(introduction)

    def abort(self) -> None:
        """Close hard: the other side hears that the connection was cut."""
        if not self._is_closed:
            self._is_closed = True
            self._process.connections.pop(self, None)
            if self._process.is_alive and self._lost is None:
                self._out.reset(Ending.CUT)
            self.lose("the connection is closed")

    def close(self) -> None:
        """In order if all was read, else hard; a dead process's kernel has done it already."""
        if self._is_closed:
            return
        self._is_closed = True
        self._process.connections.pop(self, None)
        if self._process.is_alive and self._lost is None:
            if self._in.unread:
                self._out.reset(Ending.RESET)
            else:
                self._out.send(Ending.ORDERLY)
        self.lose("the connection is closed")

    def lose(self, why: str) -> None:
        """From now on this end is broken. Whoever waits on it learns it, unless its process is dead."""
        self._lost = self._lost or why
        if self._process.is_alive:
            self._in.readers.unpark_all()
            self._out.writers.unpark_all()

    def refuse(self) -> None:
        """The other end is gone: what we sent there is answered with a reset."""
        if not self.is_gone:
            self._net.answer(self._in.path, self._hear_reset)

    def _hear_reset(self) -> None:
        if not self.is_gone:
            self.lose(Ending.RESET.value)
            self._out.break_off()

    def reset(self) -> None:
        """Break this end now, as a middlebox may that sits between."""
        self.lose(Ending.RESET.value)
        self._out.break_off()

    def die(self, *, told: bool) -> None:
        """Its process is gone. Told: its kernel says so to the other side; else nobody hears anything."""
        if told and self._lost is None:
            self._out.send(Ending.CUT)
        elif not told:
            self._out.break_off()

    def bury(self) -> None:
        """Let go whoever still waits here although its process died."""
        self._lost = self._lost or "the machine of this process has crashed"
        self._in.readers.unpark_all()
        self._out.writers.unpark_all()
