"""The owner of a job's location: it makes the job, gets everybody ready, watches, and gathers the image.

No master: which node organises a job follows from the job's id and from who may render, and all that it decides alone is the
partition, as one value. Passes belong to all nodes. If a node is lost, the job fails with a word that says which.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.render.adaptive import going_on
from scenefold.render.algorithms import rule_of
from scenefold.render.arrays import F32
from scenefold.render.content import pair_boxes
from scenefold.render.contract import Renderer, check_layers_written
from scenefold.render.developing import Box, develop
from scenefold.render.film import EVERY_ROW, Film, GoesOn
from scenefold.render.first_cells import first_cells
from scenefold.render.job import Job
from scenefold.render.layers import packed
from scenefold.render.numbers import camera_numbers, depth_of_box, job_box
from scenefold.render.pool.hit_sample import hits_of_bytes
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.host import Host
from scenefold.render.pool.keeping import keep_places
from scenefold.render.pool.kept_film import ComingFilm, check_memory, film_size, packed_film, stage_end, unpack_film
from scenefold.render.pool.levels import pieces
from scenefold.render.pool.mover import Mover
from scenefold.render.pool.moves import Moves, Told
from scenefold.render.pool.part import Part
from scenefold.render.pool.request import Keep, RenderRequest
from scenefold.render.pool.share import FILM_LANE, LANE, read_tables
from scenefold.render.pool.telling import error_of, failure_fields, failure_of, told
from scenefold.render.pool.whole_scene import DIGEST_BYTES, digest_of_scene
from scenefold.scene.log import EpochKeys
from scenefold.scene.tables import SceneTables
from scenefold.wire import CancelJob, JobAnswer, JobEvent, JobState, JobStateReply, Packet, StartJob, Value, pack_value, unpack_value
from scenefold.world import DiskFailed, QuietLog

ASK_S_MAX = 30.0
UPLOAD_S_MAX = 900.0
"""A film to go on from, 4 MiB at a time, over whatever line the client has."""
_ANEW = "remove the file of the kept render to begin anew"
POLL_S = 0.2
KEEP_S = 600.0
"""A finished image is kept this long for whoever asked for it,"""
IDLE_S = 60.0
"""but so long without a question only as long as nobody needs its place: a client asks all the time."""


class Organiser:
    """One job, from the request to the image."""

    def __init__(
        self, host: Host, renderer: Renderer, request: RenderRequest, keys: EpochKeys, own_part: Callable[[int], Part], quiet: QuietLog
    ) -> None:
        """`keys`: those of the request, opened; both dropped as soon as the job is made. `own_part(job)`: this node's own part in a job."""
        self._host, self._renderer, self._own_part, self._quiet = host, renderer, own_part, quiet
        self._id = request.job
        self._request: RenderRequest | None = request
        self._keys: EpochKeys | None = keys
        self._job: Job | None = None
        self._phase = "preparing"
        self._failure: Refused | None = None
        self._states: dict[int, dict[str, Value]] = {}
        self._hits: dict[int, F32] = {}
        self._mover: Mover | None = None
        self._released_at = 0.0
        self._seconds: dict[str, float] = {}
        self._keep = request.keep
        self._algorithm = request.options.algorithm
        self._digest = bytes(DIGEST_BYTES)
        self._before = 0 if request.keep is None else request.keep.passes
        self._paths_before = 0
        size = film_size(request.options.plan, request.options.columns, request.options.window.pixels, self._before) if self._before else 0
        self._coming = ComingFilm(size)
        self._kept: tuple[int, bytes] = (0, b"")
        self._begun_passes = 0
        self._traced: int | None = None
        self._asked_at = self.now()
        self._scope = trio.CancelScope()
        self.image: bytes = b""

    async def run(self) -> None:
        """Render, keep the image for a while, then free the job everywhere."""
        with self._scope:
            try:
                await self._render()
                self._phase = "done"
                self.asked()
            except* DiskFailed:
                raise
            except* Exception as group:  # noqa: BLE001  a bug over one job is no end of a node
                self._phase, self._failure = "failed", failure_of(group, self._id, self._quiet, self.now())
            finally:
                self._keys = self._request = None
            await self._free()
            if self._failure is not None:
                # The place is free, and only the words are kept.
                self._job, self._states = None, {}
            await self._host.world.clock.sleep(KEEP_S)
        with trio.CancelScope(shield=True), trio.move_on_after(ASK_S_MAX):
            await self._free()

    @property
    def has_failed(self) -> bool:
        """Until all nodes have let go of the job it counts: it still speaks to them."""
        return self._failure is not None and self._job is None

    @property
    def is_idle(self) -> bool:
        """Whether the image is there, and nobody has asked for it for a while."""
        return self._phase == "done" and self.now() - self._asked_at > IDLE_S

    def asked(self) -> None:
        """Somebody still wants the image."""
        self._asked_at = self.now()

    def forget(self) -> None:
        """Keep the words, or the image, no longer."""
        self.cancel()

    def cancel(self) -> None:
        """Nobody wants the image any more."""
        self._scope.cancel()

    def state(self) -> dict[str, Value]:
        """How the job stands, for the client."""
        plan = None if self._job is None else self._job.plan
        return {
            "phase": self._phase,
            **failure_fields(self._failure),
            "passes": 0 if plan is None else plan.count if self._traced is None else self._begun_passes,
            "paths": 0 if plan is None else plan.paths if self._traced is None else self._traced,
            "closed": 0 if plan is None else self._before + sum(_whole(state.get("closed")) for state in self._states.values()),
            "numeric_class": "" if self._job is None else self._job.numeric_class,
            "paths_before": self._paths_before,
            "kept_passes": self._kept[0],
            "content": self._digest,
            "moved": 0 if self._mover is None else self._mover.moved,
            "image_bytes": len(self.image),
            "seconds": {name: float(value) for name, value in self._seconds.items()},
            "nodes": [
                {"address": address_of(node), **self._states.get(index, {})}
                for index, node in enumerate(() if self._job is None else self._job.nodes)
            ],
        }

    async def _render(self) -> None:
        assert self._keys is not None and self._request is not None
        with _Timed(self, "plan"):
            job, tables = await self._plan(self._request, self._keys)
        self._job, self._keys, self._request = job, None, None
        async with trio.open_nursery() as nursery:
            nursery.start_soon(keep_places, self._host, job)
            if job.moves:
                self._mover = await self._host.world.workers.run(LANE, self._mover_of, job, tables)
            await self._make_image(job, tables)
            nursery.cancel_scope.cancel()

    async def _make_image(self, job: Job, tables: SceneTables) -> None:
        with _Timed(self, "prepare"):
            await self._of_all(StartJob(job=job.id, document=job.to_bytes()), PREPARE_S_MAX)
        if self._keep is not None:
            await self._look_at_nodes(job)
            self._digest = digest_of_scene(job.content, (_digest_of(state.get("digest")) for state in self._states.values()))
            if self._keep.passes:
                _check_kept(self._keep, self._digest, job.numeric_class)
        self._phase = "rendering"
        with _Timed(self, "render"):
            goes_on = await self._film_before(job)
            await self._of_all(_event(job, {"go": True, "from": self._before}), ASK_S_MAX)
            self._released_at = self.now()
            async with trio.open_nursery() as nursery:
                if self._mover is not None:
                    nursery.start_soon(self._mover.run)
                await self._render_levels(job, goes_on)
                nursery.cancel_scope.cancel()
        self._phase, self._kept = "merging", (0, b"")
        with _Timed(self, "merge"):
            await self._gather(job)
            film = self._film(job)
            self._traced = int(film.rows.samples.sum(dtype=np.int64))
            self.image = await self._host.world.workers.run(FILM_LANE, _image, film, job, job_box(tables))

    async def _film_before(self, job: Job) -> GoesOn:
        """Put the film that the job goes on from into ours, if there is one; the rows that went on to the level that it is in."""
        if not self._before:
            return EVERY_ROW
        with trio.move_on_after(UPLOAD_S_MAX) as scope:
            await self._coming.whole.wait()
        if scope.cancelled_caught:
            raise LocalFault("the film to go on from did not come", remedy="start the render again")
        film = self._film(job)
        goes_on = await self._host.world.workers.run(FILM_LANE, unpack_film, self._coming.film(), film)
        self._paths_before = int(film.rows.samples.sum(dtype=np.int64))
        return goes_on

    async def _render_levels(self, job: Job, goes_on: GoesOn) -> None:
        """Level by level until the last one, or until no pixel goes on; without adaptive sampling there is one."""
        plan = job.plan
        done = self._begun_passes = self._before
        first = plan.level_of(done - 1) if done else 0
        for level in range(first, plan.levels):
            if level > first:
                assert job.adaptive is not None
                goes_on = await self._host.world.workers.run(FILM_LANE, going_on, self._film(job), job.adaptive.noise, goes_on)
                if not goes_on.any():
                    return
            if level:
                for piece in pieces(level, goes_on):
                    await self._of_all(_event(job, piece), ASK_S_MAX)
            done = await self._render_level(job, done, plan.passes_until(level), goes_on)

    async def _render_level(self, job: Job, done: int, end: int, goes_on: GoesOn) -> int:
        """In stages, if films are to be kept, after each of which one is. How many passes are closed in the end."""
        rate = None
        while done < end:
            begun, until = self.now(), stage_end(done, end, len(job.nodes), rate) if self._keep is not None else end
            self._begun_passes = until
            await self._of_all(_event(job, {"until": until}), ASK_S_MAX)
            while not await self._all_closed(job):
                await self._host.world.clock.sleep(POLL_S)
            rate, done = (until - done) / max(self.now() - begun, 1e-3), until
            if done < job.plan.count:
                await self._gather(job)
                if self._keep is not None:
                    self._kept = done, await self._host.world.workers.run(FILM_LANE, packed_film, self._film(job), goes_on)
        return done

    def _film(self, job: Job) -> Film:
        return self._own_part(job.id).member().film

    def take_film(self, index: int, payload: bytes) -> None:
        """A piece of the film to go on from. PeerFault if it does not follow on those before."""
        if self._failure is not None:
            raise told(self._failure)
        self._coming.take(index, payload)

    def kept_film(self, passes: int) -> bytes:
        """The film of all passes below this one; Refused if another one is kept by now."""
        if self._kept[0] != passes or not passes:
            raise Refused(RejectReason.NOT_READY, "that film is kept no longer", remedy="ask for the newest one")
        return self._kept[1]

    async def _plan(self, request: RenderRequest, keys: EpochKeys) -> tuple[Job, SceneTables]:
        host, options = self._host, request.options
        if self._keep is not None:
            check_memory(options.window.pixels, options.columns, host.memory_bytes)
        async with host.reader(request.scene, request.genesis, keys, request.head) as reader:
            tables = await read_tables(reader, host.world.workers)
        job = await host.world.workers.run(LANE, self._make_job, request, tables)
        return job, tables

    def _make_job(self, request: RenderRequest, tables: SceneTables) -> Job:
        options = request.options
        check_layers_written(self._renderer, options.layers)
        camera = tables.camera(options.camera)
        if camera is None:
            names = ", ".join(repr(known.name) for known in tables.cameras)
            raise LocalFault(
                f"the scene has no camera {options.camera!r}",
                remedy=f"choose one of: {names}; where none is named it is that of `scenectl scene settings`",
            )
        nodes = self._nodes(request)
        partition = first_cells(options.algorithm, len(nodes), tables, camera)
        return Job(
            id=request.job,
            scene=request.scene,
            genesis=request.genesis,
            keys=request.keys,
            content=tables.document.digest,
            numeric_class=self._renderer.numeric_class(),
            width=options.width,
            height=options.height,
            samples=options.samples,
            seed=options.seed,
            frame=0,
            depth=options.depth,
            sky=options.sky,
            camera=camera_numbers(camera, options.width, options.height),
            nodes=nodes,
            partition=partition,
            head=request.head,
            layers=options.layers,
            crop=options.crop,
            lens=options.lens,
            sampling=options.sampling,
            environment_rotation=options.environment_rotation,
            adaptive=options.adaptive,
            mips=options.mips,
            keeps=self._keep is not None,
            moves=options.moving and len(nodes) > 1 and rule_of(options.algorithm) is not None,
        )

    def _nodes(self, request: RenderRequest) -> tuple[NodeId, ...]:
        """Of those that the client named, the members. Nobody else: only for them are the keys, in what we hand on as in what we have."""
        named = request.keys.nodes
        nodes = tuple(node for node in self._host.nodes() if node in named)
        if self._host.node_id not in nodes:
            raise Refused(RejectReason.NOT_READY, "this node is no member of the cluster at the moment", remedy="start the render again")
        return nodes

    async def _look_at_nodes(self, job: Job) -> None:
        """Ask all nodes how they stand."""

        async def look(index: int, node: NodeId) -> None:
            reply = await self._host.ask(node, JobState(job=job.id), ASK_S_MAX)
            if not isinstance(reply, JobStateReply):
                raise PeerFault(f"{type(reply).__name__} is no answer to JobState", where=address_of(node))
            state = unpack_value(reply.document, what="a job's state")
            if not isinstance(state, dict):
                raise PeerFault("a job's state is ill-formed", where=address_of(node))
            if state.get("failure"):
                raise error_of(_whole(state.get("failure_reason")), str(state["failure"]), where=address_of(node))
            hits = state.pop("hits", None)
            if job.moves and hits is not None:
                self._hits[index] = hits_of_bytes(hits, len(job.nodes))
            self._states[index] = state

        async with trio.open_nursery() as nursery:
            for index, node in enumerate(job.nodes):
                nursery.start_soon(look, index, node)

    def _mover_of(self, job: Job, tables: SceneTables) -> Mover | None:
        """None if no rule moves its cells. In a worker: a scene may have many boxes, and a rule may be a package's."""
        rule = rule_of(self._algorithm)
        if rule is None:
            return None
        _, _, low, high = pair_boxes(tables)
        moves = Moves(rule, job.partition, np.stack(job_box(tables)), np.stack([low, high], axis=1))

        async def to_all(document: dict[str, Value], timeout_s: float) -> None:
            await self._of_all(_event(job, document), timeout_s)

        return Mover(moves, self._host.world.clock, self._host.world.workers, self._told, to_all, self._left_s)

    def _left_s(self) -> float:
        """Of the passes that are released; endless as long as none is closed."""
        closed = self._closed_now()
        left = self._begun_passes - self._before - closed
        return (self.now() - self._released_at) * left / closed if closed else math.inf

    def _told(self) -> list[Told]:
        """What all nodes have told lately; nothing as long as one has not told yet."""
        states = [self._states.get(index, {}) for index in range(len(self._hits))]
        if self._job is None or len(self._hits) < len(self._job.nodes):
            return []
        nothing = np.empty((0, 3), np.float32)
        return [
            Told(_whole(state.get("casts")), _seconds(state.get("busy_seconds")), self._hits.get(index, nothing))
            for index, state in enumerate(states)
        ]

    async def _all_closed(self, job: Job) -> bool:
        await self._look_at_nodes(job)
        return self._closed_now() == self._begun_passes - self._before

    def _closed_now(self) -> int:
        return sum(_whole(state.get("closed")) for state in self._states.values())

    async def _gather(self, job: Job) -> None:
        """Everybody's film into ours."""
        part = self._own_part(job.id)
        async with trio.open_nursery() as nursery:
            for neighbour in (part.me - 1, part.me + 1):
                if 0 <= neighbour < len(job.nodes):
                    nursery.start_soon(part.collect_film, neighbour)

    async def _of_all(self, packet: Packet, timeout_s: float) -> None:
        """Ask all nodes of the job; the first refusal is ours."""
        assert self._job is not None

        async def ask(node: NodeId) -> None:
            answer = await self._host.ask(node, packet, timeout_s)
            if not isinstance(answer, JobAnswer):
                raise PeerFault(f"{type(answer).__name__} is no answer to {type(packet).__name__}", where=address_of(node))
            if answer.reason:
                raise error_of(answer.reason, answer.text, where=address_of(node))

        async with trio.open_nursery() as nursery:
            for node in self._job.nodes:
                nursery.start_soon(ask, node)

    async def _free(self) -> None:
        """Let all nodes go; one that does not answer will notice by itself that the job is over."""
        if self._job is None:
            return
        job = self._job

        async def free(node: NodeId) -> None:
            try:
                await self._host.ask(node, CancelJob(job=job.id), ASK_S_MAX)
            except ScenefoldError as error:
                self._failure = self._failure or (None if self._phase == "done" else told(error))

        async with trio.open_nursery() as nursery:
            for node in job.nodes:
                nursery.start_soon(free, node)

    def note_seconds(self, name: str, seconds: float) -> None:
        """How long a phase took."""
        self._seconds[name] = seconds

    def now(self) -> float:
        """The node's clock."""
        return self._host.world.clock.now()


class _Timed:
    """Measures a phase."""

    def __init__(self, organiser: Organiser, name: str) -> None:
        self._organiser, self._name, self._begun = organiser, name, 0.0

    def __enter__(self) -> None:
        self._begun = self._organiser.now()

    def __exit__(self, *_: object) -> None:
        self._organiser.note_seconds(self._name, self._organiser.now() - self._begun)


def _digest_of(value: Value | None) -> bytes:
    if not isinstance(value, bytes) or len(value) != DIGEST_BYTES:
        raise PeerFault("a node tells no digest of what it holds")
    return value


def _check_kept(keep: Keep, digest: bytes, numeric_class: str) -> None:
    """LocalFault if the film to go on from is of another scene, or came about with other arithmetic."""
    if keep.content != digest:
        raise LocalFault("the scene is not the one that the kept render is of, or was changed", where="resume", remedy=_ANEW)
    if keep.numeric_class != numeric_class:
        what = f"the kept render is of the numeric class {keep.numeric_class:.60}, and the nodes render in {numeric_class:.60}"
        raise LocalFault(what, where="resume", remedy=f"render with the same versions, or {_ANEW}")


def _event(job: Job, document: dict[str, Value]) -> JobEvent:
    return JobEvent(job=job.id, document=pack_value(document))


def _image(film: Film, job: Job, box: Box) -> bytes:
    return packed(develop(film, job.layers, box, depth_of_box(job.camera, box)))


def _whole(value: Value | None) -> int:
    return value if isinstance(value, int) else 0


def _seconds(value: Value | None) -> float:
    return value if isinstance(value, float) and 0.0 <= value < np.inf else 0.0
