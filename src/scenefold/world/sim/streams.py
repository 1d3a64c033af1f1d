"""TCP with TLS of a simulated network (port `Connection`): two pipes, one for each direction.

A pipe carries pieces in order. Each gets its time of arrival when it is sent; one event per pipe waits for the first of
them. While the path is cut, nothing arrives and nobody is told: pieces wait for the path to be mended, until the sender's
patience ends and the connection is broken for it alone. The other side learns of it when it sends something.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import trio

from scenefold.world.ports import ConnectionLost
from scenefold.world.sim.machines import Point, Process
from scenefold.world.sim.paths import Path
from scenefold.world.sim.time import nanoseconds
from scenefold.world.sim.weather import delay_of_piece

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet

WINDOW_BYTES = 512 * 1024
"""What is under way and unread in one direction before a sender waits."""
PIECE_BYTES_MAX = 64 * 1024


class Ending(Enum):
    """How a stream ends; the last piece of a pipe."""

    ORDERLY = "closed"
    CUT = "the connection was cut"
    RESET = "the connection was reset by the peer"


Introduction = Callable[["SimConnection"], None]
"""The first piece of a client: whose connection it is. Called with the node's end when it arrives."""
Content = bytes | Ending | Introduction


@dataclass(slots=True)
class _Piece:
    arrives: float
    data: Content


class Pipe:
    """One direction of a connection: pieces under way, and what has arrived and is not read."""

    def __init__(self, net: SimNet, number: int, source: Process, target: Process, path: Path) -> None:
        self.number = number
        self.path = path
        self._net = net
        self._source = source
        self._target = target
        self._under_way: deque[_Piece] = deque()
        self._generation = 0
        self._stalled_since: float | None = None
        self.unread: deque[bytes] = deque()
        self._bytes = 0
        self.ended: Ending | None = None
        self.end_here: SimConnection | None = None
        """The end that sends."""
        self.end_there: SimConnection | None = None
        self.readers = trio.lowlevel.ParkingLot()
        self.writers = trio.lowlevel.ParkingLot()

    @property
    def has_room(self) -> bool:
        return self._bytes < WINDOW_BYTES

    def send(self, data: Content) -> None:
        """Put a piece on its way."""
        if isinstance(data, bytes):
            self._bytes += len(data)
            weather, dice = self._net.weather_of(self.path), self._source.machine.dice
            if weather.splitting and len(data) > 1 and dice.random() < weather.splitting:
                middle = dice.randrange(1, len(data))
                self._append(data[:middle])
                data = data[middle:]
        self._append(data)

    def _append(self, data: Content) -> None:
        before = self._under_way[-1].arrives if self._under_way else 0.0
        self._under_way.append(_Piece(max(before, self._time_of_arrival(data)), data))
        if len(self._under_way) == 1:
            self._wait_for_first()

    def _time_of_arrival(self, data: Content) -> float:
        delay = delay_of_piece(self._net.weather_of(self.path), self._source.machine.dice) * self._net.factor(self.path)
        size = len(data) if isinstance(data, bytes) else 1
        return nanoseconds(self._net.departure(self._source.machine) + delay + size / self._net.bytes_per_s(self.path))

    def hurry(self) -> None:
        """The path was mended: what waits gets a new time, in the old order."""
        before, self._stalled_since = 0.0, None
        for piece in self._under_way:
            anew = self._time_of_arrival(piece.data)
            before = piece.arrives = max(before, min(piece.arrives, anew) if piece.arrives > self._net.now else anew)
        if self._under_way:
            self._wait_for_first()

    def reset(self, ending: Ending) -> None:
        """What is under way is dropped; the other side hears of it."""
        self._drop_under_way()
        self._append(ending)

    def break_off(self) -> None:
        """Nothing more comes out of this pipe."""
        self._drop_under_way()
        self._generation += 1
        self._net.forget(self)

    def _drop_under_way(self) -> None:
        self._bytes -= sum(len(piece.data) for piece in self._under_way if isinstance(piece.data, bytes))
        self._under_way.clear()

    def _wait_for_first(self) -> None:
        self._generation += 1
        self._net.at(self._under_way[0].arrives, self._arrive, self._generation)

    def _arrive(self, generation: int) -> None:
        if generation != self._generation or not self._under_way:
            return
        if not self._net.reaches(self.path):
            self._stall()
            return
        held = self._net.held_until(self._target.machine)
        if held is not None:
            self._net.at(held, self._arrive, generation)
            return
        self._stalled_since = None
        while self._under_way and self._under_way[0].arrives <= self._net.now:
            self._deliver(self._under_way.popleft().data)
        if self._under_way:
            self._wait_for_first()

    def _stall(self) -> None:
        now, patience = self._net.now, self._net.weather_of(self.path).dead_after_s
        if self._stalled_since is None:
            self._stalled_since = now
            self._net.at(now + patience, self._arrive, self._generation)
        elif now >= self._stalled_since + patience - 1e-9 and self.end_here is not None:
            self._net.note("stream-dead", self.number, *self.path)
            self.end_here.lose("the connection timed out")
            self.break_off()

    def _deliver(self, data: Content) -> None:
        self._net.trace_piece("tcp-arrive", self, data)
        if isinstance(data, Ending):
            self._net.forget(self)
        end = self.end_there
        if end is None or end.is_gone:
            if isinstance(data, bytes):
                self._bytes -= len(data)
                if self.end_here is not None:
                    self.end_here.refuse()
            return
        if isinstance(data, bytes):
            self.unread.append(data)
        elif isinstance(data, Ending):
            self.ended = data
            if data is Ending.RESET:
                end.lose(data.value)
        else:
            data(end)
        self.readers.unpark()

    def bytes_waiting(self) -> int:
        """Under way and unread."""
        return self._bytes

    def take(self, count_max: int) -> bytes:
        """At most so many of the bytes that have arrived; at least one."""
        data = self.unread.popleft()
        if len(data) > count_max:
            self.unread.appendleft(data[count_max:])
            data = data[:count_max]
        self._bytes -= len(data)
        if self.writers and self.has_room:
            self.writers.unpark_all()
        return data


class SimConnection:
    """One end of a connection, in the hands of a process."""

    def __init__(self, net: SimNet, process: Process, peer: str, outgoing: Pipe, incoming: Pipe) -> None:
        self.peer = peer
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
            await trio.lowlevel.checkpoint()
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
