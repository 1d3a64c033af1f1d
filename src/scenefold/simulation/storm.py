"""Makes the faults of a schedule happen, each in a task of its own, and ends them all when the storm is over.

A fault counts once it has taken effect: a crash of a node that is down already is none. What needs a moment that may not
come (the n-th commit, a handover) lies in wait until the storm is over.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from typing import ClassVar

import trio

from scenefold.peer.line.holding import Handover, Step
from scenefold.simulation.blacklist_faults import BlacklistFaults
from scenefold.simulation.client_faults import ClientFaults
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster, Node, RenderTrap
from scenefold.simulation.copies_faults import CopiesFaults
from scenefold.simulation.disk_faults import DiskFaults
from scenefold.simulation.disks import handovers_of
from scenefold.simulation.faults import CLIENTS, HANDOVER_STEPS, KINDS, Fault, Kind
from scenefold.simulation.hostile import HostileFaults
from scenefold.simulation.link_faults import LinkFaults
from scenefold.simulation.overlaps import Overlaps
from scenefold.simulation.workload import client_name
from scenefold.world.sim import CALM, Point, Weather

_POINTS = {
    Kind.CRASH_BEFORE_COMMIT: Point.BEFORE_COMMIT,
    Kind.CRASH_AFTER_COMMIT: Point.AFTER_COMMIT,
    Kind.CRASH_BEFORE_SEND: Point.BEFORE_SEND,
    Kind.CRASH_AFTER_SEND: Point.AFTER_SEND,
    Kind.TORN_WRITE: Point.BEFORE_COMMIT,
}
_STEPS = (Step.OFFERED, Step.NOTED, Step.RELEASED, Step.TAKEN, Step.GIVEN)


class Storm:
    """Faults at work on a cluster."""

    def __init__(
        self, cluster: Cluster, drain: Callable[[Node], Awaitable[bool]], nursery: trio.Nursery, clients: Sequence[Client] = ()
    ) -> None:
        self.happened = Counter[str]()
        self._cluster = cluster
        self._net = cluster.net
        self._watch = cluster.watch
        self._drain = drain
        self._nursery = nursery
        self._disks = DiskFaults(cluster, self._begins, self._ends, lambda: self._is_over)
        self._links = LinkFaults(cluster, self._begins, self._ends, lambda: self._is_over)
        self._hostile = HostileFaults(cluster, self._begins, self._ends, lambda: self._is_over, clients)
        self._of_clients = ClientFaults(cluster, self._begins, self._ends, lambda: self._is_over)
        self._copies = CopiesFaults(cluster, self._begins, lambda: self._is_over, self._links, nursery)
        self._blacklists = BlacklistFaults(cluster, self._begins, self._ends, lambda: self._is_over, clients)
        self._weather: dict[Fault, Weather] = {}
        self._burdens: Overlaps[tuple[int, Kind]] = Overlaps()
        self._wait_for_handover: list[Fault] = []
        self._handovers: dict[int, list[Handover]] = {}
        self._is_over = False
        self._watch.on_handover = self._handover_moves

    async def befall(self, fault: Fault) -> None:
        """Wait until the fault begins, make it happen, and end it."""
        self._hostile.lies_in_wait(fault)
        await trio.sleep_until(fault.begin_s)
        if not self._is_over:
            await self._act(fault)

    def end(self) -> None:
        """Everything heals, everybody runs; what was lost stays lost."""
        self._is_over = True
        self._watch.tell(None, "the storm is over: everything heals")
        self._net.calm()
        self._weather.clear()
        self._net.set_weather(CALM)
        for node in self._cluster.nodes.values():
            if node.born.is_set():
                self._net.machine(node.address).clock.set_rate(1.0)
        self._of_clients.end()

    # ------------------------------------------------------------------------------------------------------ kinds

    async def _act(self, fault: Fault) -> None:
        match fault.kind:
            case Kind.CLOCK_OFFSET:
                self._set_clocks(fault)
            case Kind.SLEEP:
                self._sleep(fault)
            case Kind.KILL_IN_HANDOVER:
                self._wait_for_handover.append(fault)
            case Kind.REPLAY | Kind.LIAR | Kind.LYING_HOLDER:
                await self._hostile.befall(fault)
            case Kind.BLACKLIST:
                await self._blacklists.befall(fault)
            case kind if KINDS[kind].of_clients:
                await self._of_clients.befall(fault)
            case kind if KINDS[kind].of_copies:
                await self._copies.befall(fault)
            case Kind.KILL_IN_RENDER:
                self._set_render_trap(fault)
            case kind if kind in _POINTS:
                self._set_trap(fault, _POINTS[kind])
            case kind:
                await self._LASTING[kind](self, fault)

    def _begins(self, fault: Fault) -> None:
        self.happened[fault.kind.value] += 1
        self._watch.tell(None, "fault begins: {}", fault)

    def _ends(self, fault: Fault) -> None:
        if not self._is_over:
            self._watch.tell(None, "fault ends: {}", fault)

    def _node(self, fault: Fault, index: int = 0) -> Node:
        return self._cluster.nodes[fault.slots[index]]

    async def _bad_weather(self, fault: Fault) -> None:
        """Several kinds of bad weather add up."""
        self._begins(fault)
        self._weather[fault] = CALM
        self._set_weather()
        await trio.sleep_until(fault.end_s)
        self._weather.pop(fault, None)
        if not self._is_over:
            self._set_weather()
        self._ends(fault)

    def _set_weather(self) -> None:
        weather = CALM
        for fault in self._weather:
            if fault.kind is Kind.LOSS:
                weather = replace(weather, loss=max(weather.loss, fault.amount))
            elif fault.kind is Kind.DUPLICATION:
                weather = replace(weather, duplication=max(weather.duplication, fault.amount))
            else:
                weather = replace(weather, reordering=0.5, held_back_s=max(weather.held_back_s, fault.amount))
        self._net.set_weather(weather)

    async def _burden(self, fault: Fault) -> None:
        """A machine that works on, but badly; as badly as the worst of what lies on it says."""
        target = fault.slots[0], fault.kind
        self._begins(fault)
        self._burdens.begin(target, fault)
        self._lay(*target)
        self._watch.reach.hampered(fault.slots[0], self._net.now)
        await trio.sleep_until(fault.end_s)
        if not self._is_over:
            self._burdens.end(target, fault)
            self._lay(*target)
            self._watch.reach.relieved(fault.slots[0], self._net.now)
            self._ends(fault)

    def _lay(self, slot: int, kind: Kind) -> None:
        """Lay burdens of a kind on a machine, or take them off."""
        address, amount = self._cluster.nodes[slot].address, self._burdens.worst((slot, kind))
        machine = self._net.machine(address)
        match kind:
            case Kind.SLOW_NODE:
                self._net.slow(address, amount or 1.0)
            case Kind.SLOW_DISK:
                machine.disk.slow(amount or 0.0)
            case _:
                machine.clock.set_rate(1.0 + (amount or 0.0))

    async def _pause(self, fault: Fault) -> None:
        """A machine stands still; its clock does not."""
        node = self._node(fault)
        if not node.is_wanted:
            return
        self._begins(fault)
        self._net.pause(node.address, fault.end_s - fault.begin_s)
        with self._links.apart([(node.slot, other) for other in self._cluster.nodes if other != node.slot]):
            await trio.sleep_until(fault.end_s)
        self._ends(fault)

    async def _crash(self, fault: Fault) -> None:
        if self._cluster.crash(fault.slots[0], silent=fault.amount > 0.5):
            self._begins(fault)
            await self._cluster.restart(fault.slots[0], fault.end_s - fault.begin_s)

    async def _power(self, fault: Fault) -> None:
        """All machines vanish at one moment, as if each one's power was cut; they start one after the other, in an order of their own."""
        born = [slot for slot, node in self._cluster.nodes.items() if node.born.is_set()]
        dead = [slot for slot in born if self._cluster.crash(slot, silent=True)]
        if not dead:
            return
        self._begins(fault)
        order = sorted(dead, key=lambda slot: (slot * 2_654_435_761 + int(fault.begin_s * 1_000)) % 1_009)
        async with trio.open_nursery() as nursery:
            for turn, slot in enumerate(order):
                nursery.start_soon(self._cluster.restart, slot, fault.end_s - fault.begin_s + fault.amount * turn / len(order))

    def _set_trap(self, fault: Fault, point: Point) -> None:
        """Crash at the n-th commit or send from now on, to the step; it goes with the life that it waits in."""
        node = self._node(fault)

        def spring() -> None:
            if self._cluster.crash(node.slot, torn=fault.kind is Kind.TORN_WRITE):
                self._begins(fault)
                self._nursery.start_soon(self._cluster.restart, node.slot, fault.end_s - fault.begin_s)

        if node.is_wanted:
            self._net.trap(node.address, point, max(1, int(fault.amount)), spring)

    def _set_render_trap(self, fault: Fault) -> None:
        """Crash at the n-th packet of renders that comes to a node, before it is handled or before it is answered."""

        def spring() -> None:
            if not self._is_over and self._cluster.crash(fault.slots[0]):
                self._begins(fault)
                self._nursery.start_soon(self._cluster.restart, fault.slots[0], fault.end_s - fault.begin_s)

        count = int(fault.amount)
        self._cluster.set_render_trap(RenderTrap(fault.slots[0], count, spring, is_late=count % 2 == 0))

    async def _hit_links(self, fault: Fault) -> None:
        await self._links.befall(fault)

    async def _hit_disk(self, fault: Fault) -> None:
        await self._disks.befall(fault)

    def _set_clocks(self, fault: Fault) -> None:
        """The time of day jumps, of a node and of a client."""
        self._begins(fault)
        client = client_name(fault.slots[0] % CLIENTS)
        for name in (self._node(fault).address, client):
            self._net.machine(name).clock.step_wall(fault.amount)

    def _sleep(self, fault: Fault) -> None:
        """All machines sleep at one moment, and wake at another one."""
        self._begins(fault)
        born = [node.address for node in self._cluster.nodes.values() if node.born.is_set()]
        for name in (*born, *map(client_name, range(CLIENTS))):
            self._net.machine(name).clock.sleep_through(fault.amount)
        self._watch.moves.slept()

    async def _join(self, fault: Fault) -> None:
        """A spare is started; it may be killed at one of its first commits."""
        node = self._node(fault)
        self._cluster.start(node.slot)
        if fault.kind is Kind.JOIN:
            self._begins(fault)
            return
        await node.born.wait()
        self._set_trap(fault, Point.AFTER_COMMIT)

    async def _drain_node(self, fault: Fault) -> None:
        """A node is told to leave; some that did are switched on again."""
        node = self._node(fault)
        if not node.is_wanted or not await self._drain(node):
            return
        self._begins(fault)
        await node.left.wait()
        if fault.amount > 0.5:
            await self._cluster.restart(node.slot, fault.end_s - fault.begin_s)

    def _handover_moves(self, slot: int) -> None:
        """Called in the middle of a commit that changes an open handover."""
        self._disks.handover_moves(slot)
        before = self._handovers.get(slot, [])
        self._handovers[slot] = handovers_of(self._cluster.nodes[slot].disk)
        if self._is_over:
            return
        for handover in self._handovers[slot]:
            if any((other.id, other.step) == (handover.id, handover.step) for other in before):
                continue
            for fault in list(self._wait_for_handover):
                if self._kills_at(fault, slot, handover):
                    self._wait_for_handover.remove(fault)
                    return

    def _kills_at(self, fault: Fault, slot: int, handover: Handover) -> bool:
        """Whether this is the step that a fault lies in wait for, and who is to die at it has died."""
        of_peer, step = divmod(int(fault.amount) - 1, HANDOVER_STEPS)
        victim = self._cluster.slot_of(handover.peer.node) if of_peer else slot
        if handover.step is not _STEPS[step] or not self._cluster.crash(victim):
            return False
        self._begins(fault)
        self._watch.tell(victim, "is killed in a handover")
        self._nursery.start_soon(self._cluster.restart, victim, fault.end_s - fault.begin_s)
        return True

    _LASTING: ClassVar[dict[Kind, Callable[[Storm, Fault], Awaitable[None]]]] = {
        Kind.PARTITION: _hit_links,
        Kind.ONE_WAY: _hit_links,
        Kind.CLOG: _hit_links,
        Kind.LOSS: _bad_weather,
        Kind.DUPLICATION: _bad_weather,
        Kind.REORDERING: _bad_weather,
        Kind.SLOW_NODE: _burden,
        Kind.SLOW_DISK: _burden,
        Kind.DISK_FULL: _hit_disk,
        Kind.CLOCK_RATE: _burden,
        Kind.PAUSE: _pause,
        Kind.RESET: _hit_links,
        Kind.CRASH: _crash,
        Kind.CORRUPTION: _hit_disk,
        Kind.WIPED_DISK: _hit_disk,
        Kind.RESTORED_BACKUP: _hit_disk,
        Kind.JOIN: _join,
        Kind.KILL_IN_JOIN: _join,
        Kind.DRAIN: _drain_node,
        Kind.POWER: _power,
    }
