"""Work for threads, run inline (port `Workers`).

A call is atomic, but never at once: tasks have their turn before it or after it, and in lanes with a cost virtual time
passes there: on both sides of what changes a disk, mostly on one of both, by dice, of what only reads or computes. As with threads, the
wait for the lane can be cancelled and a call that has begun is waited for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import trio

from scenefold.world.ports import DiskFailed
from scenefold.world.sim.machines import Process
from scenefold.world.sim.paths import Paths
from scenefold.world.sim.time import current_time_of_simulation
from scenefold.world.sim.weather import Delay

T = TypeVar("T")

WIDTHS: Mapping[str, int] = {"crypto": 2, "store": 1, "store-read": 2, "render": 2, "import": 2, "film": 2}
"""How many calls of a lane run at once. The names are those of the real world."""
COSTS: Mapping[str, Delay] = {
    "crypto": Delay(0.0001, 0.0001, 0.01),
    "store": Delay(0.0005, 0.001, 0.1),
    "store-read": Delay(0.00005, 0.0001, 0.01),
    "render": Delay(0.03, 0.01, 0.3),
    "film": Delay(0.0005, 0.001, 0.05),
}
"""Virtual seconds of one call; a lane that is not here costs none."""
SYNCING_LANE = "store"
"""Its calls take as much longer as the disk is slow."""
IN_BETWEEN = 0.1
"""The part of other calls that happen neither at the beginning nor at the end of their time."""
LOOK_S = 0.25
"""On a slow machine: so often a call finds out whether it still is."""


class _Lane:
    """Room for so many calls at once. Whoever finds room goes on without giving way: its call takes virtual time anyway."""

    def __init__(self, width: int) -> None:
        self._free = width
        self._waiting = trio.lowlevel.ParkingLot()

    async def __aenter__(self) -> None:
        await trio.lowlevel.checkpoint_if_cancelled()
        if self._free:
            self._free -= 1
        else:
            await self._waiting.park()  # Who wakes it leaves it the room.

    async def __aexit__(self, *_: object) -> None:
        if not self._waiting.unpark():
            self._free += 1


class SimWorkers:
    """The lanes of one process."""

    def __init__(self, process: Process, paths: Paths, costs: Mapping[str, Delay] = COSTS) -> None:
        self._process = process
        self._paths = paths
        self._costs = costs
        self._lanes: dict[str, _Lane] = {}

    async def run(self, lane: str, function: Callable[..., T], *args: object) -> T:
        assert lane in WIDTHS, f"no lane is called {lane!r}"
        cost = self._cost(lane)
        if cost == 0.0:
            await trio.lowlevel.checkpoint()
            result = await self._call(function, *args)
            await trio.lowlevel.cancel_shielded_checkpoint()
            return result
        async with self._lane(lane):
            before, slowness = self._before(lane, cost), self._slowness()
            if before:
                await self._elapse(before, slowness)
            if not self._process.is_alive:
                await trio.lowlevel.checkpoint()
            result = await self._call(function, *args)
            if before < cost:
                await self._elapse(cost - before, slowness)
            return result

    def _before(self, lane: str, cost: float) -> float:
        """How much of a call's time is over when it happens."""
        dice = self._process.machine.dice
        # What is read at the beginning is old when it is told, what is read at the end is new after a wait: nearly all that
        # can go wrong shows so, for half the events. What happens in between and is undone again needs the middle.
        if lane == SYNCING_LANE or dice.random() < IN_BETWEEN:
            return cost * dice.random()
        return cost * dice.getrandbits(1)

    async def _call(self, function: Callable[..., T], *args: object) -> T:
        try:
            return function(*args)
        except DiskFailed:
            if not self._process.is_alive:
                # A process that died in the middle of a commit raises nothing: its tasks are just gone.
                await trio.lowlevel.checkpoint()
            raise

    def _lane(self, name: str) -> _Lane:
        if name not in self._lanes:
            self._lanes[name] = _Lane(WIDTHS[name])
        return self._lanes[name]

    def _cost(self, lane: str) -> float:
        machine = self._process.machine
        own = self._costs.get(lane)
        cost = own.draw(machine.dice) if own is not None else 0.0
        cost *= self._slowness()
        # A busy processor does not slow its disk down: both together would make minutes of one commit, long after both have healed.
        return cost + machine.disk.sync_s if lane == SYNCING_LANE else cost

    async def _elapse(self, seconds: float, slowness: float) -> None:
        """Let virtual time pass, whoever is cancelled meanwhile; the death of the process ends it.

        `seconds`: on a machine as slow as that. Once it is faster the rest is shortened by as much (that of a slow disk with
        it): else what was begun would be late for long after all is well.
        """
        process = self._process
        while process.is_alive:
            seconds, slowness = seconds * min(1.0, self._slowness() / slowness), min(slowness, self._slowness())
            part = min(seconds, LOOK_S) if slowness > 1.0 else seconds
            current_time_of_simulation().after(part, self._end, trio.lowlevel.current_task())
            await process.last()
            seconds -= part
            if seconds <= 0:
                return

    def _slowness(self) -> float:
        return self._paths.slowness(self._process.machine.name)

    def _end(self, task: trio.lowlevel.Task) -> None:
        time, machine = current_time_of_simulation(), self._process.machine
        if machine.paused_until > time.now:
            time.after(machine.paused_until - time.now, self._end, task)
        else:
            self._process.wake(task)
