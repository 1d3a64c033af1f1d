"""The organiser's side of attempts: films are gathered, and after a loss those that are left begin again (specs/31-attempts.md)."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Collection
from functools import partial

import trio

from scenefold.base.errors import PeerFault, ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.partition.division import Division
from scenefold.render.job import Job
from scenefold.render.pool.company import Company, NodesBack, NodesLost, back_of, is_away, lost_of
from scenefold.render.pool.dividing import Dividing, Standing
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.part import Part
from scenefold.render.pool.pass_bits import bits_of, passes_of
from scenefold.render.pool.roster import Roster
from scenefold.world import Clock, leaves

GATHER_S_MAX = 90.0
"""So long films are asked for again that did not come, though nobody is lost: who has not reached another node for a minute says so, and one of the two is."""
GATHER_PAUSE_S = 0.5

_log = logging.getLogger("scenefold.render.pool")


class Attempts:
    """Of one job."""

    def __init__(self, job: Job, company: Company, part: Callable[[], Part], clock: Clock, before: int, dividing: Dividing) -> None:
        """`part`: this node's own. `before`: passes below this number are in its film. `dividing`: how the job's space is."""
        self._job, self._company, self._part, self._clock = job, company, part, clock
        self._dividing: Dividing | None = dividing
        self._gatherings = 0
        self._cells_of = job.nodes
        self.division = job.division
        """The newest that all have claimed."""
        self.newest_epoch = self.division.epoch
        """That any was told of."""
        self.base = before
        """Passes that were done when this attempt began;"""
        self.top = before
        """all of them are below this one."""
        self.traced_again = 0
        """Passes that were opened, and are not done."""
        self.lost: list[NodeId] = []
        """In the order in which they were, each as often as it was;"""
        self.back: list[NodeId] = []
        """and those that came back."""
        self.took_s = 0.0
        """To begin the last time, from the loss on."""
        self._closed_before: int | None = None
        """While nobody traces."""

    @property
    def closed(self) -> int:
        """Passes that are closed, in all attempts; while nobody traces, as many as there were."""
        return self.base + self._told("closed") if self._closed_before is None else self._closed_before

    @property
    def _gathered(self) -> int:
        # The film itself says it, since who waits for a gathering may be cancelled once all of it has been added.
        return self._part().films.gathered

    async def gather(self, passes: Collection[int]) -> None:
        """Everybody's film into ours; `passes`: all that are in any of them. NodesLost, maybe in a group.

        Nobody's film changes before all have come. So if some have not, and nobody is lost, all are asked again.
        """
        until, pause_s = trio.current_time() + GATHER_S_MAX, GATHER_PAUSE_S
        while not await self._has_gathered(passes, is_last=trio.current_time() > until):
            await self._clock.sleep(pause_s)
            pause_s *= 2
        await self._company.tell({"gathered": self._gathered})

    async def _has_gathered(self, passes: Collection[int], *, is_last: bool) -> bool:
        company = self._company
        self._gatherings += 1
        failed = False
        try:
            async with company.watched():
                await self._part().gather(self._gatherings, passes)
        except* ScenefoldError as group:
            # Of a node in the middle of the line only its neighbour knows that it is lost.
            await company.look()
            if is_last or not all(map(is_away, leaves(group))):
                raise
            _log.warning("job %016x: films are gathered again: %s", self._job.id, next(leaves(group)))
            failed = True
        return not failed

    async def begin_again(self, change: NodesLost | NodesBack) -> None:
        """With those that are left, and those that are back, until all of them trace again. The error if that cannot be."""
        next_change: NodesLost | NodesBack | None = change
        self._closed_before = self.closed
        begun = trio.current_time()
        while next_change is not None:
            next_change = await or_changed(partial(self._begin, next_change))
        self._closed_before = None
        self.took_s = trio.current_time() - begun

    async def _begin(self, change: NodesLost | NodesBack) -> None:
        job, company = self._job, self._company
        opened, base = self._told("opened"), self.base
        if isinstance(change, NodesLost):
            self._check(change)
            company.roster = company.roster.changed(job, change.nodes, ())
            self.lost += sorted(change.nodes)
        else:
            company.roster = company.roster.changed(job, (), change.nodes)
            for node in change.nodes:
                company.is_back(node)
            self.back += sorted(change.nodes)
        roster = company.roster
        self._say(change)
        await company.tell({**roster.document(), "gathered": self._gathered})
        await company.look()
        ours, theirs = self._sets(roster.organiser)
        done = ours | theirs
        self.base, self.top = len(done), max(done, default=-1) + 1
        self.traced_again += max(0, opened - (len(done) - base))
        if theirs:
            await self.gather(theirs)
        after = await self._cells(roster)
        self.newest_epoch = after.epoch
        try:
            async with company.watched():
                await company.tell({"fetch": dict(after.to_document())}, PREPARE_S_MAX)
        except Exception as error:
            known = [one for one in _leaves(error) if isinstance(one, ScenefoldError)]
            if isinstance(change, NodesBack) and known and lost_of(error) is None:
                # It went without them before.
                raise NodesLost(change.nodes, known[0]) from None
            raise
        await company.tell({"begin": roster.attempt, "epoch": after.epoch, "done": bits_of(done, job.plan.count)})
        self.division, self._cells_of = after, roster.nodes

    async def _cells(self, roster: Roster) -> Division:
        """Those of before without the cells of who is lost, if that can be; with others, new ones for all."""
        epoch, dividing = self.newest_epoch + 1, self._dividing
        assert dividing is not None
        before = Standing(self.division, self._cells_of)
        if set(roster.nodes) <= set(self._cells_of):
            left = self.division.without([cell for cell, node in enumerate(self._cells_of) if node not in roster.nodes], epoch)
            if await dividing.can_be(Standing(left, roster.nodes), before):
                return left
        return (await dividing.fresh(roster.nodes, before)).with_epoch(epoch)

    def _say(self, change: NodesLost | NodesBack) -> None:
        words, count = ", ".join(map(address_of, sorted(change.nodes))), len(self._company.nodes)
        if isinstance(change, NodesLost):
            _log.warning("job %016x: lost %s (%s); %d of %d nodes go on", self._job.id, words, change.error, count, len(self._job.nodes))
        else:
            _log.warning("job %016x: %s are back; %d of %d nodes go on", self._job.id, words, count, len(self._job.nodes))

    def drop_scene(self) -> None:
        """There is no attempt any more, and none needs new cells."""
        self._dividing = None

    @property
    def missing(self) -> tuple[NodeId, ...]:
        """Nodes of the job that take no part at present."""
        return tuple(node for node in self._job.nodes if node not in self._company.nodes)

    def _sets(self, organiser: NodeId) -> tuple[frozenset[int], frozenset[int]]:
        """The passes in our film, and in all others. PeerFault if one is in two of them."""
        sets = {node: passes_of(self._company.done.get(node), self._job.plan.count) for node in self._company.nodes}
        ours = sets.pop(organiser)
        theirs: frozenset[int] = frozenset().union(*sets.values())
        if len(ours | theirs) != len(ours) + sum(map(len, sets.values())):
            raise PeerFault("two nodes have the same pass in their films")
        return ours, theirs

    def _check(self, lost: NodesLost) -> None:
        if self._company.roster.organiser in lost.nodes:
            raise lost.error

    def _told(self, name: str) -> int:
        counts = [self._company.states.get(node, {}).get(name) for node in self._company.nodes]
        return sum(count for count in counts if isinstance(count, int))


def _leaves(error: Exception) -> list[BaseException]:
    return list(leaves(error)) if isinstance(error, BaseExceptionGroup) else [error]


async def or_changed(do: Callable[[], Awaitable[None]]) -> NodesLost | NodesBack | None:
    """Do it; who was lost meanwhile, if that is why it failed, or else who is back."""
    try:
        await do()
    except Exception as error:
        change = lost_of(error) or back_of(error)
        if change is None:
            raise
        return change
    return None
