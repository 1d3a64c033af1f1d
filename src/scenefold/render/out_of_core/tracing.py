"""The order of work: waves of passes, cell by cell, those with most waiting rays first (specs/27-out-of-core.md)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import trio

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.base.rays import RAY_BYTES
from scenefold.render.adaptive import going_on
from scenefold.render.arrays import U32
from scenefold.render.contract import Advanced, Tracer
from scenefold.render.film import EVERY_ROW, Film
from scenefold.render.film_rows import FilmRows, row_bytes
from scenefold.render.job import Job
from scenefold.render.out_of_core.pager import Pager
from scenefold.render.out_of_core.spill import Spill
from scenefold.render.out_of_core.sweep import Sweep, lots_of
from scenefold.render.out_of_core.waiting_rays import Places, WaitingRays
from scenefold.render.pass_sums import COUNTERS, PassSums
from scenefold.render.pool.share import FILM_LANE, LANE
from scenefold.world import Workers

WAVE_BYTES = 4 << 30
"""Of files, for sums and waiting rays of the passes of a wave."""
_RAYS_OF_A_PATH = 3
"""That wait at once, at most, as a rule: one goes on, and one looks for light."""
PIECE_RAYS = 16_384
"""Handed to a tracer at a time: what it needs for them is a few MiB."""
LOT_RAYS = 65_536
"""Of as many passes as have them together, worked off without a word to other threads: to hand over costs as much as some hundred rays."""
TREES_LANE = "trees"
"""A worker thread that builds trees while others trace."""

Progress = Callable[[int, int], None]
_Work = TypeVar("_Work")


@dataclass(slots=True)
class Counts:
    """What was done."""

    rays: int = 0
    casts: int = 0
    shadow_casts: int = 0
    passed: int = 0
    """Rays that left a cell for another."""
    visits: int = 0
    """How often a cell was worked off."""
    not_finite: int = 0
    clamped: int = 0
    paths: int = 0


class Tracing:
    """One job, from its first pass to its film."""

    def __init__(self, job: Job, stride: int, pager: Pager, spill: Spill, workers: Workers, threads: int, sweep: Sweep) -> None:
        self._job, self._stride, self._pager, self._workers, self._threads = job, stride, pager, workers, threads
        self._plan, self._columns = job.plan, job.columns
        sums_bytes = PASS_PATHS_MAX * (8 * self._columns.radiance + 4 * self._columns.aovs)
        pass_bytes = sums_bytes + PASS_PATHS_MAX * _RAYS_OF_A_PATH * RAY_BYTES
        self._at_once = max(min(WAVE_BYTES // pass_bytes, self._plan.count), 1)
        pixels = job.window.pixels
        self.film = Film(job.window.width, job.window.height, self._columns)
        self.film.rows = FilmRows(self._columns, spill.zeros(np.uint64, (pixels, row_bytes(self._columns) // 8)))
        self._radiance = spill.zeros(np.int64, (self._at_once, PASS_PATHS_MAX, self._columns.radiance))
        self._aovs = spill.zeros(np.int32, (self._at_once, PASS_PATHS_MAX, self._columns.aovs))
        self.rays = WaitingRays(spill, job.partition.nodes)
        self.counts = Counts()
        self._sweep = sweep
        self._goes_on = EVERY_ROW
        self._sums: dict[int, PassSums] = {}
        self._left: dict[int, int] = {}
        """Rays of each open pass that neither ended nor were added up yet."""
        self._lock = threading.Lock()

    async def run(self, progress: Progress) -> Film:
        """Trace all passes."""
        done = 0
        for level in range(self._plan.levels):
            last = self._plan.passes_until(level)
            while done < last:
                wave = range(done, min(done + self._at_once, last))
                await self._wave(wave, progress)
                done = wave.stop
            if self._job.adaptive is not None and done < self._plan.count:
                film, before, noise = self.film, self._goes_on, self._job.adaptive.noise
                self._goes_on = await self._workers.run(FILM_LANE, going_on, film, noise, before)
                if not self._goes_on.any():
                    break
        return self.film

    async def _wave(self, wave: Sequence[int], progress: Progress) -> None:
        for slot, number in enumerate(wave):
            size = self._plan.size(number)
            self._sums[number] = PassSums(self._radiance[slot, :size], self._aovs[slot, :size], np.zeros(COUNTERS, np.int64))
        self._sweep.begin()
        await self._make_camera_rays(wave)
        closed = wave[0] + await self._close()
        progress(closed, self._plan.count)
        while self._left:
            await self._step()
            closed += await self._close()
            progress(closed, self._plan.count)

    async def _make_camera_rays(self, wave: Sequence[int]) -> None:
        scene = await self._workers.run(LANE, self._pager.camera_scene)
        try:
            await self._all_threads(scene.tracers(self._threads), list(wave), self._generate)
        finally:
            with trio.CancelScope(shield=True):
                await self._workers.run(LANE, scene.close)

    def _generate(self, tracer: Tracer, number: int) -> None:
        """In a worker."""
        first, pixels = self._plan.first_path(number), self._job.window.pixels
        made = 0
        for cell, rays in tracer.generate(first, self._plan.size(number)).items():
            some = rays
            if len(self._goes_on):
                some = rays[self._goes_on[(first + (rays[:, 7] >> np.uint32(16)).astype(np.int64)) % pixels] != 0]
            if len(some):
                self.rays.put(cell, [(number, some)])
                made += len(some)
        self._left[number] = made
        with self._lock:
            self.counts.rays += made

    async def _step(self) -> None:
        """Work the next cell off, and build the trees of the one after it meanwhile."""
        cell = self._sweep.next(self.rays.counts)
        if cell not in self._pager:
            await self._workers.run(TREES_LANE, self._pager.open, cell, ())
        following = self._sweep.after(self.rays.counts, cell)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._work_off, cell)
            if following is not None and following not in self._pager:
                nursery.start_soon(self._make_ready, following, cell)

    async def _make_ready(self, following: int, cell: int) -> None:
        """Build its trees, or where there is no room for that beside those of `cell`, have read what they are built from."""
        if self._pager.fits_beside(following, (cell,)):
            await self._workers.run(TREES_LANE, self._pager.open, following, (cell,))
        else:
            await self._workers.run(TREES_LANE, self._pager.ask_for, following)

    async def _work_off(self, cell: int) -> None:
        taken = self.rays.take(cell)
        self.counts.visits += 1
        tracers = self._pager.scene(cell).tracers(self._threads)
        lots = list(lots_of({number: sum(count for _, count in places) for number, places in taken.items()}, self._threads, LOT_RAYS))
        await self._all_threads(tracers, lots, lambda tracer, lot: self._advance(tracer, cell, {number: taken[number] for number in lot}))
        self.rays.worked_off(cell)

    def _advance(self, tracer: Tracer, cell: int, lot: dict[int, Places]) -> None:
        """All rays of some passes that wait for this cell. In a worker; a pass is in one thread at a time."""
        leaving: dict[int, list[tuple[int, U32]]] = {}
        held = 0
        for number, places in lot.items():
            first, sums = self._plan.first_path(number), self._sums[number]
            for rays in self._pieces(cell, places):
                outcome = tracer.advance(rays, first, sums)
                for target, some in outcome.leaving.items():
                    leaving.setdefault(target, []).append((number, some))
                    held += len(some)
                self._left[number] += outcome.created - outcome.retired
                self._count(outcome)
                if held > LOT_RAYS:
                    self._put(leaving)
                    leaving, held = {}, 0
        self._put(leaving)

    def _put(self, leaving: dict[int, list[tuple[int, U32]]]) -> None:
        for target, rays in leaving.items():
            self.rays.put(target, rays)

    def _pieces(self, cell: int, places: Places) -> Iterator[U32]:
        """What lies there, in pieces that are neither very large nor very many."""
        together: list[U32] = []
        count = 0
        for first, length in places:
            for at in range(first, first + length, PIECE_RAYS):
                rays = self.rays.read(cell, at, min(PIECE_RAYS, first + length - at))
                if count + len(rays) > PIECE_RAYS:
                    yield np.concatenate(together)
                    together, count = [], 0
                together.append(rays)
                count += len(rays)
        if together:
            yield np.concatenate(together)

    def _count(self, outcome: Advanced) -> None:
        with self._lock:
            counts = self.counts
            counts.rays += outcome.created
            counts.casts += outcome.casts
            counts.shadow_casts += outcome.shadow_casts
            counts.passed += sum(map(len, outcome.leaving.values()))

    async def _all_threads(self, tracers: Sequence[Tracer], works: Sequence[_Work], do: Callable[[Tracer, _Work], None]) -> None:
        """Do all of the work, with a tracer each thread."""
        following = iter(works)

        async def go_on(tracer: Tracer) -> None:
            for work in following:
                await self._workers.run(LANE, do, tracer, work)

        async with trio.open_nursery() as nursery:
            for tracer in tracers:
                nursery.start_soon(go_on, tracer)

    async def _close(self) -> int:
        """Passes none of whose rays is left go to the film; how many did."""
        ended = [number for number, left in self._left.items() if left == 0]
        for number in ended:
            del self._left[number]
            await self._workers.run(FILM_LANE, self._add, number, self._sums.pop(number))
        return len(ended)

    def _add(self, number: int, sums: PassSums) -> None:
        first, size = self._plan.first_path(number), self._plan.size(number)
        self.film.add(sums, first, self._stride, self._goes_on)
        rows = (first + np.arange(size)) % self._job.window.pixels
        self.counts.paths += int(self._goes_on[rows].sum()) if len(self._goes_on) else size
        self.counts.not_finite += int(sums.counters[1])
        self.counts.clamped += int(sums.counters[2])
        # The next wave finds zeros again.
        sums.radiance[:] = 0
        sums.aovs[:] = 0
