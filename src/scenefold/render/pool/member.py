"""A node's part in an attempt of a job: it traces what lies in its cell, passes rays on, and closes its own passes.

    rays in (SendRays) --> WorkQueue --> tracer in a worker thread --> Link --> rays out
                                              |
                                         PassSums by pass, collected by the pass's owner --> its film, and its keeper's copy

Everything here runs on the Trio thread but for the workers' calls; between two awaits the counts of a pass, its
queue and its sums agree with one another, and the ledger relies on that. Nodes are known by their places in the roster.
With an attempt all of this goes, but for films and statistics (specs/31-attempts.md).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable, Collection
from functools import partial

import numpy as np
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.rays import RAY_BYTES
from scenefold.base.reasons import RejectReason
from scenefold.render.arrays import U32
from scenefold.render.contract import Advanced
from scenefold.render.film import EVERY_ROW, GoesOn
from scenefold.render.job import Job
from scenefold.render.ledger import Counts, PassState
from scenefold.render.pass_sums import PassSums as Sums
from scenefold.render.pool.awake import Awake
from scenefold.render.pool.cell import Cell
from scenefold.render.pool.dealing import Dealer
from scenefold.render.pool.films import Summed
from scenefold.render.pool.incoming import batches_of, check_room, check_senders
from scenefold.render.pool.kept_sums import KeptSums, sums_packet
from scenefold.render.pool.lasting import Lasting
from scenefold.render.pool.links.link import Link
from scenefold.render.pool.links.sender import GIVE_UP_S
from scenefold.render.pool.outbox import Batch, frame_size
from scenefold.render.pool.own_passes import OwnPasses, closed_pass, pass_owner
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.share import FILM_LANE, LANE
from scenefold.render.pool.tracing import advanced, camera_rays
from scenefold.render.pool.work import Work, WorkQueue
from scenefold.wire import AcknowledgeRays, CollectPass, Packet, PassSums, SendRays
from scenefold.world import World, leaves

COLLECT_S_MAX = 120.0
AGAIN_S = 0.2
"""Before a node that could not be reached is asked again."""
DEALT = 0
"""Epoch of rays for another pool: no division has it, so whoever gets them addresses them anew."""
QUEUE_RAYS_ENOUGH = 32_768
"""With this many rays waiting, no further pass is opened."""


class Member:
    """One node's running part in one attempt."""

    def __init__(
        self,
        job: Job,
        roster: Roster,
        me: int,
        stride: int,
        cell: Cell,
        lasting: Lasting,
        done: Collection[int],
        world: World,
        ask: Callable[[int, Packet, float], Awaitable[Packet]],
        send: Callable[[int, Packet], Awaitable[None]],
    ) -> None:
        """`me`: the node's place. `done`: passes that are traced no more. `ask` and `send` reach the node at a place: with an answer, and without."""
        self._job, self._roster, self._me, self._stride, self._world = job, roster, me, stride, world
        self._cell, self._clock = cell, Awake()
        self._ask = ask
        self._plan = job.plan
        self._films, self.statistics, self.hits = lasting.films, lasting.statistics, lasting.hits
        self._own = OwnPasses(self._plan, roster.nodes, me, done)
        self._keeper = roster.keeper(me)
        self._queue = WorkQueue()
        self._goes_on = EVERY_ROW
        self._counts: dict[int, Counts] = {}
        self._reported: dict[int, Counts] = {}
        self._sums = KeptSums(self._plan, job.columns)
        self._links = {
            index: Link(job, roster.attempt, address_of(node), self._clock, partial(send, index), partial(self._knows_closed, index))
            for index, node in enumerate(roster.nodes)
            if index != me
        }
        self._changed = trio.Event()
        self._astray: deque[Work] = deque()
        """Rays to be addressed anew."""
        self._strayed = trio.Event()
        pools = cell.division.ranges
        self._mates = frozenset(cell.pool) - {me}
        """Who is in this node's pool, too."""
        self._dealer = Dealer(self._plan, pools, me, done, self._clock.now()) if len(pools) > 1 else None
        self._is_alone = self._dealer is not None and not self._mates
        self._opening = False
        self._resting = 0
        """Threads that have nothing to trace."""
        self._closing = trio.Lock()
        self._nursery: trio.Nursery | None = None
        self.away: dict[int, str] = {}
        """Nodes that this one cannot reach, for good, and what came of it."""
        self.on_newer: Callable[[int], object] = lambda _epoch: None
        """Told the epoch of rays that are addressed by a newer partition than this node's."""

    # What other nodes tell us --------------------------------------------------------------------------------

    def on_rays(self, node: int, packet: SendRays) -> None:
        """What another node has to say, unless it came before: rays that flew into this node's cell, counts of our passes, closed ones of its own.

        PeerFault if the packet is ill-formed, Refused if it is not for that node to say.
        """
        link, batches = self._link(node), batches_of(packet, self._plan)
        closed = [closed_pass(self._plan, len(self._roster.nodes), node, number) for number in packet.closed]
        link.acknowledged(packet.all_until, packet.selective)
        count = len(packet.rays) // RAY_BYTES
        if not link.has_come(packet.link_sequence):
            # What may not be taken has not come: its number does not count, and it is sent again.
            check_room(batches, self._counts, len(self._queue), len(self._roster.nodes), self._job.depth)
            if node not in self._mates:
                check_senders(batches, self._plan, len(self._roster.nodes), node)
        if not link.is_new(packet.link_sequence, frame_size(count, len(packet.counts))):
            return
        for batch in batches:
            self._take(batch)
        if batches:
            self._wake()
        self.statistics.rays_received += count
        for told in packet.counts:
            self._report(node, told.pass_index, Counts(told.created, told.retired, told.sent, told.received))
        for number in closed:
            self._forget(number)
            if self._dealer is not None:
                self._dealer.ended(node, number, self._clock.now())

    def _take(self, batch: Batch) -> None:
        self._count(batch.number, Counts(received=len(batch.rays)))
        if batch.epoch > self._cell.epoch:
            self.on_newer(batch.epoch)
        if batch.epoch == self._cell.epoch or self._is_alone:
            self._queue.put(batch.number, batch.rays)
        else:
            self._queue.lend(batch.number)
            self._stray(Work(batch.number, batch.rays))

    async def on_collect(self, node: int, packet: CollectPass) -> PassSums:
        """The owner of a pass takes its second reading. PeerFault for a pass that the job does not have, Refused if it is another node's."""
        number = closed_pass(self._plan, len(self._roster.nodes), node, packet.pass_index)
        counts = self._counts.get(number, Counts())
        payload = await self._world.workers.run(FILM_LANE, self._sums.packed, number)
        return sums_packet(packet.job, packet.attempt, number, payload, counts)

    async def on_copy(self, node: int, packet: PassSums) -> None:
        """A pass that another node has closed, to be kept for it, one at a time. PeerFault or Refused if it is not that node's, or not ours to keep."""
        number = closed_pass(self._plan, len(self._roster.nodes), node, packet.pass_index)
        if self._roster.keeper(node) != self._me:
            raise Refused(RejectReason.NOT_AUTHORISED, "this node keeps no copy of that one's film")
        copy = self._films.copy_of(self._roster.nodes[node])
        await self._world.workers.run(FILM_LANE, self._add_copy, copy, number, packet.payload)

    def _add_copy(self, copy: Summed, number: int, payload: bytes) -> None:
        total = self._sums.none_of(number)
        total.add_bytes(payload)
        copy.add(number, total, self._plan.first_path(number), self._stride, self._goes_on)

    def on_acknowledged(self, node: int, packet: AcknowledgeRays) -> None:
        """What we sent to another node has come. PeerFault if it was never sent."""
        self._link(node).acknowledged(packet.all_until, packet.selective)

    def _link(self, node: int) -> Link:
        link = self._links.get(node)
        if link is None:
            raise Refused(RejectReason.NOT_AUTHORISED, "a node sends itself no rays")
        return link

    def _knows_closed(self, node: int, number: int) -> None:
        self._own.told(number, node)
        self._wake()

    def go_on_with(self, goes_on: GoesOn) -> None:
        """All passes of the level before are closed, and these rows go on."""
        self._goes_on = goes_on

    def skip(self, first: int) -> None:
        """The job goes on from a film of all passes below this one."""
        self._own.skip(first)
        if self._dealer is not None:
            self._dealer.skip(first)

    def release(self, until: int) -> None:
        """Open passes below this one."""
        self._own.release(until)
        if self._dealer is not None:
            self._dealer.release(until, self._clock.now())
        self._wake()

    # Moving --------------------------------------------------------------------------------------------------

    @property
    def cell(self) -> Cell:
        """Where this node traces."""
        return self._cell

    def claim(self, cell: Cell) -> None:
        """Trace there from now on. Batches under way end where they began."""
        self._cell = cell
        for work in self._queue.drain():
            self._stray(work)
        self._wake()

    def _stray(self, work: Work) -> None:
        """Its pass is busy until it has an address."""
        self._astray.append(work)
        self._strayed.set()

    async def _readdress(self) -> None:
        while True:
            if not self._astray:
                self._strayed = trio.Event()
                await self._strayed.wait()
            work, cell = self._astray.popleft(), self._cell
            rays = await self._world.workers.run(FILM_LANE, cell.route, work.rays)
            if cell is not self._cell:
                self._astray.appendleft(work)
                continue
            mine = rays.pop(self._me, None)
            if mine is not None:
                self._queue.put(work.number, mine)
            sent = self._dispatch(cell.epoch, work.number, rays)
            self._count(work.number, Counts(sent=sent))
            if self._queue.done(work.number):
                self._tell(work.number)
            self._wake()

    # Tasks ---------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Trace until cancelled. Whatever fails here fails the job on this node."""
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            for place, link in self._links.items():
                nursery.start_soon(self._carry, place, link)
            for index in range(len(self._cell.tracers)):
                nursery.start_soon(self._trace, index)
            nursery.start_soon(self._readdress)
            try:
                await trio.sleep_forever()
            finally:
                # What others report while this part ends begins nothing any more.
                self._nursery = None

    async def _carry(self, place: int, link: Link) -> None:
        try:
            await link.run()
        except* Unreachable as group:
            self._give_up(place, next(leaves(group)))

    def _give_up(self, place: int, error: BaseException) -> None:
        """The organiser reads it, and has the next attempt without one of the two."""
        self.away.setdefault(place, str(error))

    @property
    def link_counts(self) -> dict[str, int]:
        """Packets of rays that this node sent, each once; packets of all kinds that it sent again; acknowledgements."""
        names = ("packets_sent", "packets_resent", "acknowledgements_sent")
        return {name: sum(getattr(link, name) for link in self._links.values()) for name in names}

    @property
    def closed(self) -> int:
        """How many of its own passes this node has closed, and its keeper has."""
        return self._own.closed

    @property
    def opened(self) -> int:
        """How many of its own passes this node has opened."""
        return self._own.opened

    @property
    def waiting(self) -> int:
        """Rays that wait to be traced here."""
        return len(self._queue)

    @property
    def owned(self) -> int:
        """How many passes this node owns."""
        return self._own.total

    async def _trace(self, thread: int) -> None:
        while True:
            cell = self._cell
            if self._own.may_open() and len(self._queue) < QUEUE_RAYS_ENOUGH and not self._opening:
                await self._open_pass(cell, thread)
                continue
            if not len(self._queue):
                await self._rest()
                continue
            await self._advance(cell, thread)

    async def _rest(self) -> None:
        """Until something has changed. If no other thread traces either, what waits for other nodes leaves."""
        self._resting += 1
        if self._resting == len(self._cell.tracers):
            for link in self._links.values():
                link.hurry()
        changed = self._changed
        try:
            await changed.wait()
        finally:
            self._resting -= 1

    async def _advance(self, cell: Cell, thread: int) -> None:
        """Trace some of what waits; the other threads that rest get their part of it."""
        taken = self._queue.take_share(1 + self._resting)
        begun = self._clock.now()
        with cell.at_work(), self._sums.lent([work.number for work in taken]) as lent:
            batches = [(work.rays, self._plan.first_path(work.number), sums) for work, sums in zip(taken, lent, strict=True)]
            outcomes = await self._world.workers.run(LANE, advanced, cell.tracers[thread], batches)
        self.statistics.busy_seconds += self._clock.now() - begun
        for work, outcome in zip(taken, outcomes, strict=True):
            self._traced(cell, work.number, outcome)

    def _traced(self, cell: Cell, number: int, outcome: Advanced) -> None:
        self.statistics.casts += outcome.casts
        self.statistics.shadow_casts += outcome.shadow_casts
        if outcome.hits is not None and self._job.moves:
            self.hits.add(outcome.hits, outcome.hit_count)
        sent = self._dispatch(cell.epoch, number, cell.by_place(outcome.leaving))
        self._count(number, Counts(created=outcome.created, retired=outcome.retired, sent=sent))
        if self._queue.done(number):
            self._tell(number)

    async def _open_pass(self, cell: Cell, thread: int) -> None:
        self._opening = True
        try:
            number = self._own.open_next()
            with cell.at_work():
                rays = await self._world.workers.run(LANE, camera_rays, cell.tracers[thread], self._job, number, self._goes_on)
        finally:
            self._opening = False
        created, dealt = sum(map(len, rays.values())), dict[int, U32]()
        if self._dealer is not None and created:
            rays, dealt = self._dealer.dealt(number, rays, self._clock.now())
        rays = cell.by_place(rays)
        if not created:
            # None of its pixels goes on: nobody has anything of it.
            self._films.own.passes.add(number)
            self._own.close(number)
            if self._dealer is not None:
                self._dealer.closed(number, self._clock.now())
                self._tell_closed(number)
            self._wake()
            return
        mine = rays.pop(self._me, None)
        if mine is not None and cell is self._cell:
            self._queue.put(number, mine)
        elif mine is not None:
            self._queue.lend(number)
            self._stray(Work(number, mine))
        sent = self._dispatch(cell.epoch, number, rays) + self._dispatch(DEALT, number, dealt)
        self._count(number, Counts(created=created, sent=sent))
        self._wake()
        if not self._queue.is_busy(number):
            self._tell(number)

    # Counting ------------------------------------------------------------------------------------------------

    def _dispatch(self, epoch: int, number: int, leaving: dict[int, U32]) -> int:
        """To the nodes at these places; how many."""
        sent = 0
        for index, rays in leaving.items():
            if len(rays):
                self._links[index].put_rays(epoch, number, np.ascontiguousarray(rays), are_all=epoch == DEALT)
                sent += len(rays)
        self.statistics.rays_sent += sent
        return sent

    def _count(self, number: int, more: Counts) -> None:
        self._counts[number] = self._counts.get(number, Counts()) + more
        self.statistics.rays += more.created

    def _tell(self, number: int) -> None:
        """Nothing of a pass waits here any more: let its owner know the counts."""
        counts = self._counts[number]
        if self._reported.get(number) == counts:
            return
        self._reported[number] = counts
        owner = pass_owner(self._plan, number, len(self._roster.nodes))
        if owner == self._me:
            self._report(self._me, number, counts)
            return
        self._links[owner].put_counts(number, counts, are_last=self._is_alone)

    def _report(self, node: int, number: int, counts: Counts) -> None:
        if self._dealer is not None:
            if node != self._me and node not in self._mates | self._dealer.helpers(number):
                # Its pool was dealt nothing: nobody reads its counts a second time.
                return
            self._dealer.reported(number, node, counts, self._clock.now())
        ledger = self._own.ledgers.get(number)
        if ledger is not None and ledger.report(node, counts) and self._nursery is not None:
            ledger.begin_collection()
            self._nursery.start_soon(self._collect, number)

    def _wake(self) -> None:
        self._changed.set()
        self._changed = trio.Event()

    # Closing -------------------------------------------------------------------------------------------------

    async def _collect(self, number: int) -> None:
        """The second reading of a pass, again and again while the newest counts balance."""
        ledger = self._own.ledgers[number]
        replies: dict[int, PassSums] = {}
        # Rays stay in a pool, so one that was dealt none has nothing.
        takers = self._mates if self._dealer is None else self._mates | self._dealer.helpers(number)

        async def read(index: int) -> None:
            request = CollectPass(job=self._job.id, pass_index=number, attempt=self._roster.attempt)
            reply = await self._answer(index, request)
            if not isinstance(reply, PassSums) or reply.pass_index != number:
                raise PeerFault(f"{type(reply).__name__} is no answer to CollectPass", where=address_of(self._roster.nodes[index]))
            replies[index] = reply

        while True:
            # Where nobody else has sums nothing else would let others run.
            await trio.lowlevel.checkpoint()
            replies.clear()
            async with trio.open_nursery() as nursery:
                for index in takers:
                    nursery.start_soon(read, index)
            state = ledger.collected(self._me, self._counts.get(number, Counts()))
            for index in self._links:
                reply = replies.get(index)
                state = ledger.collected(
                    index, Counts() if reply is None else Counts(reply.created, reply.retired, reply.sent, reply.received)
                )
            if state is PassState.CLOSED:
                break
            if not ledger.looks_settled:
                return
            ledger.begin_collection()
        async with self._closing:
            total = await self._world.workers.run(FILM_LANE, self._close, number, [reply.payload for reply in replies.values()])
        self._forget(number)
        if self._dealer is not None:
            self._dealer.closed(number, self._clock.now())
        self._own.close(number, takers, is_copied=self._keeper is None)
        self._tell_closed(number)
        self._wake()
        if self._keeper is not None:
            await self._answer(self._keeper, await self._world.workers.run(FILM_LANE, self._copy_of, number, total))
            self._own.copied(number)
            self._wake()

    def _tell_closed(self, number: int) -> None:
        for link in self._links.values():
            link.put_closed(number)

    async def _answer(self, node: int, packet: Packet) -> Packet:
        """Ask until it answers: of a node that died, or cannot be reached, the organiser will tell, which ends this."""
        give_up_at = self._clock.now() + GIVE_UP_S
        while True:
            try:
                return await self._ask(node, packet, COLLECT_S_MAX)
            except (Unreachable, Refused) as error:
                if isinstance(error, Refused) and error.reason is not RejectReason.NOT_READY:
                    raise
                if self._clock.now() >= give_up_at:
                    self._give_up(node, error)
            await self._world.clock.sleep(AGAIN_S)

    def _copy_of(self, number: int, total: Sums) -> PassSums:
        return sums_packet(self._job.id, self._roster.attempt, number, total.to_bytes(), Counts())

    def _close(self, number: int, payloads: list[bytes]) -> Sums:
        """Add everybody's sums of a pass, and the pass to the film. In a worker; passes close one at a time."""
        total = self._sums.total(number)
        for payload in payloads:
            total.add_bytes(payload)
        self.statistics.counters = [known + int(more) for known, more in zip(self.statistics.counters, total.counters, strict=True)]
        self._films.own.add(number, total, self._plan.first_path(number), self._stride, self._goes_on)
        return total

    def _forget(self, number: int) -> None:
        self._sums.forget(number)
        for kept in (self._counts, self._reported):
            kept.pop(number, None)
