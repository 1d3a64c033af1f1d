"""Data services in a simulated world, with a line, a lease and neighbours that a test sets as it likes."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of, node_id_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, PLACED_BY_NODE, signed_place
from scenefold.peer.records.data import DataService
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Store, open_store
from scenefold.wire import Fault, Packet, PutItem, SceneLogPublic
from scenefold.world import World
from scenefold.world.sim import SimDisk, SimNet, run_simulated
from unit.peer.scenes_made import first_header, offered, sealed

SCENE = first_header()
USER = "user:ada"
MIDDLE = 1 << 159


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


LEFT, RIGHT = arc(0, MIDDLE - 1), arc(MIDDLE, (1 << 160) - 1)


class SetLine:
    """What a node owns, and what of it is frozen. `change` is durable, like a release or a claim."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._changed = trio.Condition()
        self.arc: Arc | None = None
        self.frozen: Arc | None = None
        self.inside = 0
        self._left = trio.Event()

    def owns(self, location: Location) -> bool:
        return self.arc is not None and location in self.arc

    async def change(self, new: Arc | None) -> None:
        await self._store.put_holding(new, b"")
        self.arc = new

    async def freeze(self, piece: Arc | None) -> None:
        async with self._changed:
            self.frozen = piece
            self._changed.notify_all()

    @asynccontextmanager
    async def writing(self, locations: Sequence[Location], *, anywhere: bool = False) -> AsyncIterator[None]:
        async with self._changed:
            while self.frozen is not None and (anywhere or any(location in self.frozen for location in locations)):
                await self._changed.wait()
        self.inside += 1
        try:
            yield
        finally:
            self.inside -= 1
            self._left.set()

    async def drained(self) -> None:
        """Return once nobody is inside."""
        while self.inside:
            self._left = trio.Event()
            await self._left.wait()


@dataclass
class SetLease:
    held: bool = True
    lost_after: int | None = None
    """It is held so many times that somebody asks, and then no more."""

    def holds(self) -> bool:
        if self.lost_after is not None:
            self.lost_after -= 1
            self.held = self.lost_after >= 0
        return self.held


@dataclass
class Node:
    """One node's data service. `ask` gives what it answers to a peer."""

    me: NodeId
    world: World
    store: Store
    line: SetLine
    lease: SetLease
    data: DataService
    disk: SimDisk
    handlers: dict[type[Packet], Callable[[Any, str], Awaitable[Packet]]] = field(default_factory=dict)

    def add(self, packet: type[Packet], handler: Any, **_: Any) -> None:
        self.handlers[packet] = handler

    async def ask(self, packet: Packet, peer: str = USER) -> Packet:
        try:
            return await self.handlers[type(packet)](packet, peer)
        except Refused as refusal:
            return Fault(refusal.reason, str(refusal))


class Neighbours:
    """All nodes as each of them sees the others: `Peers`, `Scenes` and routing in one."""

    def __init__(self, net: SimNet) -> None:
        self.net = net
        self.nodes: dict[NodeId, Node] = {}
        self.away: set[NodeId] = set()
        self.nonsense: set[NodeId] = set()
        """They answer with packets that are no answers."""
        self.believed: dict[NodeId, NodeId] = {}
        """Owners that some node wrongly believes in, whatever the place."""
        self.also_believed: list[NodeId] = []
        """Who may have any place as well, as everybody believes."""
        self.looked_for: list[tuple[SceneId, int, str]] = []
        """Scenes, or later headers of them, that others would be asked for, each with the position and on whose behalf."""
        self.meanwhile: Callable[[], object] = lambda: None
        """What happens while they are."""
        self.headers: dict[NodeId, SceneLogPublic] = {}
        """Of the scene, at nodes that have not the first one."""
        self.newest = SCENE
        """What anybody finds who asks the others."""
        self.unknown_is = RejectReason.UNKNOWN_SCENE_OR_SPACE

    def seen_by(self, me: NodeId) -> Any:
        return _Seen(self, me)


class _Seen:
    def __init__(self, neighbours: Neighbours, me: NodeId) -> None:
        self._all = neighbours
        self._me = me

    def owner_of(self, location: Location) -> NodeId:
        if self._me in self._all.believed:
            return self._all.believed[self._me]
        return next((node.me for node in self._all.nodes.values() if node.line.owns(location)), self._me)

    def candidates(self, location: Location) -> list[NodeId]:
        return [self.owner_of(location), *self._all.also_believed]

    async def ask(self, member: NodeId, _priority: object, packet: Packet, _answer: object, _timeout: float) -> Packet:
        await trio.lowlevel.checkpoint()
        if member in self._all.away:
            raise Unreachable("nobody there", where=address_of(member))
        if member in self._all.nonsense:
            raise PeerFault("this is no answer", where=address_of(member))
        reply = await self._all.nodes[member].ask(packet, f"node:{self._me}")
        if isinstance(reply, Fault):
            raise Refused(RejectReason(reply.reason), reply.text)
        return reply

    async def known(self, scene: SceneId, *, position: int = 0, ask: bool = True, asker: str = "") -> KnownScene:
        if ask and (scene != SCENE.scene or position > self._header.position):
            await trio.lowlevel.checkpoint()
            self._all.looked_for.append((scene, position, asker))
            self._all.meanwhile()
            if self._all.newest.position > self._header.position:
                self._all.headers[self._me] = self._all.newest
        if scene != SCENE.scene:
            raise Refused(self._all.unknown_is, "unknown")
        return KnownScene.of(self._header)

    @property
    def _header(self) -> SceneLogPublic:
        return self._all.headers.get(self._me, SCENE)

    def here(self, scene: SceneId) -> KnownScene | None:
        return KnownScene.of(self._header) if scene == SCENE.scene else None


def with_nodes(test: Callable[..., Awaitable[None]], *arcs: Arc | None, seed: int = 1) -> None:
    """Run `test(neighbours, *nodes)` in a simulated world with a node for each arc."""

    async def main() -> None:
        net = SimNet(seed)
        neighbours = Neighbours(net)
        async with _nodes(net, neighbours, list(arcs)) as nodes:
            await test(neighbours, *nodes)

    run_simulated(seed, main, virtual_s_max=3600)


@asynccontextmanager
async def _nodes(net: SimNet, neighbours: Neighbours, arcs: list[Arc | None]) -> AsyncIterator[list[Node]]:
    if not arcs:
        yield list(neighbours.nodes.values())
        return
    address = f"10.0.0.{len(neighbours.nodes) + 1}"
    me = node_id_of(address)
    world = net.world(f"node:{me}", address)
    async with open_store(world, Path("data"), me) as store:
        line, lease, seen = SetLine(store), SetLease(), neighbours.seen_by(me)
        await line.change(arcs[0])
        data = DataService(world, store, seen, seen, line, lease, seen, me)
        node = neighbours.nodes[me] = Node(me, world, store, line, lease, data, net.machine(address).disk)
        data.register(node)  # type: ignore[arg-type]
        async with _nodes(net, neighbours, arcs[1:]) as nodes:
            yield nodes


def item(number: int, *, seq: int = 1, payload: bytes = b"payload", expects: bytes = EXPECTS_ANYTHING) -> PutItem:
    return offered(sealed(SCENE, payload=payload, location=Location.from_number(number), seq=seq, expects=expects))


def managed_item(object_id: bytes, *, seq: int = 1, at: Location | None = None, expects: bytes = EXPECTS_ANYTHING) -> PutItem:
    place = signed_place(object_id)
    record = sealed(SCENE, payload=b"%d" % seq, location=place, seq=seq, placement=PLACED_BY_NODE, expects=expects)
    return offered(record, **({} if at is None else {"location": at}))
