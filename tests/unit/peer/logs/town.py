"""Nodes that run one log on a simulated network: stores on simulated disks, datagrams that are lost, doubled and late, lives that end.

Everything of the node's but the packets' bytes is the real thing: the store, the shell, the machine. The log is that of the machine's own
tests (`Book`), whose values are requests.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import trio

from scenefold.base.errors import LocalFault, Unreachable
from scenefold.base.ids import NodeId, node_id_of
from scenefold.consensus import Learn, Message, Participants, Setting
from scenefold.peer.logs import Log, Owner, open_log
from scenefold.store import Store, open_store
from scenefold.wire import Member
from scenefold.world import Datagrams, Priority, leaves
from scenefold.world.sim import Point, SimDisk, SimNet, Weather, dice
from unit.consensus.logs_made import GENESIS, Book, key_of, participant
from unit.peer.logs.watch import Watch

FOLDER = Path("data")
REPLAYED_MAX = 300
AT_ONCE_BYTES = 0


@dataclass
class Node:
    """One machine, its disk and its present life."""

    number: int
    address: str
    disk: SimDisk
    member: Member
    log: Log | None = None
    """None while it is down, or comes up."""
    scope: trio.CancelScope | None = None
    gone: trio.Event = field(default_factory=trio.Event)
    is_wanted: bool = False

    @property
    def id(self) -> NodeId:
        return self.member.node


class Town:
    """`sees_cracks`: nodes know whom they cannot reach, otherwise they must find out each time."""

    def __init__(self, seed: int, weather: Weather, *, sees_cracks: bool) -> None:
        self.seed = seed
        self.net = SimNet(seed, weather=weather)
        self.dice = dice(seed, "town")
        self.nodes: dict[int, Node] = {}
        self.sees_cracks = sees_cracks
        self.by_id: dict[NodeId, Node] = {}
        self.replaced: frozenset[NodeId] = frozenset()
        """Nodes that are up, as others that take no part in the log."""
        self.owner = Owner()
        self.at_once_bytes = AT_ONCE_BYTES
        self.replayed = 0.0
        """Odds that, with a packet, an old one comes once more."""
        self._old: list[tuple[NodeId, str, bytes]] = []
        self.ends: list[str] = []
        """Why lives ended that nobody had ended."""

    async def found(self, count: int, nursery: trio.Nursery) -> None:
        """As many nodes, none of which runs yet; all of them decide."""
        self._nursery = nursery
        for number in range(1, count + 1):
            address, disk = f"10.0.0.{number}", SimDisk()
            world = self.net.world(f"node:{node_id_of(address)}", address, disk)
            async with open_store(world, FOLDER, node_id_of(address)) as store:
                node = Node(number, address, disk, Member(node_id_of(address), store.identity.incarnation))
            node.gone.set()
            self.nodes[number] = self.by_id[node.id] = node
        self.first = Book(Participants(tuple(participant(node.member) for node in self.nodes.values())))
        self.watch = Watch(self.first, {node.address: node.member for node in self.nodes.values()})
        for node in self.nodes.values():
            self.net.observe(node.address, Point.AFTER_COMMIT, partial(self.watch.committed, node.address, node.disk))

    # -------------------------------------------------------------------------------------------------------- lives

    def up(self) -> list[Node]:
        return [node for node in self.nodes.values() if node.log is not None]

    def down(self) -> list[Node]:
        return [node for node in self.nodes.values() if not node.is_wanted and node.gone.is_set()]

    def start(self, node: Node) -> None:
        """Let it run; it must be gone."""
        assert node.gone.is_set() and not node.is_wanted
        node.is_wanted, node.gone = True, trio.Event()
        self._nursery.start_soon(self._live, node)

    def crash(self, node: Node, *, silent: bool = False) -> None:
        """Now; what its tasks still do reaches nobody."""
        if not node.is_wanted:
            return
        node.is_wanted, node.log = False, None
        self.net.crash(node.address, silent=silent)
        if node.scope is not None:
            node.scope.cancel()

    def crash_at(self, node: Node, point: Point, count: int) -> None:
        """When it passes this point for the so manieth time from now."""
        self.net.trap(node.address, point, count, partial(self.crash, node))

    async def _live(self, node: Node) -> None:
        ends: list[BaseException] = []
        try:
            with trio.CancelScope() as node.scope:
                try:
                    await self._one_life(node)
                except* Exception as group:  # noqa: BLE001  whatever a node dies of is told, and judged
                    ends = list(leaves(group))
        finally:
            node.log = None
            node.gone.set()
        if node.is_wanted:
            # A node whose disk takes nothing at all cannot count its start; it comes back later.
            node.is_wanted = False
            self.net.crash(node.address)
            if not ends or not all(isinstance(end, LocalFault) for end in ends):
                self.ends.append(f"node {node.number} ended by itself: {ends}")

    async def _one_life(self, node: Node) -> None:
        world = self.net.world(f"node:{node.id}", node.address, node.disk)
        async with open_store(world, FOLDER, node.id) as store, trio.open_nursery() as life:
            socket = await world.network.open_datagrams(node.address, Priority.HIGH)
            log = await self._open(node, world, store, _Wire(self, node, socket))
            self.watch.restarted(node.address, node.disk)
            await life.start(log.run)
            if node.is_wanted:
                node.log = log
            await self._hear(log, socket)

    async def _open(self, node: Node, world: object, store: Store, wire: _Wire) -> Log:
        setting = Setting(GENESIS, node.member, key_of(node.member), at_once_bytes=self.at_once_bytes)
        return await open_log(world, store, setting, self.first, wire, wire, self.owner)  # type: ignore[arg-type]

    async def _hear(self, log: Log, socket: Datagrams) -> None:
        while True:
            data, _ = await socket.receive()
            sender, message = pickle.loads(data)
            log.receive(sender, message)

    # ------------------------------------------------------------------------------------------------------ packets

    def reaches(self, source: Node, target: Node) -> bool:
        return not self.net.paths.is_cut(source.address, target.address)

    def note(self, target: str, sender: NodeId, data: bytes) -> tuple[str, bytes] | None:
        """Keep a packet; perhaps one of before is to come again."""
        self._old = [*self._old[-REPLAYED_MAX:], (sender, target, data)]
        if self.dice.random() >= self.replayed:
            return None
        _, to, old = self.dice.choice(self._old)
        return to, old


class _Wire:
    """Ports `Carrier` and `Surroundings` of one node."""

    def __init__(self, town: Town, node: Node, socket: Datagrams) -> None:
        self._town, self._node, self._socket = town, node, socket

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        for one in (message, *more):
            await self._send(target, one)

    async def _send(self, target: NodeId, message: Message) -> None:
        there = self._town.by_id[target]
        if not there.is_wanted and self._town.net.machine(there.address).is_up:
            await trio.lowlevel.checkpoint()
            raise Unreachable("nobody listens there", where=there.address)
        if self._node.is_wanted:
            self._town.watch.sent(self._node.address, self._node.disk, message)
        data = pickle.dumps((self._node.id, message))
        await self._socket.send(data, there.address)
        again = self._town.note(there.address, self._node.id, data)
        if again is not None:
            await self._socket.send(again[1], again[0])

    def line(self) -> tuple[NodeId, ...]:
        return tuple(node.id for node in self._town.nodes.values())

    def reachable(self) -> frozenset[NodeId]:
        seen = (other for other in self._others() if other.is_wanted or not self._town.sees_cracks)
        return frozenset(other.id for other in seen) | self._town.replaced

    def alive(self) -> frozenset[NodeId]:
        return frozenset(other.id for other in self._others() if other.log is not None) | self._town.replaced

    def is_gone(self, member: Member) -> bool:
        return member.node in self._town.replaced

    def _others(self) -> list[Node]:
        town, me = self._town, self._node
        return [other for other in town.nodes.values() if other is not me and (town.reaches(me, other) or not town.sees_cracks)]


async def until(holds: Callable[[], bool], within_s: float = 60.0, *, look_s: float = 0.05) -> bool:
    """Whether something came to hold in time. Its looks cost no real time."""
    with trio.move_on_after(within_s):
        while not holds():  # noqa: ASYNC110 - what it waits for is on disks, which tell nobody
            await trio.sleep(look_s)
        return True
    return holds()


def request_maker(request: str, node: Node) -> Callable[[object], object]:
    """Makes the value that this request is at whatever position."""

    def make(judge: object) -> object:
        assert isinstance(judge, Book)
        return judge.value(request, node.id)

    return make


__all__ = ["Node", "Town", "request_maker", "until"]
