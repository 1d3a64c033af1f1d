"""The render service of a node: answers packets 48 to 51, 53 to 60, 126, 23 and 46, and owns the tasks of all jobs here."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, TypeVarTuple

import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import node_named
from scenefold.render.contract import Renderer, load_renderer
from scenefold.render.job import Job
from scenefold.render.layers import image_bytes
from scenefold.render.pool.budgets import budget_document
from scenefold.render.pool.hold import LOOK_S
from scenefold.render.pool.host import Host
from scenefold.render.pool.mover import USUAL_PACE, Pace
from scenefold.render.pool.organiser import Organiser
from scenefold.render.pool.part import Part
from scenefold.render.pool.places import Places
from scenefold.render.pool.promises import Promises
from scenefold.render.pool.request import RenderRequest
from scenefold.render.pool.telling import reason_of, words_of
from scenefold.render.pool.unattended import ALL_JOBS
from scenefold.wire import (
    AcknowledgeRays,
    CancelJob,
    CollectPass,
    FetchFilm,
    FetchImage,
    FetchPreview,
    FilmPart,
    ImagePart,
    JobAnswer,
    JobEvent,
    JobState,
    JobStateReply,
    MergeFilm,
    PassSums,
    SendRays,
    StartJob,
    Value,
    pack_value,
    unpack_value,
)
from scenefold.world import QuietLog

JOBS_MAX = 8
"""Jobs that a node takes part in at a time."""
JOBS_OF_A_NODE_MAX = 6
"""Of one that organises them; and so no node organises more, since they would fail at the others."""
JOBS_OF_A_USER_MAX = 4
PINNED_SHARE = 4
"""Images of unattended renders take so many-th of a node's memory together."""
ENDED_MAX = 64
"""Of jobs that users ended so many are known: a client that waits for one hears of it, and does not begin it anew."""
IMAGE_PART_BYTES = 4 * 1024 * 1024
OK = 0

_log = logging.getLogger("scenefold.render.pool")
_Arguments = TypeVarTuple("_Arguments")


class RenderService:
    """All jobs on one node."""

    def __init__(self, host: Host, renderer: str | Renderer = "embree", pace: Pace = USUAL_PACE) -> None:
        """`renderer`: the name of an installed one, which is loaded when it is needed, or one that is here. `pace`: of cells in jobs that this node organises."""
        self._host, self._pace = host, pace
        self._renderer_name = renderer if isinstance(renderer, str) else ""
        self._renderer: Renderer | None = None if isinstance(renderer, str) else renderer
        self._parts: Places[Part] = Places("takes part in", JOBS_MAX, JOBS_OF_A_NODE_MAX)
        self._organisers: Places[Organiser] = Places("organises", JOBS_OF_A_NODE_MAX, JOBS_OF_A_USER_MAX)
        self.promises = Promises(host.memory_bytes, self._make_room)
        self._ended: deque[tuple[int, str]] = deque(maxlen=ENDED_MAX)
        self._quiet = QuietLog(_log)
        self._nursery: trio.Nursery | None = None

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Serve until cancelled."""
        host = self._host
        host.handle(StartJob, self._on_start, nodes_only=False)
        host.handle(JobState, self._on_state, nodes_only=False)
        host.handle(FetchImage, self._on_fetch, nodes_only=False)
        host.handle(CancelJob, self._on_cancel, nodes_only=False)
        host.handle(JobEvent, self._on_event, nodes_only=True)
        host.handle(SendRays, self._on_rays, nodes_only=True)
        host.handle(AcknowledgeRays, self._on_acknowledged, nodes_only=True)
        host.handle(CollectPass, self._on_collect, nodes_only=True)
        host.handle(PassSums, self._on_copy, nodes_only=True)
        host.handle(MergeFilm, self._on_merge, nodes_only=True)
        host.handle(FilmPart, self._on_film, nodes_only=False)
        host.handle(FetchFilm, self._on_fetch_film, nodes_only=False)
        host.handle(FetchPreview, self._on_preview, nodes_only=False)
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            task_status.started()
            try:
                await self._sweep()
            finally:
                self._nursery = None

    async def _sweep(self) -> None:
        """End parts whose organiser asks no more: it died, or was cut off, and nobody wants their rays; and jobs whose client does not."""
        while True:
            await self._host.world.clock.sleep(LOOK_S)
            for job, part in self._parts.jobs():
                why = part.hold.over()
                if why:
                    if not part.has_failed:
                        _log.warning("job %016x: its organiser %s; this node's part ends", job, why)
                    self._parts.drop(job, part)
                    await part.end()
            for job, organiser in self._organisers.jobs():
                if organiser.is_forsaken:
                    _log.warning("job %016x: nobody has asked for it for long; it is given up", job)
                    organiser.cancel()

    # Users ---------------------------------------------------------------------------------------------------

    async def _on_start(self, packet: StartJob, peer: str) -> JobAnswer:
        try:
            if peer.startswith("user:"):
                self._organise(packet, peer)
            else:
                await self._take_part(packet, peer)
        except ScenefoldError as error:
            return JobAnswer(job=packet.job, reason=int(reason_of(error)), text=words_of(error))
        return JobAnswer(job=packet.job, reason=OK, text="")

    def _organise(self, packet: StartJob, peer: str) -> None:
        document = unpack_value(packet.document, what="a request to render")
        if not isinstance(document, dict) or document.get("request") is not True:
            raise PeerFault("a request to render is ill-formed")
        if self._organisers.get(packet.job) is not None:
            self._organiser(packet.job, peer)
            return
        self._organisers.check(peer)
        request = RenderRequest.from_map(packet.job, document)
        if request.unattended is not None:
            self._check_pinned(image_bytes(request.options.layers, request.options.window.pixels))
        keys = self._host.opened(request.keys, request.genesis, request.job)
        renderer = self._load()
        account = self.promises.account
        organiser = self._organisers.take(
            packet.job, peer, lambda: Organiser(self._host, renderer, request, keys, self._part, self._quiet, account(), self._pace)
        )
        self._start(self._keep_organiser, packet.job, organiser)

    def _check_pinned(self, more: int) -> None:
        """Refused (13) if images that nobody fetches would take more memory than they may. The first one always may: a part checks it."""
        held = sum(organiser.pins_bytes for _, organiser in self._organisers.jobs())
        if held and held + more > self._host.memory_bytes // PINNED_SHARE:
            what = f"this node keeps {held >> 20} MiB of images that nobody has fetched, and may keep {self._host.memory_bytes // PINNED_SHARE >> 20}"
            raise Refused(RejectReason.BUSY, what, remedy="fetch or cancel some: scenectl render list")

    async def _keep_organiser(self, job: int, organiser: Organiser) -> None:
        try:
            await organiser.run()
        finally:
            organiser.account.close()
            self._organisers.drop(job, organiser)

    def _make_room(self) -> bool:
        """Let the oldest image go that nobody fetches."""
        idle = next(((job, one) for job, one in self._organisers.jobs() if one.is_idle), None)
        if idle is not None:
            self._organisers.drop(*idle)
            idle[1].forget()
            idle[1].account.close()
        return idle is not None

    async def _on_state(self, packet: JobState, peer: str) -> JobStateReply:
        state: dict[str, Value]
        if peer.startswith("user:") and packet.job == ALL_JOBS:
            mine = [(job, one) for job, one in self._organisers.jobs() if self._organisers.asker(job) == peer and not one.ends]
            state = {"jobs": [{"job": job, **one.row()} for job, one in mine]}
            state["numeric_class"] = self._class_of_renderer()
        elif peer.startswith("user:"):
            part = self._parts.get(packet.job)
            state = {**self._organiser(packet.job, peer).state(), "preview": 0 if part is None else part.previewing.newest}
        elif packet.job == ALL_JOBS:
            idle = sum(one.account.held for _, one in self._organisers.jobs() if one.is_idle)
            state = budget_document(self.promises.most - self.promises.held + idle)
        else:
            part, _ = self._part_with(packet.job, peer)
            if self._parts.asker(packet.job) == peer:
                part.hold.heard()
            state = part.state()
        return JobStateReply(job=packet.job, document=pack_value(state))

    async def _on_fetch(self, packet: FetchImage, peer: str) -> ImagePart:
        image = self._organiser(packet.job, peer).image
        if not image:
            raise Refused(RejectReason.NOT_READY, "the image is not finished")
        payload = image[packet.offset : packet.offset + IMAGE_PART_BYTES]
        return ImagePart(job=packet.job, total_bytes=len(image), offset=packet.offset, payload=payload)

    async def _on_fetch_film(self, packet: FetchFilm, peer: str) -> ImagePart:
        film = self._organiser(packet.job, peer).kept_film(packet.passes)
        payload = film[packet.offset : packet.offset + IMAGE_PART_BYTES]
        return ImagePart(job=packet.job, total_bytes=len(film), offset=min(packet.offset, len(film)), payload=payload)

    async def _on_preview(self, packet: FetchPreview, peer: str) -> ImagePart:
        if peer.startswith("user:"):
            closed = self._organiser(packet.job, peer).closed
            return await self._part(packet.job).preview(packet, None, closed)
        part, node = self._part_with(packet.job, peer)
        return await part.preview(packet, node)

    async def _on_cancel(self, packet: CancelJob, peer: str) -> JobAnswer:
        if peer.startswith("user:"):
            self._organiser(packet.job, peer).cancel()
            self._ended.append((packet.job, peer))
        else:
            part = self._parts.get(packet.job)
            if part is not None:
                self._check_organiser(packet.job, peer)
                self._parts.drop(packet.job, part)
                await part.end()
        return JobAnswer(job=packet.job, reason=OK, text="")

    # Nodes ---------------------------------------------------------------------------------------------------

    async def _take_part(self, packet: StartJob, peer: str) -> None:
        job = Job.from_bytes(packet.document)
        if job.id != packet.job:
            raise PeerFault("a job's document is another job's")
        organiser = node_of(job, peer)
        part = self._parts.get(job.id)
        if part is None:
            self._parts.check(peer)
            renderer = self._load()
            account = self.promises.account
            part = self._parts.take(job.id, peer, lambda: Part(self._host, renderer, job, organiser, self._quiet, account()))
            self._start(self._keep_part, part)
        elif part.job != job:
            raise PeerFault("there is another job of that id")
        await part.prepared()

    async def _keep_part(self, part: Part) -> None:
        await part.run()
        if not part.was_ready:
            # Who has asked for it hears why, and there is nothing else to keep.
            self._parts.drop(part.job.id, part)

    async def _on_event(self, packet: JobEvent, peer: str) -> JobAnswer:
        part, node = self._part_with(packet.job, peer)
        document = unpack_value(packet.document, what="a job's event")
        if isinstance(document, dict):
            self._check_organiser(packet.job, peer)
            try:
                await _obey(part, node, document)
            except ScenefoldError as error:
                if "fetch" not in document:
                    raise
                return JobAnswer(job=packet.job, reason=int(reason_of(error)), text=words_of(error))
        return JobAnswer(job=packet.job, reason=OK, text="")

    async def _on_rays(self, packet: SendRays, peer: str) -> None:
        part, node = self._part_with(packet.job, peer)
        part.on_rays(node, packet)

    async def _on_acknowledged(self, packet: AcknowledgeRays, peer: str) -> None:
        part, node = self._part_with(packet.job, peer)
        part.on_acknowledged(node, packet)

    async def _on_collect(self, packet: CollectPass, peer: str) -> PassSums:
        part, node = self._part_with(packet.job, peer)
        return await part.on_collect(node, packet)

    async def _on_copy(self, packet: PassSums, peer: str) -> JobAnswer:
        part, node = self._part_with(packet.job, peer)
        await part.on_copy(node, packet)
        return JobAnswer(job=packet.job, reason=OK, text="")

    async def _on_merge(self, packet: MergeFilm, peer: str) -> JobAnswer:
        part, node = self._part_with(packet.job, peer)
        await part.hand_film_on(packet.gathering, node)
        return JobAnswer(job=packet.job, reason=OK, text="")

    async def _on_film(self, packet: FilmPart, peer: str) -> JobAnswer:
        if peer.startswith("user:"):
            self._organiser(packet.job, peer).take_film(packet.part_index, packet.payload)
        else:
            part, node = self._part_with(packet.job, peer)
            part.place_of(node)
            await part.gathering.merge(node, packet)
        return JobAnswer(job=packet.job, reason=OK, text="")

    # Looking up ----------------------------------------------------------------------------------------------

    def _load(self) -> Renderer:
        if self._renderer is None:
            self._renderer = load_renderer(self._renderer_name)
        return self._renderer

    def _class_of_renderer(self) -> str:
        """Empty if none is loaded, for whoever only asks makes no node load all that renders; and if it can render nothing here."""
        try:
            return "" if self._renderer is None else self._renderer.numeric_class()
        except LocalFault:
            # Whoever gives it a job hears why. This one asks about others.
            return ""

    def _part(self, job: int) -> Part:
        part = self._parts.get(job)
        if part is None:
            raise Refused(RejectReason.NOT_READY, "this node takes no part in that job")
        return part

    def _part_with(self, job: int, peer: str) -> tuple[Part, NodeId]:
        """This node's part in a job that the peer is of, too: nobody else is told anything of it. And which node that is."""
        part = self._part(job)
        return part, node_of(part.job, peer)

    def _check_organiser(self, job: int, peer: str) -> None:
        """Refused (12) if another node offered the job: only that one says when it begins, and ends."""
        if self._parts.asker(job) != peer:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} does not organise the job")

    def _organiser(self, job: int, peer: str) -> Organiser:
        """What organises the job of this user: nobody else is told anything of it."""
        organiser = self._organisers.get(job)
        if organiser is None and (job, peer) in self._ended:
            raise Refused(RejectReason.OUTSIDE_BOUNDS, "its user has ended that render", remedy="start it again, if it is wanted after all")
        if organiser is None or self._organisers.asker(job) != peer:
            raise Refused(RejectReason.NOT_READY, "this node organises no such job", remedy="start the render again")
        organiser.asked()
        return organiser

    def _start(self, function: Callable[[*_Arguments], Awaitable[object]], *args: *_Arguments) -> None:
        if self._nursery is None:
            raise Refused(RejectReason.BUSY, "this node ends just now", remedy="ask another one")
        self._nursery.start_soon(function, *args)


async def _obey(part: Part, organiser: NodeId, document: dict[str, Any]) -> None:
    """What the organiser says of a job."""
    if document.get("go") is True:
        await part.go(document.get("from", 0), document.get("occupied"))
    elif "level" in document:
        part.on_level(document)
    elif "until" in document:
        part.release(document["until"])
    elif "fetch" in document:
        await part.fetch(document["fetch"])
    elif "claim" in document:
        part.claim(document["claim"])
    elif "forget" in document:
        await part.stay(document["forget"])
    elif "hold" in document:
        await part.pause(document, organiser)
    elif "begin" in document:
        part.begin(document)
    elif "gathered" in document:
        await part.forget_gathered(document["gathered"])


def node_of(job: Job, peer: str) -> NodeId:
    """Which of the job's nodes the peer is; Refused (12) if it is none of them."""
    node = node_named(peer)
    if node is None or node not in job.nodes:
        raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is not among the job's nodes")
    return node
