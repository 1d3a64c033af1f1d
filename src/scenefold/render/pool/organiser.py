"""The owner of a job's location: it makes the job, gets everybody ready, watches, and gathers the image.

No master: which node organises a job follows from the job's id and from who may render, and all that it decides alone is the
partition, as one value. Passes belong to all nodes. If another node is lost while they trace, those that are left go on (attempts.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import partial

import numpy as np
import trio

from scenefold.base.errors import LocalFault, Refused, ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.partition.division import Division
from scenefold.render.adaptive import going_on
from scenefold.render.algorithms import rule_of
from scenefold.render.arrays import F64
from scenefold.render.content import pair_boxes
from scenefold.render.contract import Renderer
from scenefold.render.developing import Box, develop
from scenefold.render.film import EVERY_ROW, Film
from scenefold.render.job import Job
from scenefold.render.layers import image_bytes, packed
from scenefold.render.numbers import depth_of_box, job_box
from scenefold.render.occupied import united
from scenefold.render.pool.attempts import Attempts, or_changed
from scenefold.render.pool.comebacks import Comebacks
from scenefold.render.pool.company import ASK_S_MAX, Company, NodesBack, NodesLost
from scenefold.render.pool.course import Course, whole_of
from scenefold.render.pool.dividing import Dividing
from scenefold.render.pool.division_moves import DivisionMoves
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.host import Host
from scenefold.render.pool.keeping import keep_places
from scenefold.render.pool.kept_film import ComingFilm, film_size, packed_film, stage_end, unpack_film
from scenefold.render.pool.levels import pieces
from scenefold.render.pool.mover import USUAL_PACE, Mover, Pace
from scenefold.render.pool.moves import Told
from scenefold.render.pool.part import Part
from scenefold.render.pool.planning import planned
from scenefold.render.pool.promises import Account
from scenefold.render.pool.request import RenderRequest, options_document
from scenefold.render.pool.share import FILM_LANE, LANE
from scenefold.render.pool.telling import failure_fields, failure_of, told
from scenefold.render.pool.unattended import IMAGE_KEPT_S
from scenefold.render.pool.whole_scene import DIGEST_BYTES, digest_of_pools
from scenefold.scene.log import EpochKeys
from scenefold.scene.tables import SceneTables
from scenefold.wire import CancelJob, StartJob, Value
from scenefold.world import DiskFailed, QuietLog

FORSAKEN_S = 900.0
"""A job that nobody asked for so long is given up: a client asks all the time, and may have begun the same image anew."""
LOST_S_MAX = 2.0
"""For a node that is lost to answer after all."""
UPLOAD_S_MAX = 900.0
"""A film to go on from, 4 MiB at a time, over whatever line the client has."""
POLL_S = 0.2
COMEBACK_S = 10.0
"""While nodes are missing, so often nothing is open for a moment, and who is back may join."""
COMEBACK_WORTH = 2.0
"""Who is back joins if that saves so many times what it takes,"""
COMEBACK_TAKES_S = 1.0
"""which is so much at least."""
KEEP_S = 600.0
"""A finished image is kept this long for whoever asked for it and waits,"""
IDLE_S = 60.0
"""but so long without a question only as long as nobody needs its place: a client asks all the time."""


class Organiser:
    """One job, from the request to the image."""

    def __init__(
        self,
        host: Host,
        renderer: Renderer,
        request: RenderRequest,
        keys: EpochKeys,
        own_part: Callable[[int], Part],
        quiet: QuietLog,
        account: Account,
        pace: Pace = USUAL_PACE,
    ) -> None:
        """`keys`: of the request, opened; both dropped once the job is made. `own_part(job)`: this node's own part in a job. `account`: of memory."""
        self._host, self._renderer, self._own_part, self._quiet, self._pace = host, renderer, own_part, quiet, pace
        self._id, self.account = request.job, account
        self._request: RenderRequest | None = request
        self._keys: EpochKeys | None = keys
        self._job: Job | None = None
        self._phase = "preparing"
        self._failure: Refused | None = None
        self._company: Company | None = None
        self._attempts: Attempts | None = None
        self._course = Course(request.options.plan.count, 0 if request.keep is None else request.keep.passes)
        self._released_at = 0.0
        self._level, self._goes_on = 0, EVERY_ROW
        """What is traced."""
        self._staged_passes, self._level_end = 0, 0
        """All below the first one are closed; the level that is traced ends before the second."""
        self._seconds: dict[str, float] = {}
        self._keep, self._options, self._unattended = request.keep, request.options, request.unattended
        self._algorithm = request.options.algorithm
        self._comebacks: Comebacks | None = None
        self._digest = bytes(DIGEST_BYTES)
        self._before, self._paths_before = self._course.before, 0
        size = film_size(request.options.plan, request.options.columns, request.options.window.pixels, self._before) if self._before else 0
        self._coming = ComingFilm(size)
        self._kept: tuple[int, bytes] = (0, b"")
        self._begun_passes = 0
        self._is_free = False
        """All nodes have let go of the job."""
        self._traced: int | None = None
        self._requested_at, self._asked_at = host.world.clock.now(), trio.current_time()
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
                self._phase, self._failure = "failed", failure_of(group, self._id, self._quiet, self._host.world.clock.now())
            finally:
                self._keys = self._request = None
            await self._free()
            self._drop()
            if self._failure is not None:
                # The place is free, and only the words are kept.
                self._job = self._company = self._attempts = None
                self.account.close()
            await self._host.world.clock.sleep(KEEP_S if self._unattended is None else IMAGE_KEPT_S)
        with trio.CancelScope(shield=True), trio.move_on_after(ASK_S_MAX):
            await self._free()

    def _drop(self) -> None:
        """What an image, or words, that are kept for a day do not need: the scene's tables, films, and which pixels went on."""
        self._is_free, self._comebacks, self._goes_on = True, None, EVERY_ROW
        self._kept, self._coming = (0, b""), ComingFilm(0)
        self.account.give_back("kept film")
        if self._attempts is not None:
            self._attempts.drop_scene()

    @property
    def pins_bytes(self) -> int:
        """Of memory, for as long as its user likes."""
        return 0 if self._unattended is None or self.has_failed else image_bytes(self._options.layers, self._options.window.pixels)

    @property
    def has_failed(self) -> bool:
        """Until all nodes have let go of the job it counts: it still speaks to them."""
        return self._failure is not None and self._job is None

    @property
    def is_idle(self) -> bool:
        """Whether the image is there, and nobody has asked for it for a while who would."""
        return self._phase == "done" and self._unattended is None and trio.current_time() - self._asked_at > IDLE_S

    @property
    def is_forsaken(self) -> bool:
        """Whether it is at work, and nobody has asked for it for so long that nobody will."""
        at_work = self._phase not in ("done", "failed")
        return at_work and self._unattended is None and trio.current_time() - self._asked_at > FORSAKEN_S

    def asked(self) -> None:
        """Somebody still wants the image."""
        self._asked_at = trio.current_time()

    def forget(self) -> None:
        """Keep the words, or the image, no longer."""
        self.cancel()

    def cancel(self) -> None:
        """Nobody wants the image any more."""
        self._scope.cancel()

    @property
    def ends(self) -> bool:
        """Whether that was said: it is only freed yet."""
        return self._scope.cancel_called

    @property
    def closed(self) -> int:
        """Passes, as far as is known."""
        return 0 if self._job is None else self._before if self._attempts is None else self._attempts.closed

    def row(self) -> dict[str, Value]:
        """The job among others, for the user who asked for it."""
        plan = None if self._job is None else self._job.plan
        return {
            "phase": self._phase,
            **failure_fields(self._failure),
            "passes": 0 if plan is None else plan.count if self._traced is None else self._begun_passes,
            "closed": self.closed,
            "age": self._host.world.clock.now() - self._requested_at,
            "options": options_document(self._options),
            "unattended": None if self._unattended is None else self._unattended.row(),
        }

    def state(self) -> dict[str, Value]:
        """How the job stands, for the client."""
        plan = None if self._job is None else self._job.plan
        states = {} if self._company is None else self._company.whole_states()
        return {
            **self.row(),
            "paths": 0 if plan is None else plan.paths if self._traced is None else self._traced,
            "numeric_class": "" if self._job is None else self._job.numeric_class,
            "paths_before": self._paths_before,
            "kept_passes": self._kept[0],
            "content": self._digest,
            **self._course.document(is_done=self._phase == "done"),
            "pools": 0 if self._job is None else len((self._job if self._attempts is None else self._attempts).division.pools),
            "attempts": 1 if self._company is None else 1 + self._company.roster.attempt,
            "passes_again": 0 if self._attempts is None else self._attempts.traced_again,
            "lost": [] if self._attempts is None else [address_of(node) for node in self._attempts.lost[:POOL_NODES_MAX]],
            "back": [] if self._attempts is None else [address_of(node) for node in self._attempts.back[:POOL_NODES_MAX]],
            "image_bytes": len(self.image),
            "seconds": {name: float(value) for name, value in self._seconds.items()},
            "nodes": [
                {"address": address_of(node), **states.get(node, {})}
                for node in (() if self._job is None else self._job.nodes)
                # A node that was lost before it said anything has done nothing.
                if self._attempts is None or node in states or node not in self._attempts.missing
            ],
        }

    async def _render(self) -> None:
        assert self._keys is not None and self._request is not None
        with _Timed(self, "plan"):
            plan = await planned(self._host, self._renderer, self._request, self._keys, self.account)
        self._job, self._keys, self._request = plan.job, None, None
        with plan.as_counted():
            async with trio.open_nursery() as nursery:
                nursery.start_soon(keep_places, self._host, plan.job, self._nodes_now)
                await self._make_image(*plan)
                nursery.cancel_scope.cancel()

    async def _make_image(self, job: Job, tables: SceneTables, dividing: Dividing) -> None:
        self._company = company = Company(self._host, job)
        try:
            with _Timed(self, "prepare"):
                await company.ask(StartJob(job=job.id, document=job.to_bytes()), PREPARE_S_MAX)
            begins: dict[str, Value] = {"go": True, "from": self._before}
            if self._keep is not None or job.skips:
                await company.look()
            if told := company.take_occupied(job.division):
                begins["occupied"] = await self._host.world.workers.run(LANE, united, told)
            if self._keep is not None:
                self._digest = digest_of_pools(job, [company.states[node].get("digest") for node in job.nodes])
                if self._keep.passes:
                    self._keep.check(self._digest, job.numeric_class)
            self._phase = "rendering"
            with _Timed(self, "render"):
                await self._film_before(job)
                clock = self._host.world.clock
                self._attempts = attempts = Attempts(job, company, lambda: self._own_part(job.id), clock, self._before, dividing)
                await company.tell(begins)
        except NodesLost as lost:
            # Nothing is traced yet, and whoever wants the image may choose again who renders it.
            raise lost.error from None
        boxes = await self._host.world.workers.run(LANE, _boxes_of, tables) if job.moves else None
        self._comebacks = Comebacks(self._host, job, lambda: attempts.missing, self._is_comeback_worth, begins)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._comebacks.run)
            while (change := await or_changed(partial(self._attempt, job, boxes))) is not None:
                tracing = company.nodes
                with _Timed(self, "recover"):
                    await attempts.begin_again(change)
                self._course.round_ended(company.states_of(tracing))
                if isinstance(change, NodesBack):
                    self._comebacks.joined(change.nodes)
            nursery.cancel_scope.cancel()
        self._phase, self._kept = "merging", (0, b"")
        self._course.round_ended(company.states_of(company.nodes))
        with _Timed(self, "merge"):
            film = self._film(job)
            self._traced = int(film.rows.samples.sum(dtype=np.int64))
            self.image = await self._host.world.workers.run(FILM_LANE, _image, film, job, job_box(tables))

    async def _attempt(self, job: Job, boxes: F64 | None) -> None:
        """All that is left to trace, and all films into ours. NodesLost, maybe in a group."""
        assert self._attempts is not None
        self._released_at = self.now()
        if self._keep is None:
            # In a new attempt nothing is released yet.
            self._begun_passes = min(self._begun_passes, self._attempts.top)
        with _Timed(self, "render"):
            async with trio.open_nursery() as nursery:
                mover = None if boxes is None else await self._host.world.workers.run(FILM_LANE, self._mover_of, boxes)
                if mover is not None:
                    nursery.start_soon(mover.run)
                await self._render_levels(job)
                nursery.cancel_scope.cancel()
        with _Timed(self, "merge"):
            await self._attempts.gather(range(self._begun_passes))

    async def _film_before(self, job: Job) -> None:
        """Put the film that the job goes on from into ours, if there is one, and go on with the level that it is in."""
        if not self._before:
            return
        with trio.move_on_after(UPLOAD_S_MAX) as scope:
            await self._coming.whole.wait()
        if scope.cancelled_caught:
            raise LocalFault("the film to go on from did not come", remedy="start the render again")
        film = self._film(job)
        self._goes_on = await self._host.world.workers.run(FILM_LANE, unpack_film, self._coming.film(), film)
        self._own_part(job.id).films.own.passes |= set(range(self._before))
        self._paths_before = int(film.rows.samples.sum(dtype=np.int64))
        self._level, self._staged_passes, self._begun_passes = job.plan.level_of(self._before - 1), self._before, self._before

    async def _render_levels(self, job: Job) -> None:
        """Level by level until the last one, or until no pixel goes on; without adaptive sampling there is one. It may be called again after a loss."""
        plan = job.plan
        while True:
            if self._level:
                for piece in pieces(self._level, self._goes_on):
                    await self._tell(piece)
            await self._render_level(job, plan.passes_until(self._level))
            if self._level == plan.levels - 1:
                return
            assert job.adaptive is not None
            goes_on = await self._host.world.workers.run(FILM_LANE, going_on, self._film(job), job.adaptive.noise, self._goes_on)
            if not goes_on.any():
                return
            self._level, self._goes_on = self._level + 1, goes_on

    async def _render_level(self, job: Job, end: int) -> None:
        """In stages, if films are to be kept, after each of which one is; or if nodes are lost, which may take part again after each."""
        assert self._attempts is not None
        rate, self._level_end = None, end
        while self._staged_passes < end:
            done = self._staged_passes
            # After a loss the stage is the same one.
            if self._begun_passes <= done:
                self._begun_passes = self._stage_end(done, end, rate)
            # After a loss a part of the stage is closed already.
            begun, until, closed = self.now(), self._begun_passes, max(done, self._attempts.closed)
            await self._tell({"until": until})
            while not await self._all_closed():
                await self._host.world.clock.sleep(POLL_S)
            if until > closed:
                rate = (until - closed) / max(self.now() - begun, 1e-3)
            if until == job.plan.count:
                return
            if self._keep is not None or until == end:
                # The next level goes on from what is in our film: if it does not come there whole, the stage is not over.
                await self._attempts.gather(range(until))
            self._staged_passes = until
            if self._keep is not None:
                self._kept = until, await self._host.world.workers.run(FILM_LANE, packed_film, self._film(job), self._goes_on)
            if self._comebacks is not None and (back := self._comebacks.ready()):
                raise NodesBack(back)

    def _stage_end(self, done: int, end: int, rate: float | None) -> int:
        assert self._attempts is not None
        count = len(self._company.nodes) if self._company is not None else 1
        if self._keep is not None:
            return stage_end(done, end, count, rate)
        return stage_end(max(done, self._attempts.top), end, count, rate, COMEBACK_S) if self._attempts.missing else end

    def _nodes_now(self) -> Collection[NodeId]:
        return () if self._company is None else self._company.nodes

    def _film(self, job: Job) -> Film:
        return self._own_part(job.id).films.own.film

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

    def _mover_of(self, boxes: F64) -> Mover | None:
        """For this attempt; None if no rule moves its cells. In a worker: a scene may have many boxes, and a rule may be a package's.

        `boxes`: f64[m, 2, 3], the first one the job's, then those of what nodes hold.
        """
        rule, attempts, company = rule_of(self._algorithm), self._attempts, self._company
        assert attempts is not None and company is not None
        if rule is None or all(len(pool) == 1 for pool in attempts.division.ranges):
            return None
        moves = DivisionMoves(rule, attempts.division, boxes[0], boxes[1:], before=self._told())
        world = self._host.world
        return Mover(moves, world.clock, world.workers, self._told, self._tell, self._left_s, self._noted_move, self._pace)

    def _noted_move(self, division: Division, *, is_claimed: bool) -> None:
        assert self._attempts is not None and self._company is not None
        self._attempts.newest_epoch = max(self._attempts.newest_epoch, division.epoch)
        if is_claimed:
            self._attempts.division = division
            self._course.cells_moved(self._company.states_of(self._company.nodes))

    def _is_comeback_worth(self) -> bool:
        """Whether those that are missing would save more time, of what is left, than it takes that they join."""
        attempts, company = self._attempts, self._company
        if attempts is None or company is None or not attempts.missing:
            return False
        saved = self._left_s() * len(attempts.missing) / len(attempts.missing + company.nodes)
        # All have other cells then, and load what they lack, at most as long as what they held at first.
        loading = (_seconds(state.get("prepare_seconds")) for state in company.states.values())
        return saved > COMEBACK_WORTH * max(attempts.took_s, COMEBACK_TAKES_S, *loading)

    def _left_s(self) -> float:
        """Of the passes of the level; endless as long as none is closed."""
        assert self._attempts is not None
        closed = self._attempts.closed - self._attempts.base
        left = self._level_end - self._attempts.closed
        return (self.now() - self._released_at) * left / closed if closed else math.inf

    def _told(self) -> list[Told]:
        """What all nodes have told lately; nothing as long as one has not told yet."""
        company = self._company
        if company is None or not company.hits.keys() >= set(company.nodes):
            return []
        states = [company.states.get(node, {}) for node in company.nodes]
        return [
            Told(whole_of(state.get("casts")), _seconds(state.get("busy_seconds")), company.hits[node])
            for node, state in zip(company.nodes, states, strict=True)
        ]

    async def _all_closed(self) -> bool:
        assert self._company is not None and self._attempts is not None
        await self._company.look()
        self._course.closed(self._attempts.closed, self.now())
        return self._attempts.closed == self._begun_passes

    async def _tell(self, document: dict[str, Value], timeout_s: float = ASK_S_MAX) -> None:
        assert self._company is not None
        await self._company.tell(document, timeout_s)

    async def _free(self) -> None:
        """Let all nodes go; one that does not answer will notice by itself that the job is over."""
        if self._job is None or self._is_free:
            return
        job, lost = self._job, () if self._attempts is None else self._attempts.lost

        async def free(node: NodeId) -> None:
            try:
                await self._host.ask(node, CancelJob(job=job.id), LOST_S_MAX if node in lost else ASK_S_MAX)
            except ScenefoldError as error:
                if node in lost:
                    return
                self._failure = self._failure or (None if self._phase == "done" else told(error))

        async with trio.open_nursery() as nursery:
            for node in job.nodes:
                nursery.start_soon(free, node)

    def note_seconds(self, name: str, seconds: float) -> None:
        """How long a phase took, or a part of it."""
        self._seconds[name] = self._seconds.get(name, 0.0) + seconds

    def now(self) -> float:
        """While this machine is awake."""
        return trio.current_time()


class _Timed:
    """Measures a phase."""

    def __init__(self, organiser: Organiser, name: str) -> None:
        self._organiser, self._name, self._begun = organiser, name, 0.0

    def __enter__(self) -> None:
        self._begun = self._organiser.now()

    def __exit__(self, *_: object) -> None:
        self._organiser.note_seconds(self._name, self._organiser.now() - self._begun)


def _boxes_of(tables: SceneTables) -> F64:
    _, _, low, high = pair_boxes(tables)
    return np.concatenate([np.stack(job_box(tables))[None], np.stack([low, high], axis=1)])


def _image(film: Film, job: Job, box: Box) -> bytes:
    return packed(develop(film, job.layers, box, depth_of_box(job.camera, box)))


def _seconds(value: Value | None) -> float:
    return value if isinstance(value, float) and 0.0 <= value < np.inf else 0.0
