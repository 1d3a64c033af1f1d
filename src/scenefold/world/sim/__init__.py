"""The simulated world: the same five ports as `world.real`, in memory, in virtual time, from a seed (specs/14).

How to use it:

    async def main() -> None:
        net = SimNet(seed)                                  # one network for all; weather, trace
        world = net.world("node:167772161", "10.0.0.1")     # one call per life of a process
        client = net.world("user:ada")
        ...                                                 # run the nodes' own code in nurseries
        net.crash("10.0.0.1"); scope.cancel()               # the crash is in force before any task learns of it
        world = net.world("node:167772161", "10.0.0.1")     # the same machine and disk, a new life, other randomness
        print(net.trace.hash)

    run_simulated(seed, main)

Faults are methods of `SimNet` (faults.py: set_weather, cut, mend, partition, unite, clog, unclog, slow, pause, reset,
crash, trap, calm) and of a machine's disk, `net.machine(address).disk` (disk.py: fill, slow, corrupt, wipe, snapshot, restore,
lies). Clocks: `net.machine(address).clock.set_rate(1.001)`. A trap calls a function in the middle of the n-th send or
commit: `net.trap(address, Point.BEFORE_COMMIT, 3, crash_it)`; `net.observe(address, Point.AFTER_COMMIT, look)` calls one
each time, and `disk.peek(table)` shows what is there. `net.note(kind, ...)` adds a line to the trace.

What holds: nothing runs in threads, a worker's call is atomic; time passes only while no task can run; an event is a heap
entry, not a task; after `crash` nothing of the process reaches network or disk, `Environment.update` raises DiskFailed and
sends vanish; a task that cannot be cancelled (a shield) is let go a virtual second later. A deadlock, or a limit of
`run_simulated`, raises SimulationStuck with a list of who waits where.
"""

from scenefold.world.sim.disk import SimDisk
from scenefold.world.sim.entropy import SimEntropy, dice
from scenefold.world.sim.machines import Point
from scenefold.world.sim.net import SimNet
from scenefold.world.sim.paths import Partition
from scenefold.world.sim.run import run_on, run_simulated
from scenefold.world.sim.time import SimulationStuck, VirtualTime
from scenefold.world.sim.trace import Trace
from scenefold.world.sim.weather import CALM, STILL, Delay, Weather
from scenefold.world.sim.workers import COSTS

__all__ = [
    "CALM",
    "COSTS",
    "STILL",
    "Delay",
    "Partition",
    "Point",
    "SimDisk",
    "SimEntropy",
    "SimNet",
    "SimulationStuck",
    "Trace",
    "VirtualTime",
    "Weather",
    "dice",
    "run_on",
    "run_simulated",
]
