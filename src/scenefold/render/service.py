"""The render service as an extension of a node: the pool's `RenderService` on a `NodeContext`."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import TypeVar

import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client import Scene
from scenefold.client.reading import open_scene_with_keys
from scenefold.peer import NodeContext
from scenefold.peer.handlers import Senders
from scenefold.render.pool.service import RenderService as PoolService
from scenefold.render.pool.share import SceneReader
from scenefold.wire import Fault, Packet
from scenefold.world import Priority, World

SEND_S_MAX = 60.0
P = TypeVar("P", bound=Packet)


class RenderService:
    """What `node/` starts in the node's nursery."""

    def __init__(self, renderer: str = "embree") -> None:
        self._renderer = renderer

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve renders until cancelled."""
        await PoolService(NodeHost(context), self._renderer).run(task_status=task_status)


class NodeHost:
    """A running node, as the pool's `Host`."""

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        self._name = f"node:{int(context.me)}"

    @property
    def world(self) -> World:
        """The node's."""
        return self._context.world

    @property
    def node_id(self) -> NodeId:
        """The node's."""
        return self._context.me

    @property
    def render_threads(self) -> int:
        """The node's setting."""
        return self._context.settings.render_threads

    def nodes(self) -> list[NodeId]:
        """All members in the order of the line."""
        return list(self._context.routing.members)

    def handle(self, packet: type[P], handler: Callable[[P, str], Awaitable[Packet | None]], *, nodes_only: bool) -> None:
        """See `Host`."""
        self._context.handlers.add(packet, handler, senders=Senders.NODES if nodes_only else Senders.ANY)

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        """See `Host`. A node asks itself without a network."""
        if node == self.node_id:
            with trio.move_on_after(timeout_s):
                answer = await self._context.handlers.handle(packet, self._name)
                return _checked(node, packet, answer)
            raise Refused(RejectReason.BUSY, f"{type(packet).__name__} took longer than {timeout_s:g} s", where=address_of(node))
        answer = await self._context.peers.ask(node, Priority.LOW, packet, Packet, timeout_s)
        return _checked(node, packet, answer)

    async def send(self, node: NodeId, packet: Packet) -> None:
        """See `Host`."""
        await self._context.peers.tell(node, Priority.LOW, packet, SEND_S_MAX)

    async def reader(self, scene: SceneId, genesis: bytes, symmetric_key: bytes, key_epoch: int) -> SceneReader:
        """See `Host`."""
        known = await self._context.scenes.known(scene)
        if known.public.genesis != genesis:
            raise LocalFault("another scene has this id", where=f"scene {scene:08x}", remedy="see that the profile belongs to this cluster")
        members = [(member, address_of(member)) for member in self.nodes()]
        opened = open_scene_with_keys(self.world, self._context.links, members, known.public, symmetric_key, key_epoch=key_epoch)
        return _SceneReader(opened)

    def record_count(self) -> int:
        """Records in this node's store."""
        return self._context.store.record_count


class _SceneReader:
    """An opened scene, as the pool's `SceneReader`."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        """See `SceneReader`."""
        return await self._scene.space(space).get_many(locations)


def _checked(node: NodeId, packet: Packet, answer: Packet | None) -> Packet:
    if isinstance(answer, Fault):
        raise Refused(answer.reason, answer.text, where=address_of(node))
    if answer is None:
        raise Refused(RejectReason.ILL_FORMED, f"nobody answers a {type(packet).__name__}", where=address_of(node))
    return answer
