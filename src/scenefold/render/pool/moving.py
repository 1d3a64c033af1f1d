"""A node's side of moving cells: fetch, claim, let go (specs/29-moving-cells.md)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import partial

import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.plain_values import whole
from scenefold.base.reasons import RejectReason
from scenefold.partition.division import Division
from scenefold.partition.value import EPOCH_MAX
from scenefold.render.content import share_of
from scenefold.render.contract import MovableScene, OpenScene, Renderer, RoutingTracer
from scenefold.render.job import Job
from scenefold.render.pool.cell import Cell
from scenefold.render.pool.emptiness import Emptiness
from scenefold.render.pool.host import Host
from scenefold.render.pool.member import Member
from scenefold.render.pool.promises import Account
from scenefold.render.pool.share import LANE, LoadedShare, held_by, load_share


@dataclass(frozen=True, slots=True)
class Held:
    """A cell, and what is held for it."""

    cell: Cell
    loaded: LoadedShare
    scene: OpenScene
    promise: str
    """What the memory for it was promised under."""


class Moving:
    """Of one part. `held`: what it traces with, once it is ready."""

    def __init__(self, host: Host, renderer: Renderer, job: Job, me: int, account: Account) -> None:
        """`account`: of the memory that the part takes."""
        self._host, self._renderer, self._job, self._account = host, renderer, job, account
        self._opened_count = 0
        self._place, self._places = me, len(job.nodes)
        self.held: Held | None = None
        self.emptiness = Emptiness(host.world.workers)
        self.bytes_read = 0
        """Of the scene, so far."""
        self._next: Held | None = None
        self._left: deque[Held] = deque()
        """To be closed once no tracer of theirs works."""
        self._has_left, self._all_left = trio.Event(), trio.Event()
        self._all_left.set()
        self._turn = trio.Lock()
        self._unwanted = 0
        """What was fetched of this epoch, or an older one, is let go of."""
        self._is_over = False

    async def open(self) -> Held:
        """The job's first cell; the scene's keys are needed for as long as this takes."""
        self.held = held = await self._opened(self._job.division, self._place)
        if self._job.skips:
            await self.emptiness.find(held.loaded, *held_by(held.cell.division, self._place), held.cell.tracers)
        return held

    async def see(self, occupied: object) -> None:
        """Where any node holds something. PeerFault if that is ill-formed."""
        now = self._now()
        await self.emptiness.see(occupied, now.loaded, now.cell.tracers)

    def take_place(self, place: int, places: int) -> None:
        """In a new attempt. Nothing is traced before a cell of it is claimed."""
        self._place, self._places = place, places

    async def fetch(self, document: object, *, is_anew: bool = False) -> None:
        """Make ready to answer for this node's cell of another division. PeerFault if it is none, LocalFault if it cannot be.

        `is_anew`: an attempt begins, nothing is traced, and what was fetched before will not be claimed.
        """
        division = Division.from_document(document)
        async with self._turn:
            if division.nodes != self._places:
                raise PeerFault("a division is for another number of nodes")
            if not is_anew and division.ranges != self._now().cell.division.ranges:
                raise PeerFault("nodes move from one pool to another while they trace")
            if is_anew and self._next is not None:
                dropped, self._next = self._next, None
                # What is in no list any more, nobody else would close.
                with trio.CancelScope(shield=True):
                    await self._close(dropped)
            now = self._now()
            if division.epoch <= now.cell.epoch or self._next is not None:
                raise PeerFault("cells do not move that way", where=f"epoch {division.epoch}")
            if not is_anew and not now.cell.can_route:
                raise LocalFault("the renderer cannot move cells", remedy="render with fixed cells")
            # Two cells are held at most.
            await self._all_left.wait()
            fetched = await self._moved(self._now(), division, self._place)
            if division.epoch <= self._unwanted:
                with trio.CancelScope(shield=True):
                    await self._close(fetched)
                raise Refused(RejectReason.NOT_READY, "the cell is wanted no more")
            self._next = fetched

    def claim(self, epoch: object, member: Member) -> None:
        """Answer for the cell that was fetched. PeerFault if it was not."""
        if _epoch(epoch) != self._now().cell.epoch:
            member.claim(self.take(epoch))

    def take(self, epoch: object) -> Cell:
        """The cell that was fetched; what was held before is let go of. PeerFault if it was not."""
        number, now, fetched = _epoch(epoch), self._now(), self._next
        if fetched is None or fetched.cell.epoch != number:
            raise PeerFault("no such cell was fetched", where=f"epoch {number}")
        self.held, self._next = fetched, None
        self._left.append(now)
        self._all_left = trio.Event()
        self._has_left.set()
        return fetched.cell

    def claim_if_fetched(self, epoch: int, member: Member) -> None:
        """The word of a node that has claimed already."""
        if self._next is not None and self._next.cell.epoch == epoch:
            self.claim(epoch, member)

    async def forget(self, epoch: object) -> None:
        """That cell will not be claimed. While it is fetched, whoever does that lets go of it: that may take minutes, and nobody waits for it."""
        number = _epoch(epoch)
        if self._turn.locked():
            self._unwanted = max(self._unwanted, number)
            return
        async with self._turn:
            fetched = self._next
            if fetched is not None and fetched.cell.epoch == number:
                self._next = None
                with trio.CancelScope(shield=True):
                    await self._close(fetched)

    async def run(self) -> None:
        """Let go of what is no longer needed, until cancelled."""
        while True:
            if not self._left:
                self._has_left = trio.Event()
                await self._has_left.wait()
            await self._left[0].cell.at_rest()
            # What is in no list any more, nobody else would close.
            with trio.CancelScope(shield=True):
                await self._close(self._left.popleft())
            if not self._left:
                self._all_left.set()

    async def end(self) -> None:
        """Close everything; nothing traces any more."""
        self._is_over = True
        scenes = {id(held.scene): held for held in (self.held, self._next, *self._left) if held is not None}
        self.held = self._next = None
        self._left.clear()
        self._all_left.set()
        for held in scenes.values():
            await self._host.world.workers.run(LANE, held.scene.close)

    def _now(self) -> Held:
        if self.held is None:
            raise Refused(RejectReason.NOT_READY, "this node's part of the job is not ready")
        return self.held

    async def _moved(self, now: Held, division: Division, place: int) -> Held:
        cells, mine = held_by(division, place)
        if held_by(now.cell.division, now.cell.place) == (cells.with_epoch(now.cell.epoch), mine):
            # Only other pools' cells move. Our places may be others, and our pool's cells are the same.
            return Held(Cell(division, place, now.cell.tracers), now.loaded, now.scene, now.promise)
        needed = await self._host.world.workers.run(LANE, share_of, now.loaded.tables, cells, mine)
        share = now.loaded.share
        holds = set(needed.groups) <= set(share.groups) and set(needed.instances) <= set(share.instances)
        if holds and isinstance(now.scene, MovableScene):
            tracers = await self._host.world.workers.run(LANE, now.scene.tracers_in, cells, mine, self._host.render_threads)
            self.emptiness.use_in(tracers)
            return Held(Cell(division, place, tracers), now.loaded, now.scene, now.promise)
        return await self._opened(division, place)

    async def _opened(self, division: Division, place: int) -> Held:
        self._opened_count += 1
        promise = f"cell {self._opened_count}"
        try:
            return await self._open(division, place, promise)
        except BaseException:
            self._account.give_back(promise)
            raise

    async def _open(self, division: Division, place: int, promise: str) -> Held:
        host, job = self._host, self._job.divided(division)
        if self.held is not None:
            # The digest of the whole scene was told already.
            job = replace(job, keeps=False)
        async with host.reader(job.scene, job.genesis, host.opened(job.keys, job.genesis, job.id), job.head) as reader:
            loaded = await load_share(reader, host.world.workers, job, place, partial(self._account.take, promise))
        self.bytes_read += loaded.bytes_read
        await self.emptiness.check(loaded, *held_by(division, place))
        scene = await host.world.workers.run(LANE, self._renderer.open, loaded.held, loaded.numbers, *held_by(division, place))
        if self._is_over:
            await host.world.workers.run(LANE, scene.close)
            raise Refused(RejectReason.NOT_READY, "this node's part of the job is over")
        tracers = scene.tracers(host.render_threads)
        if job.others and not all(isinstance(tracer, RoutingTracer) for tracer in tracers):
            await host.world.workers.run(LANE, scene.close)
            raise LocalFault(
                "the renderer's rays depend on what is traced with them, so paths cannot be dealt",
                remedy="render in one pool, or on one node",
            )
        self.emptiness.use_in(tracers)
        return Held(Cell(division, place, tracers), loaded, scene, promise)

    async def _close(self, held: Held) -> None:
        """Unless somebody else traces with it."""
        if all(other is None or other.scene is not held.scene for other in (self.held, self._next, *self._left)):
            await self._host.world.workers.run(LANE, held.scene.close)
            self._account.give_back(held.promise)


def _epoch(value: object) -> int:
    try:
        return whole(value, 0, EPOCH_MAX)
    except ValueError as error:
        raise PeerFault("an epoch is no whole number", where=f"{value!r:.40}") from error
