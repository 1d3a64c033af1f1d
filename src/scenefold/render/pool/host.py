"""What the render service needs of the node that it runs on; `node/` provides it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from typing import Protocol, TypeVar

from scenefold.base.ids import NodeId, SceneId
from scenefold.render.pool.share import SceneReader
from scenefold.render.sealed_keys import SealedKeys
from scenefold.scene.head import SceneHead
from scenefold.scene.log import EpochKeys
from scenefold.wire import Packet
from scenefold.world import World
from scenefold.world.process_use import ProcessUse

P = TypeVar("P", bound=Packet)


class Host(Protocol):
    """A node, as the render service sees it."""

    @property
    def world(self) -> World: ...

    @property
    def node_id(self) -> NodeId: ...

    @property
    def render_threads(self) -> int:
        """How many tracers a job may use here."""
        ...

    @property
    def memory_bytes(self) -> int:
        """Memory that the node may use."""
        ...

    def nodes(self) -> list[NodeId]:
        """All nodes of the cluster, in the order of the line."""
        ...

    def handle(self, packet: type[P], handler: Callable[[P, str], Awaitable[Packet | None]], *, nodes_only: bool) -> None:
        """Let `handler(packet, peer name)` answer packets of this class."""
        ...

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        """Send a request to a node and return its answer. Unreachable; Refused for a Fault."""
        ...

    async def send(self, node: NodeId, packet: Packet) -> None:
        """Send a packet that has no answer. Unreachable."""
        ...

    def opened(self, keys: SealedKeys, genesis: bytes, job: int) -> EpochKeys:
        """The scene's keys that came with a job. Refused (12) if they are sealed to others; DamagedData or PeerFault if they do not open."""
        ...

    def reader(self, scene: SceneId, genesis: bytes, keys: EpochKeys, head: SceneHead) -> AbstractAsyncContextManager[SceneReader]:
        """A reader of a scene's records with the keys that came with a job, for as long as it is needed.

        Refused (9) where the node would have to hold a lease of its own for that, and holds none.
        """
        ...

    async def compiled(self) -> None:
        """Return once kernels are compiled, as far as that can be done before they are needed: it takes minutes, once for a version."""
        ...

    def record_count(self) -> int:
        """Records that this node stores, of all scenes."""
        ...

    def used(self) -> ProcessUse:
        """What the node's process has used of its computer so far."""
        ...
