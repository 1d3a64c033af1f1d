"""What was acknowledged in a gap is learnt, before this node speaks for it (specs/20-copies.md, Recovery).

A gap is unrecovered on the disk from the change on that made it this node's, so whoever is started anew begins again: nothing is lost by
that but time. Until a gap is recovered, single places of it are looked up by name as they are asked for.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence

import trio

from scenefold.base.cover import without
from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.losses import Loss
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.replication.placing_wishes import needed_of
from scenefold.peer.replication.recovering_gap import Asking
from scenefold.wire import Member

LOOK_UPS_MAX = 8
"""Places that are looked up at one time, each at every node."""
LOOK_UPS_OF_ONE_MAX = 4
"""Of these of one question, however many places it names: others have but 2 s for theirs, and take turns with it."""
LOOKED_UP_MAX = 65_536
"""Places remembered as looked up. Beyond it the oldest are looked up again."""

_log = logging.getLogger("scenefold.peer.replication")


class Recovering:
    """Used from the Trio thread only. `doubt`: told of a gap that is about to be recovered: nothing in it has settled yet; `known`: told once one is."""

    def __init__(self, parts: Parts, note: Callable[[Sequence[Loss]], Awaitable[None]]) -> None:
        """`note`: keep durably what may be lost."""
        self._parts = parts
        self._note = note
        self.doubt: Callable[[Arc], object] = lambda _: None
        self.known: Callable[[], object] = lambda: None
        self._askings: dict[Arc, Asking | None] = {}
        """Of each gap that is being recovered; None in a pause."""
        self._older: tuple[Arc, ...] = ()
        """Gaps of before the start: what was held there nobody remembers."""
        self._looked_up: dict[Location, None] = {}
        self._slots = trio.CapacityLimiter(LOOK_UPS_MAX)
        self._crowding: dict[Arc, list[tuple[Member, int]]] = {}
        """Of gaps in which more pieces are named than can be kept."""

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is to be recovered."""
        return not self._parts.keeper.copies.unrecovered

    @property
    def crowding(self) -> dict[NodeId, int]:
        """Who has named the most pieces, where that many are named in a gap that it cannot be recovered; and how many."""
        found: dict[NodeId, int] = {}
        for named in self._crowding.values():
            for member, count in named:
                found[member.node] = max(count, found.get(member.node, 0))
        return found

    def is_known(self, location: Location) -> bool:
        """Whether all that was acknowledged at a place of the arc is here, as far as registered nodes have it."""
        return location in self._looked_up or self._parts.keeper.copies.is_recovered(Arc(location, location))

    def part_of(self, piece: Arc) -> tuple[Arc, bool]:
        """What of it, from its first place on, is recovered or is not, and which of both."""
        return self._parts.keeper.copies.recovered_part(piece)

    async def look_up(self, locations: Sequence[Location], until: float) -> None:
        """Ask everybody about those places that are not known, until they are, or it is in vain at this moment."""
        unknown = [location for location in dict.fromkeys(locations) if not self.is_known(location)]
        if not unknown:
            return
        left = iter(unknown)
        with trio.CancelScope(deadline=until):
            async with trio.open_nursery() as nursery:
                for _ in range(min(LOOK_UPS_OF_ONE_MAX, len(unknown))):
                    nursery.start_soon(self._look_up_all, left)

    async def _look_up_all(self, left: Iterator[Location]) -> None:
        for location in left:
            await self._look_up(location)

    async def _look_up(self, location: Location) -> None:
        async with self._slots:
            asking = next((asking for gap, asking in self._askings.items() if location in gap), None)
            if asking is None or self.is_known(location) or not await asking.look_up(location):
                return
        if self._askings.get(asking.roll.gap) is asking:
            self._looked_up[location] = None
            if len(self._looked_up) > LOOKED_UP_MAX:
                del self._looked_up[next(iter(self._looked_up))]

    # ------------------------------------------------------------------------------------------------------ doing

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Recover whatever is not, until cancelled."""
        keeper = self._parts.keeper
        self._older = keeper.copies.unrecovered
        async with trio.open_nursery() as nursery:
            task_status.started()
            while True:
                copies = keeper.copies
                for gap in _apart(copies.unrecovered, self._askings):
                    self._askings[gap] = None
                    nursery.start_soon(self._recover, gap)
                await keeper.copies_changed_after(copies)

    async def _recover(self, gap: Arc) -> None:
        pauses = Pauses(self._parts.world)
        try:
            while not await self._try(gap):
                await pauses.wait()
        finally:
            del self._askings[gap]
            self._crowding.pop(gap, None)

    async def _try(self, gap: Arc) -> bool:
        asking = self._askings[gap] = Asking(self._parts, gap)
        # What is looked up meanwhile must not be told either as long as nobody knows by whom else it was to be had.
        self.doubt(gap)
        try:
            await asking.run()
            # There may be scenes that were not known here before.
            self.doubt(gap)
            losses = self._losses(asking)
            # Before the gap counts as recovered: else a crash in between would leave it unsaid.
            await self._note(losses)
            await self._parts.keeper.change_copies(lambda copies, _: asking.roll.recover(copies))
        except Refused as problem:
            # The disk is full, this life is ending, or somebody says that he holds more than all can: what is true of it nobody knows.
            self._crowding[gap] = asking.roll.loudest() if problem.reason is RejectReason.LIMIT_EXCEEDED else []
            self._parts.events["not recovered"] += 1
            _log.warning("what was learnt of an adopted arc cannot be kept: %s%s", problem, _who(self._crowding[gap]))
            return False
        finally:
            # Known are these places now by the note, or by nobody any more.
            self._askings[gap] = None
            self._looked_up = {location: None for location in self._looked_up if location not in gap}
        self._older = tuple(left for older in self._older for left in without(older, gap))
        self._parts.events["recovered"] += 1
        self.known()
        where = f"{gap.first.hex()[:8]}..{gap.last.hex()[:8]}"
        if losses:
            _log.warning("not all that was acknowledged in %s may be known: %s", where, "; ".join(map(_in_words, losses)))
        else:
            _log.info("all that was acknowledged in %s, in spaces with copies, is known", where)
        return True

    def _losses(self, asking: Asking) -> list[Loss]:
        parts, registry = self._parts, self._parts.cluster_log.registry
        layouts = needed_of(parts.scenes.everyone(), len(registry.order))
        remembers = all(gap.intersection(asking.roll.gap) is None for gap in self._older)
        return asking.roll.losses(parts.keeper.copies, layouts, registry, remembers=remembers)


def _in_words(loss: Loss) -> str:
    left = "one complete copy or more is left, and what was acknowledged last may be lost" if loss.is_left else "no complete copy is left"
    names = ", ".join(address_of(member.node) for member in loss.removed)
    return f"on {loss.share:.2%} of the line, in spaces with {loss.copies} copies, {left} (removed: {names})"


def _who(named: Sequence[tuple[Member, int]]) -> str:
    told = ", ".join(f"{address_of(member.node)} ({count})" for member, count in named)
    return f"; most pieces were named by {told}: one that cannot hold so many is lying, and may be revoked" if told else ""


def _apart(gaps: Sequence[Arc], taken: Iterable[Arc]) -> list[Arc]:
    left = list(gaps)
    for other in taken:
        left = [part for gap in left for part in without(gap, other)]
    return left
