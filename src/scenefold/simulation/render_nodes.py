"""Render services of simulated nodes: those of real ones, with the arithmetic renderer, and an ear for each packet that they are given."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Any, TypeVar

import trio

from scenefold.base.ids import NodeId, SceneId
from scenefold.node.rendering import RenderExtension
from scenefold.render.pool.host import Host
from scenefold.render.pool.service import RenderService
from scenefold.render.pool.share import SceneReader
from scenefold.render.rehearsal.arithmetic import ArithmeticRenderer
from scenefold.render.sealed_keys import SealedKeys
from scenefold.scene.head import SceneHead
from scenefold.scene.log import EpochKeys
from scenefold.simulation.cluster import Cluster, RenderTrap
from scenefold.wire import Packet
from scenefold.world import World
from scenefold.world.process_use import ProcessUse

P = TypeVar("P", bound=Packet)


class RenderNodes:
    """Of one run."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._services: dict[int, tuple[trio.CancelScope | None, RenderService]] = {}
        """By slot, and with the scope of the life in which their node was asked."""
        self._traps: list[RenderTrap] = []
        self.extension = RenderExtension(self._service)
        cluster.set_render_trap = self._traps.append

    @property
    def services(self) -> dict[int, RenderService]:
        """Those of nodes that run, and were asked for a render in this life."""
        alive = {slot: node.scope for slot, node in self._cluster.running.items()}
        return {slot: service for slot, (life, service) in sorted(self._services.items()) if slot in alive and alive[slot] is life}

    def _service(self, host: Host) -> RenderService:
        slot = self._cluster.slot_of(host.node_id)
        service = RenderService(_Heard(host, lambda: self._sprung(slot)), ArithmeticRenderer())
        self._services[slot] = self._cluster.nodes[slot].scope, service
        return service

    def _sprung(self, slot: int) -> RenderTrap | None:
        """A packet of a render has come to a node: the trap that goes off with it."""
        due = [trap for trap in self._traps if trap.slot == slot]
        for trap in due:
            trap.count -= 1
            if trap.count <= 0:
                self._traps.remove(trap)
                return trap
        return None


@dataclass(frozen=True, slots=True)
class _Heard:
    """A node as its render service sees it. `sprung`: asked with each packet whether the node dies of it."""

    host: Host
    sprung: Callable[[], RenderTrap | None]

    @property
    def world(self) -> World:
        return self.host.world

    @property
    def node_id(self) -> NodeId:
        return self.host.node_id

    @property
    def render_threads(self) -> int:
        return self.host.render_threads

    @property
    def memory_bytes(self) -> int:
        return self.host.memory_bytes

    def nodes(self) -> list[NodeId]:
        return self.host.nodes()

    def handle(self, packet: type[P], handler: Callable[[P, str], Awaitable[Packet | None]], *, nodes_only: bool) -> None:
        async def heard(packet: Any, peer: str) -> Packet | None:
            trap = self.sprung()
            if trap is not None and not trap.is_late:
                trap.spring()
            answer = await handler(packet, peer)
            if trap is not None and trap.is_late:
                trap.spring()
            return answer

        self.host.handle(packet, heard, nodes_only=nodes_only)

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        return await self.host.ask(node, packet, timeout_s)

    async def send(self, node: NodeId, packet: Packet) -> None:
        await self.host.send(node, packet)

    def opened(self, keys: SealedKeys, genesis: bytes, job: int) -> EpochKeys:
        return self.host.opened(keys, genesis, job)

    def reader(self, scene: SceneId, genesis: bytes, keys: EpochKeys, head: SceneHead) -> AbstractAsyncContextManager[SceneReader]:
        return self.host.reader(scene, genesis, keys, head)

    async def compiled(self) -> None:
        # What is rehearsed has no kernels.
        await trio.lowlevel.checkpoint()

    def record_count(self) -> int:
        return self.host.record_count()

    def used(self) -> ProcessUse:
        # One process runs all nodes; and what it has used is not the same in two runs of a seed.
        return ProcessUse(0.0, 0)
