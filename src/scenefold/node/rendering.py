"""The renderer as an extension of a node: what render/ needs of its host, made from what the node has.

A node reads the scene that it renders through its own data service: what lies here comes from the store without
leaving the process, the rest from its owners. It opens records with the keys that came with the job, sealed to this node, which
are kept in memory only.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.sealing import Opened, SceneIdentity, open_all, payload_of
from scenefold.client.trying import patiently
from scenefold.client.verifying import Key, NewerThanKnown, writers_of
from scenefold.client.wholes import wholes
from scenefold.peer import NodeContext, Senders
from scenefold.peer.peers import priority_of
from scenefold.render.compiling import compile_apart
from scenefold.render.sealed_keys import About, SealedKeys, open_keys
from scenefold.scene.head import SceneHead, check_head, check_unedited
from scenefold.scene.log import EpochKeys
from scenefold.wire import (
    AcknowledgeRays,
    CancelJob,
    CollectPass,
    FetchFilm,
    FetchImage,
    FetchPreview,
    FilmPart,
    JobEvent,
    JobState,
    MergeFilm,
    Packet,
    PassSums,
    RecordBytes,
    RecordKey,
    SceneMode,
    SendRays,
    StartJob,
)
from scenefold.world import Priority, World
from scenefold.world.process_use import ProcessUse, process_use

if TYPE_CHECKING:
    from scenefold.render.pool.host import Host
    from scenefold.render.pool.service import RenderService

P = TypeVar("P", bound=Packet)

SEND_S_MAX = 30.0
READ_BATCH = 256
"""Records read and opened at a time: 15 MiB at most."""
READS_AT_A_TIME = 3
"""Batches under way: one is fetched while another is opened."""


_log = logging.getLogger("scenefold.node.rendering")

AHEAD = (JobState, JobEvent, CancelJob, AcknowledgeRays)
"""Small ones go by the port of high priority: on a slow line they would wait for many seconds behind rays and sums, and a node whose answer comes too late
is taken for lost."""
ASKED_BY_ANYBODY: tuple[type[Packet], ...] = (StartJob, JobState, FetchImage, CancelJob, FetchFilm, FilmPart, FetchPreview)
ASKED_BY_NODES: tuple[type[Packet], ...] = (JobEvent, SendRays, AcknowledgeRays, CollectPass, PassSums, MergeFilm)


class RenderExtension:
    """Starts the render service in a node when it is asked for something: to import it takes as long as all else, and many nodes only store."""

    def __init__(self, service: Callable[[Host], RenderService] | None = None) -> None:
        """`service`: makes it; None: with the renderer that comes with a node."""
        self._service = service

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None]) -> None:
        """Answer for it until cancelled."""
        async with trio.open_nursery() as nursery:
            late = _LateService(context, nursery, self._service)
            for packets, senders in ((ASKED_BY_ANYBODY, Senders.ANY), (ASKED_BY_NODES, Senders.NODES)):
                for packet in packets:
                    context.handlers.add(packet, late.answer, senders=senders)
            task_status.started()
            await trio.sleep_forever()


class _LateService:
    """The service, once there is one."""

    def __init__(self, context: NodeContext, nursery: trio.Nursery, service: Callable[[Host], RenderService] | None) -> None:
        self._context, self._nursery, self._service = context, nursery, service
        self._host = RenderHost(context)
        self._beginning = trio.Lock()

    async def answer(self, packet: Packet, peer: str) -> Packet | None:
        async with self._beginning:
            if not self._host.handlers:
                service = self._service
                if service is None:
                    imported = await self._context.world.workers.run("render", _imported)
                    service = imported
                await trio.lowlevel.checkpoint_if_cancelled()
                # Whoever asked may go away meanwhile: what has begun to answer goes on.
                with trio.CancelScope(shield=True):
                    await self._nursery.start(service(self._host).run)
        # Whoever asked may have gone away: what it wanted begins no more.
        await trio.lowlevel.checkpoint_if_cancelled()
        return await self._host.handlers[type(packet)](packet, peer)


def _imported() -> type[RenderService]:
    from scenefold.render.pool.service import RenderService

    return RenderService


def _priority_of(packet: Packet) -> Priority:
    return Priority.HIGH if isinstance(packet, AHEAD) else priority_of(packet)


class RenderHost:
    """A node, as the render service sees it (render/pool/host.py)."""

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        self.handlers: dict[type[Packet], Callable[[Any, str], Awaitable[Packet | None]]] = {}
        """What the service answers, and with what."""
        self._compiling, self._has_compiled = trio.Lock(), False

    @property
    def world(self) -> World:
        return self._context.world

    @property
    def node_id(self) -> NodeId:
        return self._context.me

    @property
    def render_threads(self) -> int:
        return self._context.settings.render_threads

    @property
    def memory_bytes(self) -> int:
        return self._context.settings.memory_budget_bytes

    def nodes(self) -> list[NodeId]:
        return list(self._context.cluster_log.registry.members)

    def handle(self, packet: type[P], handler: Callable[[P, str], Awaitable[Packet | None]], *, nodes_only: bool) -> None:
        assert packet in (ASKED_BY_NODES if nodes_only else ASKED_BY_ANYBODY), f"{packet.__name__} is answered by nobody here"
        self.handlers[packet] = handler

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        return await self._context.peers.ask(node, _priority_of(packet), packet, Packet, timeout_s)

    async def send(self, node: NodeId, packet: Packet) -> None:
        await self._context.peers.tell(node, _priority_of(packet), packet, SEND_S_MAX)

    async def compiled(self) -> None:
        async with self._compiling:
            if self._has_compiled:
                return
            _log.info("kernels are compiled, if they were not yet: that takes minutes, once for a version")
            try:
                await compile_apart()
            except LocalFault as fault:
                _log.warning("kernels are compiled as they are needed: %s", fault)
            self._has_compiled = True

    def opened(self, keys: SealedKeys, genesis: bytes, job: int) -> EpochKeys:
        about = About(self._context.facts.cluster_id, genesis, job)
        return open_keys(keys, self.node_id, self._context.own.secrets.sealing, about)

    @asynccontextmanager
    async def reader(self, scene: SceneId, genesis: bytes, keys: EpochKeys, head: SceneHead) -> AsyncIterator[NodeReader]:
        # What a client holds for all nodes of a job does for those that are no observers (specs/26-modes.md, Renders).
        use = self._context.participation.own_use(scene) if head.floor else None
        async with nullcontext() if use is None else use.hold(SceneMode.RENDER):
            yield NodeReader(self._context, scene, genesis, keys, head)

    def record_count(self) -> int:
        return self._context.store.record_count

    def used(self) -> ProcessUse:
        return process_use()


@dataclass(frozen=True, slots=True)
class NodeReader:
    """Reads and opens a scene's records, wherever they lie."""

    context: NodeContext
    scene: SceneId
    genesis: bytes
    keys: EpochKeys
    head: SceneHead

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        """The payloads at these locations, in order; None where nothing lies. DamagedData if one does not verify."""
        identity = await self._identity()
        payloads: list[bytes | None] = [None] * len(locations)
        slots = trio.CapacityLimiter(READS_AT_A_TIME)

        async def read(start: int) -> None:
            async with slots:
                keys: list[Key] = [(space, location) for location in locations[start : start + READ_BATCH]]
                read_more = partial(self._read, identity)
                found = await wholes(await read_more(keys), keys, read_more, partial(self.context.world.workers.run, "crypto"))
                payloads[start : start + len(keys)] = [payload_of(one) for one in found]

        async with trio.open_nursery() as nursery:
            for start in range(0, len(locations), READ_BATCH):
                nursery.start_soon(read, start)
        return payloads

    async def _read(self, identity: SceneIdentity, keys: Sequence[Key]) -> list[Opened | None]:
        """The records as they lie there, read a batch at a time."""
        found: list[Opened | None] = []
        for start in range(0, len(keys), READ_BATCH):
            batch = [RecordKey(key[0], key[1]) for key in keys[start : start + READ_BATCH]]
            # A place may be changing hands, or its owner without a lease, for some seconds: that ends no render.
            records = await patiently(self.context.world, partial(self.context.data.read, self.scene, batch, identity.position))
            found += await self._opened(identity, batch, records)
        return found

    async def _opened(
        self, identity: SceneIdentity, keys: Sequence[RecordKey], records: Sequence[RecordBytes | None]
    ) -> list[Opened | None]:
        while True:
            try:
                opened = await self.context.world.workers.run("crypto", _open, identity, keys, records)
                check_unedited(self.head, (one.version[0] for one in opened if one is not None), f"scene {self.scene:08x}")
                return opened
            except NewerThanKnown as unknown:
                # A record may be younger than the header that is known here, and the next one of the batch younger still.
                before, identity = identity, await self._identity(unknown.epoch)
                if identity.position > before.position:
                    continue
                if unknown.key_epoch is None:
                    raise
                what = "the scene's key was changed while the render was reading it"
                raise Refused(RejectReason.KEY_REVOKED, what, where=unknown.where, remedy="start the render again") from unknown

    async def _identity(self, position: int = 0) -> SceneIdentity:
        known = await self.context.scenes.known(self.scene, position=max(position, self.head.position))
        check_head(known.public, self.genesis, self.head)
        return SceneIdentity(
            scene=self.scene,
            genesis=self.genesis,
            position=known.public.position,
            writers=writers_of(known.public),
            keys=self.keys,
        )


def _open(identity: SceneIdentity, keys: Sequence[RecordKey], records: Sequence[RecordBytes | None]) -> list[Opened | None]:
    return open_all(identity, [(key.space, key.location) for key in keys], records)
