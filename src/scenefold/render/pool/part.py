"""A node's part in a job from the offer to the end: prepare, run, hand the film on, let go."""

from __future__ import annotations

from enum import Enum
from functools import partial
from typing import Any

import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.ids import address_of
from scenefold.base.plain_values import whole
from scenefold.base.reasons import RejectReason
from scenefold.render.contract import Renderer, check_layers_written
from scenefold.render.film_rows import row_bytes
from scenefold.render.job import Job
from scenefold.render.layers import image_bytes
from scenefold.render.pool.hold import Hold
from scenefold.render.pool.host import Host
from scenefold.render.pool.levels import Gathered
from scenefold.render.pool.member import Member
from scenefold.render.pool.moving import Moving
from scenefold.render.pool.share import FILM_LANE
from scenefold.render.pool.telling import error_of, failure_fields, failure_of, told
from scenefold.wire import FilmPart, JobAnswer, MergeFilm, Packet, Value
from scenefold.world import DiskFailed, QuietLog

MERGE_S_MAX = 600.0
PART_S_MAX = 120.0
IMAGE_COPIES = 3
"""Of the image, in memory at the end: its layers, each of them as bytes, and all of these together."""


class Phase(Enum):
    """Where a node's part stands."""

    PREPARING = "preparing"
    READY = "ready"
    RUNNING = "running"
    FAILED = "failed"


class Part:
    """One node's part in one job. It needs the scene's keys while it prepares, and keeps none."""

    def __init__(self, host: Host, renderer: Renderer, job: Job, quiet: QuietLog) -> None:
        if host.node_id not in job.nodes:
            raise PeerFault("this node is not among the job's")
        self.job = job
        self.me = job.nodes.index(host.node_id)
        self.phase = Phase.PREPARING
        self.failure: Refused | None = None
        self._host, self._renderer, self._quiet = host, renderer, quiet
        self._moving = Moving(host, renderer, job, self.me)
        self._member: Member | None = None
        self._scope = trio.CancelScope()
        self._go = trio.Event()
        self._prepared = trio.Event()
        self._ended = trio.Event()
        self._prepare_seconds = 0.0
        self._was_ready = False
        self._digest = b""
        self._gathered = Gathered(job.window.pixels, job.plan.levels)
        self.hold = Hold()

    async def run(self) -> None:
        """Prepare, wait for the word, trace until `end`. Failures are kept in `failure`, for whoever asks."""
        with self._scope:
            try:
                await self._prepare()
                await self._go.wait()
                self.phase = Phase.RUNNING
                assert self._member is not None
                async with trio.open_nursery() as nursery:
                    nursery.start_soon(self._moving.run)
                    await self._member.run()
            except* DiskFailed:
                raise
            except* Exception as group:  # noqa: BLE001  a bug over one job is no end of a node
                self.phase, self.failure = Phase.FAILED, failure_of(group, self.job.id, self._quiet, self._host.world.clock.now())
        self._prepared.set()
        self._member = None
        with trio.CancelScope(shield=True):
            await self._moving.end()
        self._ended.set()

    async def prepared(self) -> None:
        """Wait until the node holds its share; Refused if it cannot."""
        await self._prepared.wait()
        if self.failure is not None:
            raise told(self.failure)

    @property
    def has_failed(self) -> bool:
        return self.failure is not None

    @property
    def is_idle(self) -> bool:
        """Never: what an organiser leaves alone ends by its hold."""
        return False

    def forget(self) -> None:
        """Nothing to end: what failed has freed everything, and no task waits."""

    @property
    def was_ready(self) -> bool:
        """Whether it held its share at some time."""
        return self._was_ready

    def go(self, first: object) -> None:
        """All nodes are ready: trace, the passes below `first` being closed already. PeerFault if that is no pass."""
        self.member().skip(self._number(first))
        self.hold.go()
        self._go.set()

    def on_level(self, document: dict[str, Any]) -> None:
        """Which pixels go on to the next level, or a piece of it. PeerFault if it does not follow on what came before."""
        member, goes_on = self.member(), self._gathered.take(document)
        if goes_on is not None:
            member.go_on_with(goes_on)

    def release(self, until: object) -> None:
        """Passes below this number may be opened. PeerFault if it is none."""
        self.member().release(self._number(until))

    async def fetch(self, partition: object) -> None:
        """Make ready to answer for another cell."""
        self.member()
        await self._moving.fetch(partition)

    def claim(self, epoch: object) -> None:
        """Answer for the cell that was fetched, from now on."""
        self._moving.claim(epoch, self.member())

    async def stay(self, epoch: object) -> None:
        """What was fetched will not be claimed."""
        await self._moving.forget(epoch)

    def _number(self, value: object) -> int:
        try:
            return whole(value, 0, self.job.plan.count)
        except ValueError as error:
            raise PeerFault("the job has no such pass", where=f"pass {value!r:.40}") from error

    async def end(self) -> None:
        """Stop, and free everything."""
        self._scope.cancel()
        await self._ended.wait()

    def member(self) -> Member:
        """The running part; Refused if it is not ready, or failed."""
        if self._member is None:
            if self.failure is not None:
                raise told(self.failure)
            raise Refused(RejectReason.NOT_READY, "this node's part of the job is not ready")
        return self._member

    def state(self) -> dict[str, Value]:
        """How it stands, for the organiser."""
        document: dict[str, Value] = {"phase": self.phase.value, "records": self._host.record_count(), **failure_fields(self.failure)}
        if self._moving.held is not None:
            loaded = self._moving.held.loaded
            document |= {
                "groups": len(loaded.share.groups),
                "triangles": loaded.share.instanced_triangles,
                "bytes_read": self._moving.bytes_read,
                "digest": self._digest,
                "prepare_seconds": self._prepare_seconds,
            }
        if self._member is not None:
            statistics = self._member.statistics
            document |= {
                "closed": self._member.closed,
                "owned": self._member.owned,
                "rays": statistics.rays,
                "casts": statistics.casts,
                "shadow_casts": statistics.shadow_casts,
                "rays_sent": statistics.rays_sent,
                **self._member.link_counts,
                "rays_received": statistics.rays_received,
                "busy_seconds": statistics.busy_seconds,
                "epoch": self._member.cell.partition.epoch,
                "not_finite": statistics.counters[1],
                "clamped": statistics.counters[2],
            }
            if self.job.moves:
                document["hits"] = self._member.hits.to_bytes()
        return document

    async def hand_film_on(self, towards: int) -> None:
        """Merge the film of the nodes behind this one, then send the sum to its neighbour in the line.

        Films are merged on their way along the line (thesis B.4.2), so that no node receives more than two.
        """
        member = self.member()
        behind = 2 * self.me - towards
        if 0 <= behind < len(self.job.nodes):
            await self.collect_film(behind)
        parts = list(member.film.parts())
        for index, payload in enumerate(parts):
            packet = FilmPart(job=self.job.id, part_index=index, part_count=len(parts), payload=payload)
            await self._ask(towards, packet, PART_S_MAX)
        # Of a level: what is added from now on is of the next one.
        member.film.clear()

    async def collect_film(self, neighbour: int) -> None:
        """Ask a neighbour for its film and everything behind it; returns when it is merged into ours."""
        await self._ask(neighbour, MergeFilm(job=self.job.id), MERGE_S_MAX)

    async def merge(self, packet: FilmPart) -> None:
        """A part of a neighbour's film."""
        await self._host.world.workers.run(FILM_LANE, self.member().film.merge_part, packet.part_index, packet.payload)

    async def _prepare(self) -> None:
        host, job = self._host, self.job
        begun = host.world.clock.now()
        mine = self._renderer.numeric_class()
        if mine != job.numeric_class:
            raise LocalFault(
                f"this node renders in the numeric class {mine}, the job in {job.numeric_class}",
                remedy="install the same versions on all nodes",
            )
        check_layers_written(self._renderer, job.layers)
        self._check_memory()
        held = await self._moving.open()
        self._digest = held.loaded.digest
        self._member = member = Member(job, self.me, held.loaded.numbers.stride, held.cell, host.world, self._ask, self._send)
        member.on_newer = partial(self._moving.claim_if_fetched, member=member)
        self._prepare_seconds = host.world.clock.now() - begun
        self.phase, self._was_ready = Phase.READY, True
        self._prepared.set()

    def _check_memory(self) -> None:
        """LocalFault if the image alone is more than this node may hold; found out later, it would end the node."""
        job, may = self.job, self._host.memory_bytes
        pixels = job.window.pixels
        needs = pixels * (row_bytes(job.columns) + (job.adaptive is not None)) + IMAGE_COPIES * image_bytes(job.layers, pixels)
        if needs > may:
            raise LocalFault(
                f"an image of {job.window.width}x{job.window.height} takes {needs >> 20} MiB of each node's memory; this one may use {may >> 20} MiB",
                remedy="render it smaller, with fewer nodes on one machine, or give the nodes more memory",
            )

    async def _ask(self, index: int, packet: Packet, timeout_s: float) -> Packet:
        answer = await self._host.ask(self.job.nodes[index], packet, timeout_s)
        if isinstance(answer, JobAnswer) and answer.reason:
            raise error_of(answer.reason, answer.text, where=address_of(self.job.nodes[index]))
        return answer

    async def _send(self, index: int, packet: Packet) -> None:
        await self._host.send(self.job.nodes[index], packet)
