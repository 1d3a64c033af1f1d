"""One direction of a connection of a simulated network.

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

from scenefold.world.sim.machines import Process
from scenefold.world.sim.paths import Path
from scenefold.world.sim.time import nanoseconds
from scenefold.world.sim.weather import delay_of_piece

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet
    from scenefold.world.sim.streams import SimConnection

WINDOW_BYTES = 512 * 1024
"""What is under way and unread in one direction before a sender waits."""


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
