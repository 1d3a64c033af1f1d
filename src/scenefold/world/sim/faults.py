"""The faults that a simulation can order, each a method; mixed into `SimNet` (net.py).

Machines are named by a node's address or a client's name ("user:ada"). Each fault is a line of the trace. None of them
waits: it is in force when the call returns, and stays until it is ended. `calm` ends them all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

from scenefold.world.sim.machines import Machine, Point, Trap
from scenefold.world.sim.paths import Partition, Paths
from scenefold.world.sim.time import nanoseconds
from scenefold.world.sim.weather import Weather

if TYPE_CHECKING:
    from scenefold.world.sim.pipes import Pipe

CLOG_BYTES_PER_S = 50.0
BURIAL_S = 1.0


class Faults(ABC):
    """What can be done to a network and its machines."""

    paths: Paths
    counts: Counter[str]
    note: Callable[..., None]
    after: Callable[..., None]
    machine: Callable[[str], Machine]
    pipes_on: Callable[[str, str], list[Pipe]]
    all_pipes: Callable[[], list[Pipe]]
    _machines: dict[str, Machine]

    @property
    @abstractmethod
    def now(self) -> float:
        """Virtual seconds since the run began."""

    # ------------------------------------------------------------------------------------------------- paths

    def set_weather(self, weather: Weather | None, source: str | None = None, target: str | None = None) -> None:
        """The weather of one path, or of all that have none of their own; None: as all the others."""
        self.note("weather", source or "*", target or "*", weather)
        if source is not None and target is not None:
            self.paths.set_weather(weather, source, target)
        elif weather is not None:
            self.paths.weather = weather

    def cut(self, source: str, target: str, *, one_way: bool = False) -> None:
        """Nothing passes from one to the other (and back, unless `one_way`), and nobody is told."""
        self.note("cut", source, target, "one-way" if one_way else "both-ways")
        self.paths.cut(source, target)
        if not one_way:
            self.paths.cut(target, source)

    def mend(self, source: str, target: str, *, one_way: bool = False) -> None:
        """End one `cut` of the same kind."""
        self.note("mend", source, target, "one-way" if one_way else "both-ways")
        for one, other in ((source, target),) if one_way else ((source, target), (target, source)):
            self.paths.mend(one, other)
            self._hurry(self.pipes_on(one, other))

    def partition(self, *groups: Collection[str]) -> Partition:
        """Machines of different groups do not reach each other; those in no group reach everybody."""
        self.note("partition", " | ".join(",".join(sorted(group)) for group in groups))
        return self.paths.divide(groups)

    def unite(self, partition: Partition) -> None:
        """End a partition."""
        self.note("unite", len(partition.group_of))
        self.paths.unite(partition)
        self._hurry(self.all_pipes())

    def clog(self, source: str, target: str, bytes_per_s: float = CLOG_BYTES_PER_S) -> None:
        """From now on a path carries next to nothing (one way)."""
        self.note("clog", source, target, bytes_per_s)
        self.paths.clog(source, target, bytes_per_s)

    def unclog(self, source: str, target: str) -> None:
        self.note("unclog", source, target)
        self.paths.unclog(source, target)
        self._hurry(self.pipes_on(source, target))

    def slow(self, name: str, factor: float) -> None:
        """All that comes to a machine or goes from it takes `factor` times longer, its workers too; 1 ends it."""
        self.note("slow", name, factor)
        was_slower = factor < self.paths.slowness(name)
        self.paths.slow(name, factor)
        if was_slower:
            # What was sent while it was slow must not be late for as long as it would have been.
            self._hurry([pipe for pipe in self.all_pipes() if name in pipe.path])

    def reset(self, one: str, other: str) -> int:
        """Break all connections between two machines; both hear it. Returns how many there were."""
        broken = [*self.pipes_on(one, other), *self.pipes_on(other, one)]
        self.note("reset", one, other, len(broken))
        for pipe in broken:
            if pipe.end_here is not None:
                pipe.end_here.reset()
        self.counts["reset"] += len(broken)
        return (len(broken) + 1) // 2

    def calm(self) -> None:
        """End all faults of paths and machines: cuts, partitions, clogs, slowness, pauses, traps, slow and full disks."""
        self.note("calm")
        self.paths.calm()
        for machine in self._machines.values():
            machine.paused_until = min(machine.paused_until, self.now)
            machine.traps.clear()
            machine.disk.fill(None)
            machine.disk.slow(0.0)
        self._hurry(self.all_pipes())

    def _hurry(self, pipes: list[Pipe]) -> None:
        for pipe in pipes:
            pipe.hurry()

    # ---------------------------------------------------------------------------------------------- machines

    def pause(self, name: str, seconds: float) -> None:
        """A machine stands still for so long: it takes nothing in, nothing leaves it, its sleeps and workers wait.

        Its clock goes on. (Trio's own deadlines cannot be held up and go off in time.)
        """
        self.note("pause", name, seconds)
        machine = self.machine(name)
        machine.paused_until = max(machine.paused_until, nanoseconds(self.now + seconds))

    def crash(self, name: str, *, silent: bool = False, torn: bool = False) -> None:
        """Kill all processes of a machine, now. The caller then cancels their tasks.

        Nothing that these still do reaches the network or the disk. `silent`: the machine is gone as in a power cut, and
        nobody hears anything until a new process is started on it; else its kernel cuts its connections and refuses
        new ones. `torn`: see disk.py. A machine without living processes may be crashed again.
        """
        machine = self.machine(name)
        self.note("crash", name, "silent" if silent else "told", "torn" if torn else "")
        self.counts["crashed"] += 1
        processes = [process for process in machine.processes if process.is_alive]
        for process in processes:
            process.is_alive = False
            for connection in list(process.connections):
                connection.die(told=not silent)
            for listener in list(process.listeners):
                listener.close()
            for socket in list(process.sockets):
                socket.close()
            for task in list(process.sleepers):
                process.wake(task)
            self.after(BURIAL_S, process.bury)
        machine.processes.clear()
        machine.traps.clear()
        machine.paused_until = min(machine.paused_until, self.now)
        machine.is_up = not silent
        machine.disk.crash(torn=torn)

    def _come_up(self, machine: Machine) -> None:
        machine.is_up = True
        self._hurry([pipe for pipe in self.all_pipes() if pipe.path[1] == machine.name])

    def trap(self, name: str, point: Point, count: int, spring: Callable[[], None]) -> None:
        """Call `spring` when a machine's processes pass a point the `count`-th time from now (1: the next time).

        `spring` runs in the middle of that step: a `crash` there takes effect before, or after, exactly that send or commit.
        """
        assert count >= 1, f"the {count}-th time"
        self.machine(name).traps.append(Trap(point, count, spring))

    def observe(self, name: str, point: Point, see: Callable[[], None]) -> None:
        """Call `see` each time a machine passes a point, before any trap, for good: checkers look at the truth this way.

        At AFTER_COMMIT the disk has changed already.
        """
        self.machine(name).observers.append((point, see))
