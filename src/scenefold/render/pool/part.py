"""A node's part in a job from the offer to the end: prepare, trace one attempt after the other, let go."""

from __future__ import annotations

import logging
from collections.abc import Collection
from enum import Enum
from functools import partial
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.plain_values import whole
from scenefold.base.reasons import RejectReason
from scenefold.render.contract import Renderer, check_layers_written
from scenefold.render.job import Job
from scenefold.render.pool.cell import Cell
from scenefold.render.pool.films import Films
from scenefold.render.pool.gathering import Gathering
from scenefold.render.pool.hit_sample import HitSample, kept_in
from scenefold.render.pool.hold import Hold
from scenefold.render.pool.host import Host
from scenefold.render.pool.image_memory import image_needs
from scenefold.render.pool.lasting import Lasting, MemberStatistics
from scenefold.render.pool.levels import Gathered
from scenefold.render.pool.member import Member
from scenefold.render.pool.moving import Moving
from scenefold.render.pool.own_passes import owners_of
from scenefold.render.pool.pass_bits import bits_of, passes_of
from scenefold.render.pool.previewing import Previewing
from scenefold.render.pool.promises import Account
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.share import FILM_LANE, LANE
from scenefold.render.pool.telling import error_of, failure_fields, failure_of, told
from scenefold.wire import AcknowledgeRays, CollectPass, FetchPreview, ImagePart, JobAnswer, Packet, PassSums, SendRays, Value
from scenefold.world import DiskFailed, QuietLog

_log = logging.getLogger("scenefold.render.pool")


class Phase(Enum):
    """Where a node's part stands."""

    PREPARING = "preparing"
    READY = "ready"
    RUNNING = "running"
    HELD = "held"
    """An attempt is over, and the next one has not begun."""
    FAILED = "failed"


class Part:
    """One node's part in one job. It needs the scene's keys while it prepares, and keeps none."""

    def __init__(self, host: Host, renderer: Renderer, job: Job, organiser: NodeId, quiet: QuietLog, account: Account) -> None:
        """`account`: of the memory that it takes, which it closes at its end."""
        if host.node_id not in job.nodes:
            raise PeerFault("this node is not among the job's")
        self.job = job
        self.me = job.nodes.index(host.node_id)
        self.phase = Phase.PREPARING
        self.failure: Refused | None = None
        self._host, self._renderer, self._quiet = host, renderer, quiet
        self._processor_before_s = host.used().processor_s
        self._roster = Roster.first(job, organiser)
        self._account = account
        self._moving = Moving(host, renderer, job, self.me, account)
        self._member: Member | None = None
        self._lasting = Lasting(Films(job), MemberStatistics(), HitSample(kept_in(job), job.seed + self.me))
        self._turn, self._films_turn = trio.Lock(), trio.Lock()
        self.gathering = Gathering(host, job, self._lasting.films, self._films_turn)
        self.previewing = Previewing(host, job, self._lasting.films, self._films_turn, account)
        self._sent_before: dict[str, int] = {}
        """On links of older attempts."""
        self._scope = trio.CancelScope()
        self._tracing = trio.CancelScope()
        self._rested, self._begun = trio.Event(), trio.Event()
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
        try:
            with self._scope:
                try:
                    await self._prepare()
                    await self._go.wait()
                    self.phase = Phase.RUNNING
                    async with trio.open_nursery() as nursery:
                        nursery.start_soon(self._moving.run)
                        while True:
                            await self._trace()
                except* DiskFailed:
                    raise
                except* Exception as group:  # noqa: BLE001  a bug over one job is no end of a node
                    self.phase, self.failure = Phase.FAILED, failure_of(group, self.job.id, self._quiet, self._host.world.clock.now())
        finally:
            # Also if the node ends: whoever organises a job here waits for its own part then.
            self._prepared.set()
            self._member = None
            self._rested.set()
            with trio.CancelScope(shield=True):
                await self._moving.end()
            self._account.close()
            self._ended.set()

    async def _trace(self) -> None:
        """One attempt, until another one begins."""
        member = self._member
        if member is not None:
            with self._tracing:
                await member.run()
        self._rested.set()
        await self._begun.wait()

    async def prepared(self) -> None:
        """Wait until the node holds its share; Refused if it cannot."""
        await self._prepared.wait()
        if self.failure is not None:
            raise told(self.failure)
        if not self._was_ready:
            raise Refused(
                RejectReason.NOT_READY, "this node's part of the job ended while it was prepared", remedy="start the render again"
            )

    @property
    def has_failed(self) -> bool:
        return self.failure is not None

    @property
    def is_idle(self) -> bool:
        """Its organiser says nothing: maybe it is no more."""
        return self.hold.is_quiet

    def forget(self) -> None:
        """End; what failed has freed everything, and no task waits. See `end`."""
        if not self.has_failed:
            _log.warning("job %016x: its organiser is silent, and another job needs the place; this node's part ends", self.job.id)
        self._scope.cancel()

    @property
    def was_ready(self) -> bool:
        """Whether it held its share at some time."""
        return self._was_ready

    async def go(self, first: object, occupied: object) -> None:
        """All nodes are ready: trace, the passes below `first` being closed already. `occupied`: where they hold something, if that is known.

        PeerFault if that is no pass, or no such thing.
        """
        if occupied is not None:
            await self._moving.see(occupied)
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
        if self.phase is not Phase.HELD:
            self.member()
        await self._moving.fetch(partition, is_anew=self.phase is Phase.HELD)

    def claim(self, epoch: object) -> None:
        """Answer for the cell that was fetched, from now on."""
        self._moving.claim(epoch, self.member())

    async def stay(self, epoch: object) -> None:
        """What was fetched will not be claimed."""
        await self._moving.forget(epoch)

    # Attempts (specs/31-attempts.md) -------------------------------------------------------------------------

    @property
    def films(self) -> Films:
        """Of this node."""
        return self._lasting.films

    def place_of(self, node: NodeId) -> int:
        """In this attempt; Refused (16) if the node takes no part in it."""
        place = self._roster.place(node)
        if place is None:
            raise Refused(RejectReason.NOT_READY, "the node takes no part in this attempt", where=address_of(node))
        return place

    async def pause(self, document: dict[str, Any], organiser: NodeId) -> None:
        """Trace no more, and make all that is closed one film, before another attempt. PeerFault if that is none, Refused if it is an old one."""
        roster = Roster.from_document(document, self.job, organiser, self._host.node_id)
        gathered = _count_of(document.get("gathered"))
        async with self._turn:
            if roster.attempt <= self._roster.attempt or self.phase not in (Phase.RUNNING, Phase.HELD):
                raise Refused(RejectReason.NOT_READY, "that attempt cannot begin here", where=f"attempt {roster.attempt}")
            # From here on packets of older attempts are late.
            self._roster = roster
            self.previewing.forget()
            member, self._member = self._member, None
            if member is not None:
                self._begun, self.phase = trio.Event(), Phase.HELD
                self._tracing.cancel()
                self._sent_before = self._sent(member)
            await self._rested.wait()
            await self._host.world.workers.run(FILM_LANE, owners_of, self.job.plan, len(roster.nodes))
            async with self._films_turn:
                self.films.forget_gathered(gathered)
                await self._host.world.workers.run(FILM_LANE, self.films.adopt, roster.nodes)
            self._moving.take_place(self.place_of(self._host.node_id), len(roster.nodes))
        if self.failure is not None:
            raise told(self.failure)

    def begin(self, document: dict[str, Any]) -> None:
        """Trace all but the passes that are done. PeerFault if the node was not told of that attempt, or has passes that are not done."""
        attempt = _count_of(document.get("begin"))
        if self.phase is not Phase.HELD or attempt != self._roster.attempt:
            raise PeerFault("no such attempt was told of", where=f"attempt {attempt}")
        done = passes_of(document.get("done"), self.job.plan.count)
        if not self.films.own.passes <= done:
            raise PeerFault("an attempt begins without passes that are done")
        cell = self._moving.take(document.get("epoch"))
        assert self._moving.held is not None
        self._gathered = Gathered(self.job.window.pixels, self.job.plan.levels)
        self._tracing, self._rested = trio.CancelScope(), trio.Event()
        self._member = self._made(cell, self._moving.held.loaded.numbers.stride, done)
        self.phase = Phase.RUNNING
        self._begun.set()

    async def forget_gathered(self, number: object) -> None:
        """All films are the organiser's now."""
        async with self._films_turn:
            self.films.forget_gathered(_count_of(number))

    def _made(self, cell: Cell, stride: int, done: Collection[int]) -> Member:
        roster, world = self._roster, self._host.world
        place = self.place_of(self._host.node_id)
        member = Member(
            self.job, roster, place, stride, cell, self._lasting, done, world, partial(self._ask, roster), partial(self._send, roster)
        )
        member.on_newer = partial(self._moving.claim_if_fetched, member=member)
        return member

    def _in_attempt(self, node: NodeId, attempt: int) -> tuple[Member, int]:
        """What takes a packet of this attempt, and the place of the node that sent it. Refused (16) if it is of another one."""
        if attempt != self._roster.attempt or self.phase is Phase.HELD:
            self._lasting.statistics.late += attempt < self._roster.attempt
            raise Refused(RejectReason.NOT_READY, "the packet is of another attempt", where=f"attempt {attempt}")
        return self.member(), self.place_of(node)

    def on_rays(self, node: NodeId, packet: SendRays) -> None:
        """See `Member`; so the next three. Refused (16) if it is of another attempt."""
        member, place = self._in_attempt(node, packet.attempt)
        member.on_rays(place, packet)

    def on_acknowledged(self, node: NodeId, packet: AcknowledgeRays) -> None:
        """Refused (16) if it is of another attempt."""
        member, place = self._in_attempt(node, packet.attempt)
        member.on_acknowledged(place, packet)

    async def on_collect(self, node: NodeId, packet: CollectPass) -> PassSums:
        """Refused (16) if it is of another attempt."""
        member, place = self._in_attempt(node, packet.attempt)
        return await member.on_collect(place, packet)

    async def on_copy(self, node: NodeId, packet: PassSums) -> None:
        """A closed pass of another node. Refused (16) if it is of another attempt: also if one begins while it waits."""
        async with self._films_turn:
            member, place = self._in_attempt(node, packet.attempt)
            await member.on_copy(place, packet)

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
        used = self._host.used()
        document |= {"processor_seconds": used.processor_s - self._processor_before_s, "memory_most": used.memory_most}
        if self._moving.held is not None:
            loaded = self._moving.held.loaded
            document |= {
                "groups": len(loaded.share.groups),
                "triangles": loaded.share.instanced_triangles,
                "bytes_read": self._moving.bytes_read,
                "digest": self._digest,
                "prepare_seconds": self._prepare_seconds,
            }
            if self._moving.emptiness.told and self.phase is Phase.READY:
                document["occupied"] = self._moving.emptiness.told
        member = self._member
        if member is not None or self.phase is Phase.HELD:
            statistics = self._lasting.statistics
            document |= {
                "attempt": self._roster.attempt,
                "closed": 0 if member is None else member.closed,
                "opened": 0 if member is None else member.opened,
                "owned": 0 if member is None else member.owned,
                "waiting": 0 if member is None else member.waiting,
                "rays": statistics.rays,
                "casts": statistics.casts,
                "shadow_casts": statistics.shadow_casts,
                "rays_sent": statistics.rays_sent,
                **(self._sent_before if member is None else self._sent(member)),
                "rays_received": statistics.rays_received,
                "busy_seconds": statistics.busy_seconds,
                "epoch": 0 if member is None else member.cell.epoch,
                "late": statistics.late,
                "away": [] if member is None else [[int(self._roster.nodes[place]), words] for place, words in member.away.items()],
                "not_finite": statistics.counters[1],
                "clamped": statistics.counters[2],
            }
            if self.job.moves:
                document["hits"] = self._lasting.hits.to_bytes()
            if self.phase is Phase.HELD:
                document["film"] = bits_of(self.films.own.passes, self.job.plan.count)
        return document

    async def hand_film_on(self, number: int, towards: NodeId) -> None:
        """Gather the films of the nodes behind this one, and send the sum with ours towards the organiser, who asked for it by a neighbour."""
        await self.gathering.hand_on(number, self._roster, self.place_of(towards))

    async def gather(self, number: int, passes: Collection[int]) -> None:
        """At the organiser: everybody's film into ours; `passes`: of theirs."""
        await self.gathering.gather(number, self._roster, passes)

    async def preview(self, packet: FetchPreview, towards: NodeId | None, closed: int = 0) -> ImagePart:
        """Of what is closed at this node and all behind it; of all, for the user (None), with so many passes closed. Refused (16) if that cannot be."""
        self.member()
        if towards is None:
            return await self.previewing.of_all(packet.number, packet.offset, self._roster, closed)
        return await self.previewing.of_those_behind(packet.number, packet.offset, self._roster, towards)

    async def _prepare(self) -> None:
        host, job = self._host, self.job
        begun = trio.current_time()
        await host.compiled()
        mine = await host.world.workers.run(LANE, self._renderer.numeric_class)
        if mine != job.numeric_class:
            raise Refused(
                RejectReason.NOT_READY,
                f"this node renders in another numeric class than the job, {mine:.80}",
                remedy="start the render again without this node, or have the same versions, and processors of one maker, on all nodes",
            )
        check_layers_written(self._renderer, job.layers)
        self._promise_image()
        held = await self._moving.open()
        self._digest = held.loaded.digest
        await host.world.workers.run(FILM_LANE, owners_of, job.plan, len(job.nodes))
        self._member = self._made(held.cell, held.loaded.numbers.stride, ())
        self._prepare_seconds = trio.current_time() - begun
        self.phase, self._was_ready = Phase.READY, True
        self._prepared.set()

    def _promise_image(self) -> None:
        """LocalFault or Refused if the image is more than this node has memory for; found out later, it would end the node."""
        job = self.job
        needs = image_needs(job.window.pixels, job.layers, len(job.nodes), is_adaptive=job.adaptive is not None)
        remedy = "render it smaller, with fewer nodes on one machine"
        self._account.take("image", needs, f"an image of {job.window.width}x{job.window.height}", remedy)

    async def _ask(self, roster: Roster, place: int, packet: Packet, timeout_s: float) -> Packet:
        answer = await self._host.ask(roster.nodes[place], packet, timeout_s)
        if isinstance(answer, JobAnswer) and answer.reason:
            raise error_of(answer.reason, answer.text, where=address_of(roster.nodes[place]))
        return answer

    async def _send(self, roster: Roster, place: int, packet: Packet) -> None:
        await self._host.send(roster.nodes[place], packet)

    def _sent(self, member: Member) -> dict[str, int]:
        """On links, in all attempts."""
        return {name: self._sent_before.get(name, 0) + count for name, count in member.link_counts.items()}


def _count_of(value: object) -> int:
    try:
        return whole(value, 0, 2**63 - 1)
    except ValueError as error:
        raise PeerFault("a count is expected", where=f"{value!r:.40}") from error
