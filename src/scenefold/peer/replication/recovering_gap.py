"""Everybody is asked about one gap, and by name about single places of it, until all were heard (specs/20-copies.md, Recovery)."""

from __future__ import annotations

import logging
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.location import Arc, Location
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.receiving import keep_durably
from scenefold.peer.replication.recovering_hearing import Hearing
from scenefold.peer.replication.recovering_roll import Roll
from scenefold.wire import Member
from scenefold.world import first_of

HEARINGS_MAX = 16
"""Nodes that say at one time what they have: each has one page here."""
HUSKS_AT_ONCE = 1024
TRIES_LOUD = 6
"""Of a node that cannot be heard, before people are told what the gap waits for: some 10 s."""

_log = logging.getLogger("scenefold.peer.replication")


class Asking:
    """About one gap. Used from the Trio thread only."""

    def __init__(self, parts: Parts, gap: Arc) -> None:
        registry = parts.cluster_log.registry
        registered = [Member(node, found.incarnation) for node in registry.members if (found := registry.current(node)) is not None]
        self._parts = parts
        self._left_at = registry.left_at
        self._slots = trio.CapacityLimiter(HEARINGS_MAX)
        self._turn = trio.Lock()
        self._begun = trio.Event()
        self.roll = Roll(gap, registry.position, parts.own.member, registered)
        self._hearings = {member: Hearing(parts, self.roll, member, gap, self._turn) for member in self.roll.asked}

    async def run(self) -> None:
        """Return once nobody is missing any more."""
        # What only those know who were removed, somebody may be answered by as long as they hold a lease.
        await self._parts.world.clock.sleep(self._parts.leases_end_in_s(self._left_at) if self._left_at else 0.0)
        self._begun.set()
        async with trio.open_nursery() as nursery:
            for member in self.roll.asked:
                nursery.start_soon(self._hear_out, member)
        await self._keep_husks(self.roll.gap)

    async def look_up(self, place: Location) -> bool:
        """Whether all that anybody has at a place is here now. Takes as long as it takes."""
        await self._begun.wait()
        missing = self.roll.missing()
        if any(self._hearings[member].is_silent for member in missing):
            # In vain: all must be heard, and one of them is away.
            return False
        heard: list[Member] = []
        async with trio.open_nursery() as nursery:
            for member in missing:
                nursery.start_soon(self._hear_of, member, place, heard)
        if len(heard) < len(missing):
            return False
        try:
            await self._keep_husks(Arc(place, place))
        except Refused as problem:
            _log.debug("a place cannot be looked up: %s", problem)
            return False
        return True

    async def _keep_husks(self, arc: Arc) -> None:
        """What is left of versions that nobody could deliver: where nothing else lies it is known that something did."""
        husks = self.roll.husks(arc)
        for start in range(0, len(husks), HUSKS_AT_ONCE):
            await keep_durably(self._parts.store, husks[start : start + HUSKS_AT_ONCE])

    async def _hear_of(self, member: Member, place: Location, heard: list[Member]) -> None:
        try:
            await Hearing(self._parts, self.roll, member, Arc(place, place), trio.Lock()).hear()
            heard.append(member)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("a place cannot be looked up at %s: %s", address_of(member.node), problem)

    async def _hear_out(self, member: Member) -> None:
        hearing = self._hearings[member]
        pauses = Pauses(self._parts.world)
        while not self._parts.keeper.is_removed(member):
            try:
                async with self._slots:
                    entries = await hearing.hear()
                self.roll.hear(member, entries)
                return
            except (Refused, Unreachable, PeerFault) as problem:
                level = logging.WARNING if pauses.count == TRIES_LOUD else logging.DEBUG
                _log.log(
                    level, "what was acknowledged in an adopted arc is not known until %s is heard: %s", address_of(member.node), problem
                )
            await first_of(pauses.wait, partial(self._removed, member))
        removal = self._parts.cluster_log.registry.removal(member.incarnation)
        assert removal is not None
        await self._parts.world.clock.sleep(self._parts.leases_end_in_s(removal.position))
        self.roll.lose(member)

    async def _removed(self, member: Member) -> None:
        while not self._parts.keeper.is_removed(member):
            await self._parts.cluster_log.changed_after(self._parts.cluster_log.registry.position)
