"""Nodes of a cluster in the simulated world: the code of real nodes, started, killed, wiped and brought back at will.

A machine (its address, disk and clock) stays; the lives of its node come and go. A life that ends by itself is started
again after a second, as a supervisor would, and is a violation unless the node said that it has to begin anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import trio

from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.location import Location
from scenefold.crypto import MemberSecrets, SealingKey, SigningKey
from scenefold.node.running import run_assembled
from scenefold.peer import Extension, NodeContext, NodeSettings
from scenefold.peer.enrolment.papers import Papers
from scenefold.simulation import laws
from scenefold.simulation.acknowledged import Eyes, judge_acknowledged
from scenefold.simulation.copying import Copying, address_of_slot
from scenefold.simulation.disks import incarnation_of
from scenefold.simulation.ends import judge_end, words_of
from scenefold.simulation.judged import see_judged
from scenefold.simulation.logs import hear_bugs
from scenefold.simulation.watch import Watch
from scenefold.world import leaves
from scenefold.world.facts import ClusterFacts, Credential
from scenefold.world.sim import Point, SimDisk, SimNet

RESTART_S = 1.0
REMOVE_AFTER_S = 20.0
"""As short as the times of the lease allow, so that a storm of a minute sees removals and returns."""
DATA_FOLDER = Path("/data")


def key_of(seed: int, name: str) -> SigningKey:
    """The signing key of somebody, from the seed of the run."""
    return SigningKey.from_seed(hashlib.sha256(f"{seed} key of {name}".encode()).digest())


def secrets_of(seed: int, name: str) -> MemberSecrets:
    """All keys of somebody, from the seed of the run."""
    return MemberSecrets(key_of(seed, name), SealingKey(hashlib.sha256(f"{seed} sealing key of {name}".encode()).digest()))


@dataclass(frozen=True, slots=True)
class Habits:
    """Settings of all nodes of a run that are not what people have. None: as they are."""

    remove_after_s: float | None = REMOVE_AFTER_S
    copying: Copying | None = None
    """None: every space has one copy."""


HABITS = Habits()


@dataclass(eq=False)
class Node:
    """A machine and the life that its node leads just now, if any."""

    slot: int
    address: str
    node_id: NodeId
    secrets: MemberSecrets
    disk: SimDisk
    context: NodeContext | None = None
    scope: trio.CancelScope | None = None
    is_wanted: bool = False
    """Whether somebody wants it to run; a crash ends that until the restart."""
    starts: int = 0
    """How often it was started from outside."""
    has_rotted: bool = False
    """Something beside records was damaged on its disk, or in a backup of it."""
    must_be_wiped: bool = False
    """Its last life ended over that."""
    told_to_leave: bool = False
    """Somebody asked it to leave at least once; it remembers that over restarts and new incarnations."""
    is_lost: bool = False
    """It will never run again."""
    has_left: bool = False
    """It was drained and is switched off, until somebody starts it again as a newcomer."""
    left: trio.Event = field(default_factory=trio.Event)
    """Set when it has left for the first time."""
    born: trio.Event = field(default_factory=trio.Event)
    """Set once its machine exists."""
    gone: trio.Event = field(default_factory=trio.Event)
    """Set while no life is under way."""

    @property
    def name(self) -> str:
        return f"node:{self.node_id}"

    @property
    def credential(self) -> Credential:
        return Credential(self.node_id, self.address, self.secrets.signing.public, self.secrets.sealing.public)

    def owns(self, location: Location) -> bool:
        return self.context is not None and self.context.line.owns(location)

    def has_lease(self) -> bool:
        return self.context is not None and self.context.lease.holds()


@dataclass(slots=True)
class RenderTrap:
    """Goes off when so many more packets of renders have come to a node; `is_late`: once the last one is handled."""

    slot: int
    count: int
    spring: Callable[[], None]
    is_late: bool


class Cluster:
    """All machines of a run, founders first, then spares."""

    def __init__(self, net: SimNet, founders: int, spares: int, nursery: trio.Nursery, habits: Habits = HABITS) -> None:
        self.net = net
        self.habits = habits
        self.nodes: dict[int, Node] = {}
        self.on_death: Callable[[Node], object] = lambda _: None
        """Called with each node that is killed, at that instant."""
        self.eyes: Eyes | None = None
        """Who looks on at what nodes answer, beside the watch."""
        self.lookers: list[Callable[[int], object]] = []
        """Called with the slot of a node of which something has become durable; before the watch, over which its machine may die at that instant."""
        self._running: dict[int, Node] = {}
        self._nursery = nursery
        for slot in range(founders + spares):
            address = address_of_slot(slot, 0 if habits.copying is None else habits.copying.racks)
            node = Node(slot, address, node_id_of(address), secrets_of(net.seed, f"n{slot}"), SimDisk())
            node.gone.set()
            self.nodes[slot] = node
        self._slots = {node.node_id: slot for slot, node in self.nodes.items()}
        disks = {slot: node.disk for slot, node in self.nodes.items()}
        self.watch = Watch(lambda: net.now, disks, self._running, self.slot_of)
        hear_bugs(partial(self.watch.violated, laws.SOUND))
        self._log_key = key_of(net.seed, "the cluster's log")
        ids = [node.node_id for node in self.nodes.values()]
        self._has_log_key = True
        self.extensions: Sequence[Extension] = ()
        self.set_render_trap: Callable[[RenderTrap], None] = lambda _: None
        """Takes a trap, where there are renders."""
        self.has_several_voters = False
        """Whether others are to vote beside the first one."""
        self.may_lose: Callable[[Node], bool] = lambda node: node is not self.nodes[0]
        """Whether the cluster can go on without the disk of a node."""
        self.voters_missing: Callable[[], str] = lambda: ""
        """What of those who shall vote is not as it shall be."""
        self.facts = ClusterFacts(
            name="simulated",
            cluster_id=hashlib.sha256(f"{net.seed} cluster".encode()).digest()[:16],
            ports=net.ports,
            seeds=tuple(node.address for node in list(self.nodes.values())[:3]),
            credentials=tuple(sorted((node.credential for node in self.nodes.values()), key=lambda one: one.node_id)),
            founders=tuple(sorted(ids[:founders])),
            voters=(ids[0],),
            log_key=self._log_key.public,
        )

    @property
    def founding(self) -> list[Node]:
        """Those that were there from the beginning."""
        return [self.nodes[slot] for slot in range(len(self.facts.founders))]

    @property
    def voter(self) -> Node:
        """Who decides alone; where several do, who of those that run knows their log furthest."""
        running = [node for _, node in sorted(self._running.items())] if self.has_several_voters else []
        return max(running, key=_log_position, default=self.nodes[0])

    def slot_of(self, node_id: int) -> int:
        """The slot of a node; -1 for a stranger."""
        return self._slots.get(NodeId(node_id), -1)

    @property
    def running(self) -> dict[int, Node]:
        """Nodes that can answer just now, by slot."""
        return self._running

    # ------------------------------------------------------------------------------------------------------- lives

    def start(self, slot: int) -> None:
        """Let the node run, and run again whenever it ends by itself."""
        node = self.nodes[slot]
        if not node.is_wanted and not node.is_lost:
            node.is_wanted, node.has_left = True, False
            node.starts += 1
            self._nursery.start_soon(self._live, node, node.starts, name=f"n{slot}")

    def crash(self, slot: int, *, silent: bool = False, torn: bool = False) -> bool:
        """Kill the node at this instant; False if it does not run."""
        node = self.nodes[slot]
        if not node.is_wanted:
            return False
        self.watch.tell(slot, "dies{}{}", " silently" if silent else "", ", its last write torn" if torn else "")
        node.is_wanted = False
        self._down(node)
        self.net.crash(node.address, silent=silent, torn=torn)
        if node.scope is not None:
            node.scope.cancel()
        self.on_death(node)
        return True

    async def restart(self, slot: int, after_s: float) -> None:
        """Start a dead node again in a while."""
        await trio.sleep(after_s)
        await self.nodes[slot].gone.wait()
        self.start(slot)

    def wipe(self, node: Node, why: str) -> None:
        """A dead node gets an empty disk."""
        before, incarnation = self.watch.records(node.slot), incarnation_of(node.disk)
        node.disk.wipe()
        self.watch.disk_replaced(node.slot, before, incarnation, why)

    def _down(self, node: Node) -> None:
        self._running.pop(node.slot, None)
        node.context = None
        self.watch.reach.goes_down(node.slot, self.net.now)

    async def _live(self, node: Node, start: int) -> None:
        """Life after life, until nobody wants it any more, or it was killed and started anew by another call."""
        await node.gone.wait()
        while node.is_wanted and node.starts == start:
            node.gone = trio.Event()
            try:
                why = await self._one_life(node)
            finally:
                node.gone.set()
            if not node.is_wanted:
                self.watch.tell(node.slot, "has ended: {}", why)
                return
            self._down(node)
            self.watch.tell(node.slot, "ends: {}", why)
            self.net.crash(node.address)
            if node.must_be_wiped:
                node.must_be_wiped = False
                self.wipe(node, "stops over a damaged page and is wiped")
            await trio.sleep(RESTART_S)

    def _committed(self, slot: int) -> None:
        for see in self.lookers:
            see(slot)
        self.watch.committed(slot)

    async def _one_life(self, node: Node) -> str:
        world = self.net.world(node.name, node.address, node.disk)
        if not node.born.is_set():
            node.born.set()
            self.net.observe(node.address, Point.AFTER_COMMIT, partial(self._committed, node.slot))
        settings = self._settings(node)
        log_key = self._log_key if node.slot == 0 and self._has_log_key else None
        papers = Papers(forget_log_key=partial(setattr, self, "_has_log_key", False))
        ends: list[BaseException] = []
        came_up = False
        with trio.CancelScope() as node.scope:
            try:
                async with trio.open_nursery() as life:
                    living = partial(run_assembled, settings, self.facts, node.secrets, log_key, world, self.extensions, papers=papers)
                    context = await life.start(living)
                    came_up = True
                    if node.is_wanted:
                        self._is_up(node, context)
            except* Exception as group:  # noqa: BLE001  whatever a node dies of is told, and judged
                ends = list(leaves(group))
        if not node.is_wanted:
            return "killed"
        return self._judge_end(node, ends, came_up=came_up)

    def _settings(self, node: Node) -> NodeSettings:
        settings = NodeSettings(profile_folder=Path("/profile"), address=node.address, data_folder=DATA_FOLDER, memory_bytes=1 << 30)
        remove_after_s, copying = self.habits.remove_after_s, self.habits.copying
        if copying is not None and copying.racks:
            settings = replace(settings, blacklist=(copying.prefix_of(node.slot),))
        return settings if remove_after_s is None else replace(settings, remove_after_s=remove_after_s)

    def _judge_end(self, node: Node, ends: list[BaseException], *, came_up: bool) -> str:
        """Why a life ended that nobody ended; what must not be is a violation."""
        if judge_end(node, self.watch, ends, came_up=came_up):
            node.is_wanted, node.has_left = False, True
            node.left.set()
            self._down(node)
            self.net.crash(node.address)
        return words_of(ends)

    def _is_up(self, node: Node, context: NodeContext) -> None:
        incarnation = incarnation_of(node.disk)
        self.watch.tell(
            node.slot, "runs, boot {}, incarnation {}", context.store.identity.boot, "" if incarnation is None else incarnation.hex()[:8]
        )
        node.context = context
        self._running[node.slot] = node
        self.watch.reach.comes_up(node.slot, self.net.now)

        def is_alive() -> bool:
            return self._running.get(node.slot) is node and node.context is context

        judge_acknowledged(context, node.slot, is_alive, self.watch, lambda: self.eyes)
        see_judged(context, self.watch.judged)
        if self.eyes is not None:
            self.eyes.comes_up(node.slot, context)


def _log_position(node: Node) -> int:
    return 0 if node.context is None else node.context.cluster_log.registry.position
