"""Render services of several nodes in one process, without sockets or stores: packets are encoded, decoded and handed over.

For tests, and for measurements of what does not depend on a network. What is traced is traced by the real renderer.
"""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId, address_of
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SealingKey
from scenefold.render.arrays import F32
from scenefold.render.in_memory import RecordsInMemory
from scenefold.render.job import RenderOptions
from scenefold.render.pool.mover import Pace
from scenefold.render.pool.request import Keep, RenderRequest, organiser_of
from scenefold.render.pool.service import RenderService
from scenefold.render.pool.unattended import Unattended
from scenefold.render.sealed_keys import About, SealedKeys, open_keys, seal_keys
from scenefold.scene.head import SceneHead
from scenefold.scene.log import EpochKeys
from scenefold.wire import (
    CancelJob,
    FetchImage,
    ImagePart,
    JobAnswer,
    JobState,
    JobStateReply,
    Packet,
    StartJob,
    decode_packet,
    encode_packet,
    unpack_value,
)
from scenefold.world import World
from scenefold.world.process_use import ProcessUse

Records = Mapping[tuple[SpaceId, Location], bytes]
P = TypeVar("P", bound="MemoryPool")
USER = "user:test"
CLUSTER, GENESIS = bytes(16), bytes(32)
SCENE_KEY = b"the key of the scene, 24"


def records_of(path: Path) -> Records:
    """All records that the import of a file makes."""
    return RecordsInMemory(path).records


class MemoryReader:
    """Reads a scene from memory."""

    def __init__(self, records: Records) -> None:
        self._records = records

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        await trio.lowlevel.checkpoint()
        return [self._records.get((space, location)) for location in locations]


class MemoryHost:
    """A node of a `MemoryPool`."""

    render_threads = 1
    memory_bytes = 1 << 30

    def __init__(self, pool: MemoryPool, node_id: NodeId) -> None:
        self._pool = pool
        self.node_id = node_id
        self.world = pool.world
        self.handlers: dict[type[Packet], tuple[Callable[[Any, str], Awaitable[Packet | None]], bool]] = {}
        self.away = False
        """Nobody reaches it; it reaches everybody."""
        self.life = trio.CancelScope()
        self.visits: set[trio.CancelScope] = set()
        """Handlers under way: they run in the tasks of whoever asked, and end with the process all the same."""
        self.sealing = SealingKey.generate()
        self.keys: list[EpochKeys] = []
        """That it could open."""
        self.service = RenderService(self, pace=pool.pace)

    def nodes(self) -> list[NodeId]:
        return self._pool.nodes

    def handle(self, packet: type[Any], handler: Callable[[Any, str], Awaitable[Packet | None]], *, nodes_only: bool) -> None:
        self.handlers[packet] = (handler, nodes_only)

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        with trio.move_on_after(timeout_s):
            answer = await self._pool.deliver(f"node:{self.node_id}", node, packet)
            assert answer is not None
            return answer
        raise Unreachable(f"the node did not answer within {timeout_s:g} s", where=address_of(node))

    async def send(self, node: NodeId, packet: Packet) -> None:
        await self._pool.carry(f"node:{self.node_id}", node, packet)

    def opened(self, keys: SealedKeys, genesis: bytes, job: int) -> EpochKeys:
        self.keys.append(open_keys(keys, self.node_id, self.sealing, About(CLUSTER, genesis, job)))
        return self.keys[-1]

    @asynccontextmanager
    async def reader(self, scene: SceneId, genesis: bytes, keys: EpochKeys, head: SceneHead) -> AsyncIterator[MemoryReader]:
        yield MemoryReader(self._pool.records)

    async def compiled(self) -> None:
        # Whoever rehearses has them compiled before.
        await trio.lowlevel.checkpoint()

    def record_count(self) -> int:
        return len(self._pool.records)

    def used(self) -> ProcessUse:
        # They are all one process, of which no node has used this or that.
        return ProcessUse(0.0, 0)

    async def run(self, *, task_status: trio.TaskStatus[None]) -> None:
        """Serve until it dies."""
        with self.life:
            await self.service.run(task_status=task_status)


class MemoryPool:
    """Nodes 127.0.0.2 and up; `ask` speaks to them as a user."""

    pace = Pace(look_s=0.01)
    """Of cells: rehearsals are short."""

    def __init__(self, world: World, records: Records, count: int) -> None:
        self.world, self.records = world, records
        self.nodes = [NodeId(0x7F000002 + index) for index in range(count)]
        self.hosts = {node: MemoryHost(self, node) for node in self.nodes}
        self.delivered: dict[NodeId, list[bytes]] = {node: [] for node in self.nodes}
        """What each node was told, by whomever."""
        self.nursery: trio.Nursery
        self.complaints: list[ScenefoldError] = []
        """Of packets without an answer."""

    async def deliver(self, peer: str, node: NodeId, packet: Packet) -> Packet | None:
        await trio.lowlevel.checkpoint()
        host = self.hosts[node]
        if host.away:
            raise Unreachable("the node does not answer", where=address_of(node))
        handler, nodes_only = host.handlers[type(packet)]
        if nodes_only and not peer.startswith("node:"):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} may not send this")
        self.delivered[node].append(encode_packet(packet))
        with trio.CancelScope() as visit:
            host.visits.add(visit)
            try:
                answer = await handler(decode_packet(encode_packet(packet)), peer)
            finally:
                host.visits.remove(visit)
            return None if answer is None else decode_packet(encode_packet(answer))
        raise Unreachable("the connection broke", where=address_of(node))

    async def carry(self, peer: str, node: NodeId, packet: Packet) -> None:
        """Deliver what has no answer: who sent it does not hear what becomes of it."""
        try:
            await self.deliver(peer, node, packet)
        except (Refused, PeerFault) as error:
            self.complaints.append(error)

    def kill(self, node: NodeId) -> None:
        """Its process dies."""
        host = self.hosts[node]
        host.away = True
        host.life.cancel()
        for visit in host.visits:
            visit.cancel()

    async def restart(self, node: NodeId) -> None:
        """A new process at the address of one that died."""
        host = MemoryHost(self, node)
        host.sealing = self.hosts[node].sealing
        await self.nursery.start(host.run)
        self.hosts[node] = host

    async def ask(self, node: NodeId, packet: Packet) -> Any:
        return await self.deliver(USER, node, packet)

    def request(
        self, job: int, options: RenderOptions, chosen: Sequence[NodeId], keep: Keep | None = None, unattended: Unattended | None = None
    ) -> StartJob:
        """What a client says that has chosen these nodes."""
        recipients = {node: self.hosts[node].sealing.public for node in chosen}
        keys = seal_keys(EpochKeys.only(SCENE_KEY), recipients, About(CLUSTER, GENESIS, job), self.world.entropy.token)
        return StartJob(
            job=job, document=RenderRequest(job, SceneId(1), GENESIS, keys, options, keep=keep, unattended=unattended).to_bytes()
        )

    async def start(
        self,
        job: int,
        options: RenderOptions,
        chosen: Sequence[NodeId] | None = None,
        keep: Keep | None = None,
        unattended: Unattended | None = None,
    ) -> NodeId:
        """Ask the organiser for a render on these nodes (all); its id."""
        nodes = self.nodes if chosen is None else chosen
        owner = organiser_of(job, nodes)
        answer = await self.ask(owner, self.request(job, options, nodes, keep, unattended))
        assert isinstance(answer, JobAnswer)
        if answer.reason:
            raise Refused(RejectReason(answer.reason), answer.text)
        return owner

    async def state(self, job: int, owner: NodeId) -> dict[str, Any]:
        reply = await self.ask(owner, JobState(job=job))
        assert isinstance(reply, JobStateReply)
        state = unpack_value(reply.document, what="state")
        assert isinstance(state, dict)
        return state

    async def until(self, job: int, owner: NodeId, *phases: str) -> dict[str, Any]:
        """Wait until the job is in one of these phases."""
        with trio.fail_after(100):
            while True:
                state = await self.state(job, owner)
                if state["phase"] in phases:
                    return state
                await self.world.clock.sleep(0.02)

    async def render(self, job: int, options: RenderOptions, chosen: Sequence[NodeId] | None = None) -> tuple[bytes, dict[str, Any]]:
        """The image's bytes and the final state."""
        return await self.finished(job, await self.start(job, options, chosen))

    async def finished(self, job: int, owner: NodeId) -> tuple[bytes, dict[str, Any]]:
        """Wait for a job; its image's bytes and the final state."""
        state = await self.until(job, owner, "done", "failed")
        assert state["phase"] == "done", state["failure"]
        image = b""
        while len(image) < state["image_bytes"]:
            part = await self.ask(owner, FetchImage(job=job, offset=len(image)))
            assert isinstance(part, ImagePart)
            image += part.payload
        await self.ask(owner, CancelJob(job=job))
        return image, state


@asynccontextmanager
async def running(pool: P) -> AsyncIterator[P]:
    """With its services, which end with the block."""
    async with trio.open_nursery() as nursery:
        pool.nursery = nursery
        for host in pool.hosts.values():
            await nursery.start(host.run)
        yield pool
        nursery.cancel_scope.cancel()


@asynccontextmanager
async def memory_pool(world: World, records: Records, count: int) -> AsyncIterator[MemoryPool]:
    """A pool whose services run inside the block."""
    async with running(MemoryPool(world, records, count)) as pool:
        yield pool


def sha256_of(layer: F32 | bytes) -> str:
    """Hex digest of a layer's bytes."""
    return hashlib.sha256(layer if isinstance(layer, bytes) else layer.tobytes()).hexdigest()
