"""Machines of a simulated network and the processes on them.

A machine has an address, a disk, a clock and a kernel that keeps sockets; it outlives its processes. A process is one
life of a node or a client. Once it is dead, nothing that its tasks still do on their way out counts: what they send
vanishes, what they write to the disk fails. So a crash is one instant, however long cancelling takes.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import TYPE_CHECKING

import trio
from trio.lowlevel import Abort, Task

from scenefold.base.ids import KeyId
from scenefold.crypto import Card
from scenefold.world.sim.clock import SimClock
from scenefold.world.sim.disk import SimDisk
from scenefold.world.versions import TAKEN, Versions

if TYPE_CHECKING:
    from scenefold.world.sim.datagrams import SimDatagrams
    from scenefold.world.sim.listening import Listener
    from scenefold.world.sim.streams import SimConnection


class Point(Enum):
    """Where a process can be stopped to the step: just before or after something that others may learn of."""

    BEFORE_SEND = "before send"
    AFTER_SEND = "after send"
    BEFORE_COMMIT = "before commit"
    AFTER_COMMIT = "after commit"


@dataclass(slots=True, eq=False)
class Trap:
    """Goes off when a point has been passed `count` more times."""

    point: Point
    count: int
    spring: Callable[[], None]


@dataclass(slots=True, eq=False)
class Machine:
    """`name` is how faults call it: a node's address, or a client's name."""

    name: str
    address: str
    clock: SimClock
    disk: SimDisk
    dice: Random
    is_up: bool = True
    """False after a silent crash: packets to it vanish. A crash of a process only leaves a kernel that answers."""
    paused_until: float = 0.0
    processes: list[Process] = field(default_factory=list)
    lives: int = 0
    sockets: dict[int, SimDatagrams] = field(default_factory=dict)
    hearing: dict[int, SimDatagrams] = field(default_factory=dict)
    """Sockets that hear what is sent to everybody."""
    listeners: dict[int, Listener] = field(default_factory=dict)
    traps: list[Trap] = field(default_factory=list)
    observers: list[tuple[Point, Callable[[], None]]] = field(default_factory=list)
    passed: dict[Point, int] = field(default_factory=lambda: dict.fromkeys(Point, 0))
    """How often each point was passed by all processes so far."""

    def pass_point(self, point: Point) -> None:
        self.passed[point] += 1
        for watched, see in self.observers:
            if watched is point:
                see()
        # All that are due go off, in the order in which they were set, also if one of them ends the machine.
        for trap in [trap for trap in self.traps if trap.point is point]:
            trap.count -= 1
            if trap.count <= 0:
                if trap in self.traps:
                    self.traps.remove(trap)
                trap.spring()


@dataclass(slots=True, eq=False)
class Process:
    """One life of a node or a client under a name of its certificate. Few runs have certificates; then their keys and dates count, too."""

    name: str
    machine: Machine
    authority: str
    trusts: str
    versions: Versions = TAKEN
    is_alive: bool = True
    connections: dict[SimConnection, None] = field(default_factory=dict)
    sockets: dict[SimDatagrams, None] = field(default_factory=dict)
    listeners: dict[Listener, None] = field(default_factory=dict)
    turned_away: int = 0
    """Connections that its listeners refused."""
    card: Card | None = None
    """What its certificate says, if it has one."""
    sleepers: dict[Task, None] = field(default_factory=dict)
    """Tasks in a wait that nothing but its end or the death of the process can end."""

    @property
    def key(self) -> KeyId | None:
        return None if self.card is None else self.card.signing_id

    def why_not_valid(self, peer: Process) -> str:
        """Why the certificate of a peer counts for nothing here, as TLS says it; empty if it does."""
        if peer.card is None:
            return ""
        now = datetime.datetime.fromtimestamp(self.machine.clock.wall(), datetime.UTC)
        if peer.card.counts(now):
            return ""
        why = "certificate is not yet valid" if now < peer.card.not_before else "certificate has expired"
        return f"its certificate is not valid here: {why} (this clock says {now:%Y-%m-%d})"

    def passes(self, point: Point) -> bool:
        """Pass a point; False if the process is dead, be it from just now."""
        if self.is_alive:
            self.machine.pass_point(point)
        return self.is_alive

    def passes_named(self, what: str) -> bool:
        return self.passes(Point(what))

    async def last(self) -> None:
        """Wait without end for what is due by an event that calls `wake`; no cancellation ends it."""
        task = trio.lowlevel.current_task()
        self.sleepers[task] = None

        def no(_: object) -> Abort:
            return Abort.FAILED

        await trio.lowlevel.wait_task_rescheduled(no)

    def bury(self) -> None:
        """Some time after its death: tasks that nobody could cancel are let go."""
        for connection in self.connections:
            connection.bury()
        for socket in self.sockets:
            socket.bury()

    def wake(self, task: Task) -> None:
        if task in self.sleepers:
            del self.sleepers[task]
            trio.lowlevel.reschedule(task)
