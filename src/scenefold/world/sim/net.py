"""The network of a simulated cluster: all machines, all paths between them, and every fault that can befall them.

One event of virtual time delivers a datagram, or the next piece of a stream. What is sent while a path is cut, or
arrives while it is, is lost (datagrams) or waits (streams). All dice of a packet belong to the machine that sends it.
"""

from __future__ import annotations

import random
import zlib
from collections import Counter, deque
from collections.abc import Callable, Mapping

import trio

from scenefold.crypto import Card
from scenefold.world.ports import Endpoint, Ports, World
from scenefold.world.sim.clock import SimClock
from scenefold.world.sim.datagrams import EVERYWHERE, SimDatagrams
from scenefold.world.sim.disk import SimDisk
from scenefold.world.sim.entropy import SimEntropy, dice
from scenefold.world.sim.faults import Faults
from scenefold.world.sim.machines import Machine, Process
from scenefold.world.sim.network import ProcessDisk, SimNetwork
from scenefold.world.sim.paths import Path, Paths
from scenefold.world.sim.pipes import Content, Pipe
from scenefold.world.sim.time import VirtualTime, current_time_of_simulation
from scenefold.world.sim.trace import Trace
from scenefold.world.sim.weather import CALM, Delay, Weather, fate_of_datagram
from scenefold.world.sim.workers import COSTS, SimWorkers
from scenefold.world.versions import TAKEN, Versions

CLIENT_NETWORK = "10.255."
EPHEMERAL_PORT = 40_000
KEPT_DATAGRAMS_MAX = 2_000


class SimNet(Faults):
    """The network, and the machines on it. Make it, then `world(...)` for each life of a node or a client."""

    def __init__(
        self,
        seed: int,
        *,
        weather: Weather = CALM,
        trace: Trace | None = None,
        ports: Ports | None = None,
        costs: Mapping[str, Delay] = COSTS,
    ) -> None:
        """`costs`: virtual seconds of a worker's call by lane; the others cost none."""
        self.seed = seed
        self.trace = trace if trace is not None else Trace()
        self.ports = ports or Ports()
        self.paths = Paths(weather)
        self.counts: Counter[str] = Counter()
        """What faults did, by kind: lost, doubled, held back, cut, dropped, reset, stalled, refused, crashed ..."""
        self._costs = costs
        self._time: VirtualTime | None = None
        self._machines: dict[str, Machine] = {}
        self._at_address: dict[str, Machine] = {}
        self._pipes: dict[Path, dict[int, Pipe]] = {}
        self._pipe_count = 0
        self._ports_given = 0
        self._tape: deque[tuple[Path, Endpoint, bytes, Endpoint]] | None = None
        """Datagrams sent lately, if somebody keeps them."""

    # ------------------------------------------------------------------------------------------------- worlds

    def world(
        self,
        name: str,
        address: str | None = None,
        disk: SimDisk | None = None,
        *,
        authority: str = "cluster",
        trusts: str = "cluster",
        versions: Versions = TAKEN,
        certificate: bytes = b"",
    ) -> World:
        """The world of a new process: "node:<id>" at its address, or "user:<name>" without one.

        A machine is made when it is first named, with `disk` or an empty one; a later `disk` is put into it. A process
        named like an earlier one draws other randomness. `authority` issued its certificate, and it believes in those
        that `trusts` issued. Its program takes these `versions` of the protocol. With a `certificate` (PEM), peers see the key in that,
        and judge its dates.
        """
        machine = self.machine(address or name) if (address or name) in self._machines else self._new_machine(name, address)
        if disk is not None:
            machine.disk = disk
        machine.lives += 1
        process = Process(name, machine, authority, trusts, versions, card=Card.read(certificate) if certificate else None)
        machine.processes.append(process)
        self._come_up(machine)
        entropy = SimEntropy(self.seed, f"entropy of life {machine.lives} at {machine.name} of {name}")
        network, folders = SimNetwork(self, process), ProcessDisk(self, process)
        return World(machine.clock, entropy, SimWorkers(process, self.paths, self._costs), network, folders)

    def _new_machine(self, name: str, address: str | None) -> Machine:
        called = address or name
        number = len(self._machines)
        clock = SimClock(lambda: self.now, dice(self.seed, f"clock of {called}"))
        machine = Machine(
            called,
            address or f"{CLIENT_NETWORK}{number >> 8}.{number & 255}",
            clock,
            SimDisk(),
            dice(self.seed, f"packets of {called}"),
        )
        clock.paused_until = lambda: machine.paused_until
        self._machines[called] = self._at_address[machine.address] = machine
        return machine

    def machine(self, name: str) -> Machine:
        """The machine at a node's address, or of a client's name."""
        return self._machines[name]

    def home(self, address: str, process: Process) -> Machine:
        """The machine with an address; the process's own gets it if there is none."""
        if address not in self._at_address:
            self._at_address[address] = self._machines[address] = process.machine
        return self._at_address[address]

    def machine_at(self, address: str) -> Machine | None:
        return self._at_address.get(address)

    # --------------------------------------------------------------------------------------------------- time

    @property
    def now(self) -> float:
        if self._time is not None:
            return self._time.now
        return self._clock().now if trio.lowlevel.in_trio_run() else 0.0

    def _clock(self) -> VirtualTime:
        if self._time is None:
            self._time = current_time_of_simulation()
        return self._time

    def after(self, seconds: float, function: Callable[..., None], *args: object) -> None:
        self._clock().after(seconds, function, *args)

    def at(self, when: float, function: Callable[..., None], *args: object) -> None:
        self._clock().at(when, function, *args)

    def after_trips(self, path: Path, trips: int, function: Callable[..., None], *args: object) -> None:
        """After so many one-way delays of a path, there and back again."""
        machine = self._machines.get(path[0]) or self._machines[path[1]]
        delay = sum(self.weather_of(path).delay.draw(machine.dice) for _ in range(trips))
        self.at(self.departure(machine) + delay * self.factor(path), function, *args)

    def departure(self, machine: Machine) -> float:
        """When what a machine sends now leaves it."""
        return max(self.now, machine.paused_until)

    def held_until(self, machine: Machine) -> float | None:
        """Until when a machine takes nothing in; None if it does."""
        return machine.paused_until if machine.paused_until > self.now else None

    # -------------------------------------------------------------------------------------------------- paths

    def weather_of(self, path: Path) -> Weather:
        return self.paths.weather_of(*path)

    def factor(self, path: Path) -> float:
        return self.paths.factor(*path)

    def bytes_per_s(self, path: Path) -> float:
        return self.paths.bytes_per_s(*path)

    def reaches(self, path: Path) -> bool:
        """Whether what is sent now arrives: the path is whole and there is a machine at its end."""
        target = self._machines.get(path[1])
        return target is not None and target.is_up and not self.paths.is_cut(*path)

    # ---------------------------------------------------------------------------------------------- datagrams

    def bind(self, process: Process, address: str | None, port: int, *, hears_all: bool = False) -> SimDatagrams:
        """A socket at an address and port, which must be free, or anywhere. `hears_all`: it hears broadcasts to that port, and nothing else."""
        machine = process.machine if address is None else self.home(address, process)
        if address is None:
            self._ports_given += 1
        here = Endpoint(machine.address, port if address is not None else EPHEMERAL_PORT + self._ports_given)
        socket = SimDatagrams(self, process, here, port)
        (machine.hearing if hears_all else machine.sockets)[here.port] = socket
        process.sockets[socket] = None
        return socket

    def carry(self, machine: Machine, here: Endpoint, data: bytes, target: Endpoint) -> None:
        """Send a datagram on its way, or one to everybody on as many."""
        if target.address == EVERYWHERE:
            for name in sorted(self._machines):
                if target.port in self._machines[name].hearing:
                    self._send((machine.name, name), machine, here, data, target)
            return
        there = self._at_address.get(target.address)
        self._send((machine.name, there.name if there is not None else target.address), machine, here, data, target)

    def _send(self, path: Path, machine: Machine, here: Endpoint, data: bytes, target: Endpoint) -> None:
        self.note("udp-send", *here, *target, len(data), zlib.crc32(data))
        if self._tape is not None:
            self._tape.append((path, here, data, target))
        if not self.reaches(path):
            self._lose("cut", path)
            return
        fate = fate_of_datagram(self.weather_of(path), machine.dice)
        if not fate.delays_s:
            self._lose("lost", path)
            return
        self.counts["held back"] += fate.held_back
        self.counts["doubled"] += len(fate.delays_s) - 1
        size_s = len(data) / self.bytes_per_s(path)
        for delay in fate.delays_s:
            self.at(self.departure(machine) + delay * self.factor(path) + size_s, self._arrive, path, here, data, target)

    def keep_datagrams(self) -> None:
        """From now on, keep what is sent for a while, so that somebody can send it again."""
        self._tape = self._tape or deque(maxlen=KEPT_DATAGRAMS_MAX)

    def play_again(self, dice: random.Random, spoil: Callable[[bytes], bytes] | None = None) -> None:
        """Send a datagram that was kept once more to whom it was for, spoilt or not."""
        if self._tape:
            path, source, data, target = self._tape[dice.randrange(len(self._tape))]
            self.counts["played again"] += 1
            self.at(self.now, self._arrive, path, source, data if spoil is None else spoil(data), target)

    def _arrive(self, path: Path, source: Endpoint, data: bytes, target: Endpoint) -> None:
        if not self.reaches(path):
            self._lose("cut", path)
            return
        machine = self._machines[path[1]]
        held = self.held_until(machine)
        if held is not None:
            self.at(held, self._arrive, path, source, data, target)
            return
        socket = (machine.hearing if target.address == EVERYWHERE else machine.sockets).get(target.port)
        if socket is None:
            self._lose("nobody there", path)
        elif socket.arrive(data, source):
            self.note("udp-arrive", *source, *target, len(data), zlib.crc32(data))
        else:
            self._lose("dropped", path)

    def _lose(self, how: str, path: Path) -> None:
        self.counts[how] += 1
        self.note("udp-gone", how.replace(" ", "-"), *path)

    # ------------------------------------------------------------------------------------------------ streams

    def pipes(self, client: Process, node: Process, path: Path) -> tuple[Pipe, Pipe]:
        """The two directions of a new connection, there and back."""
        there, back = path
        pair = []
        for source, target, way in ((client, node, (there, back)), (node, client, (back, there))):
            self._pipe_count += 1
            pipe = Pipe(self, self._pipe_count, source, target, way)
            self._pipes.setdefault(way, {})[pipe.number] = pipe
            pair.append(pipe)
        self.note("connect", there, back, pair[0].number)
        return pair[0], pair[1]

    def forget(self, pipe: Pipe) -> None:
        """Nothing goes through it any more."""
        self._pipes.get(pipe.path, {}).pop(pipe.number, None)

    def pipes_on(self, source: str, target: str) -> list[Pipe]:
        return list(self._pipes.get((source, target), {}).values())

    def all_pipes(self) -> list[Pipe]:
        return [pipe for pipes in self._pipes.values() for pipe in pipes.values()]

    def answer(self, path: Path, function: Callable[[], None]) -> None:
        """A kernel's short answer to what it cannot place; lost if the path is cut."""
        if self.reaches(path):
            self.after_trips(path, 1, function)

    def trace_piece(self, kind: str, pipe: Pipe, data: Content) -> None:
        if isinstance(data, bytes):
            self.note(kind, pipe.number, *pipe.path, len(data), zlib.crc32(data))
        else:
            self.note(kind, pipe.number, *pipe.path, getattr(data, "name", "introduction"))

    # -------------------------------------------------------------------------------------------------- trace

    def note(self, kind: str, *details: object) -> None:
        """A line of the trace; whoever runs the simulation may add its own."""
        self.trace.write(self.now, kind, *details)
