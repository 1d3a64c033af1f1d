"""What has rotted on this node's disk is fetched from others who have it (specs/20-copies.md, Healing).

A record whose header is left is known: that version, or a newer one, from whomever. Of a wreck nobody knows which version it was, and
it may have counted for an acknowledgement: so an owner hears all who may have it, and a holder its owner, before anything takes its place.
If it is owed to somebody the debt says which version it was. Once all have answered and nobody could give it, nothing is owed any more.

What nobody can be asked for is left as it is, and not read again: it is known to be rotten until something is written over it
(healing_given_up.py).
"""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum
from functools import partial
from itertools import accumulate, islice

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordHeader, RecordPlace, version_of
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.versions import rank_of, told_version
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.receiving import verified
from scenefold.peer.line.unsettled import name_of
from scenefold.peer.records.copying import NotKept
from scenefold.peer.replication.comparing_space import Merge
from scenefold.peer.replication.healing_asking import ASK_S_MAX, Asking, Offer
from scenefold.peer.replication.healing_given_up import GivenUp
from scenefold.peer.replication.healing_sources import Sources, sources_of
from scenefold.store import Put, PutResult, Spot
from scenefold.store.debts import Debt
from scenefold.wire import FetchHeld, HeldFetched, Member, RecordEntry
from scenefold.world import Priority, first_of

QUEUE_MAX = 4_096
"""Records that are asked for in one go. What is beyond is known to the store, and asked for after these."""
TRIES_MAX = 20
"""Of one record in a row, a minute or two; then it waits until it is met again."""
AGAIN_S = 300.0
"""What was given up is asked for again, if there is anybody to ask: who has it may be back, or may hold it only now."""
STEPS_S = 1.0
"""Holders change in several steps; one look at what was given up is enough for these."""
DENIED_TRIES_MAX = 3
"""Where all have answered, and nobody could give it: they may just have been writing it."""
GATE_S_MAX = 2.0

_log = logging.getLogger("scenefold.peer.replication")


class _Verdict(Enum):
    """What became of one try."""

    OVER = 1
    """It is sound again, or there is nobody to ask."""
    NOT_NOW = 2
    """Somebody who may have it did not answer."""
    DENIED = 3
    """All have answered."""


class Healing:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, merge: Merge) -> None:
        """`merge`: into this node's own arc."""
        self._parts = parts
        self._merge = merge
        self._asking = Asking(parts)
        self._tries: dict[Spot, int] = {}
        self._asked: dict[Spot, Sources | None] = {}
        """Who could be asked when that began."""
        self._given_up = GivenUp(parts)
        self._wake = trio.Event()
        parts.store.tell_of_rot(self.rotten)
        parts.keeping.awaits = self._awaits
        parts.keeping.awaits_within = self._awaits_within

    @property
    def waiting(self) -> int:
        """Records that have rotted and are being fetched, or will be."""
        self._given_up.forget_healed()
        return max(len(self._tries), len(self._parts.store.noticed) - len(self._given_up))

    @property
    def unhealed(self) -> int:
        """Records that have rotted since the start and were given up, or that nobody else has."""
        return self._given_up.count

    @property
    def has_more(self) -> bool:
        """Whether more have rotted than are remembered, so that nobody knows how many wait, or are not to be had."""
        return self._parts.store.noticed.has_more

    def rotten(self, spot: Spot) -> None:
        """Fetch this from others, soon. What was given up is asked for again in its own time, however often it is met."""
        spot = self._parts.store.noticed.known(spot)
        if not self._given_up.is_kept(spot) and len(self._tries) < QUEUE_MAX:
            self._tries.setdefault(spot, 0)
            self._wake.set()

    async def _awaits(self, spot: Spot) -> bool:
        """Whether somebody may know what lay at a wreck: of all who do, not all have answered."""
        sources = await self._sources(spot)
        if sources is None or not (sources.sure or sources.all_of) or self._parts.store.noticed.is_given_up(spot):
            return False
        self._given_up.pop(self._parts.store.noticed.known(spot))
        self.rotten(spot)
        return True

    async def _awaits_within(self, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]) -> bool:
        """Likewise of any wreck that was met in these arcs."""
        tried = [spot for spot in self._tries if spot.place[:2] == (scene, space)]
        known = dict.fromkeys((*tried, *self._parts.store.noticed.within(scene, space)))
        inside = _inside(arcs)
        met = [spot for spot in known if inside(spot.home)]
        headers = await self._parts.store.record_headers(met)
        is_awaited = False
        for spot in [spot for spot, header in zip(met, headers, strict=True) if header is None]:
            # Of those that were given up each is asked for again; all others are asked for anyway.
            if not is_awaited or spot in self._given_up:
                is_awaited |= await self._awaits(spot)
        return is_awaited

    async def run(self) -> None:
        """Heal until cancelled, one record after the other: where there are many, a disk dies, and others are in a hurry."""
        pauses = Pauses(self._parts.world)
        keeper = self._parts.keeper
        seen, again_at = keeper.copies, trio.current_time() + AGAIN_S
        while True:
            if not self._tries:
                self._refill()
            if not self._tries:
                await self._something_new(seen, again_at)
            is_time = trio.current_time() >= again_at
            if is_time or keeper.copies is not seen:
                seen = keeper.copies
                again_at = trio.current_time() + AGAIN_S if is_time else again_at
                await self._look_again(is_time=is_time)
            before = len(self._tries)
            for spot in list(self._tries):
                await self._try(spot)
            if self._tries and len(self._tries) >= before:
                await pauses.wait()
            else:
                pauses.reset()

    def _refill(self) -> None:
        """Go on with what was met while too many others were asked for. What was given up is left for its time."""
        left = (spot for spot in self._parts.store.noticed.spots() if spot not in self._given_up)
        self._tries = dict.fromkeys(islice(left, QUEUE_MAX), 0)

    async def _something_new(self, seen: Copies, again_at: float) -> None:
        """Return once something is met, it is time to ask again, or others than before may hold what was given up."""
        self._wake = trio.Event()
        with trio.move_on_at(again_at):
            if self._given_up:
                await first_of(self._wake.wait, partial(self._others_after, seen))
            else:
                await self._wake.wait()

    async def _others_after(self, seen: Copies) -> None:
        await self._parts.keeper.copies_changed_after(seen)
        await self._parts.world.clock.sleep(STEPS_S)

    async def _look_again(self, *, is_time: bool) -> None:
        """At what others may have by now, and, when it is time, at all that was given up, the longest time ago first. None of it is read for that."""
        for spot in await self._given_up.due(is_time=is_time):
            who = self._given_up.who(spot)
            self._given_up.pop(spot)
            if who is None:
                self._given_up.add(spot, None)
            else:
                self.rotten(spot)

    async def _try(self, spot: Spot) -> None:
        self._asked.setdefault(spot, self._given_up.who(spot))
        try:
            verdict = await self._heal(spot)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("a record that has rotted is not healed yet: %s", problem)
            verdict = _Verdict.NOT_NOW
        self._tries[spot] += 1
        tries_max = DENIED_TRIES_MAX if verdict is _Verdict.DENIED else TRIES_MAX
        if verdict is _Verdict.OVER or self._tries[spot] >= tries_max:
            if verdict is _Verdict.DENIED:
                self._given_up.lose(spot, await self._debt(spot))
            if verdict is not _Verdict.OVER:
                self._parts.events["not healed"] += 1
                self._given_up.add(spot, self._asked[spot])
            del self._tries[spot], self._asked[spot]

    async def _heal(self, spot: Spot) -> _Verdict:
        parts = self._parts
        sources = await self._sources(spot)
        if sources is None:
            self._given_up.add(spot, None)
            return _Verdict.OVER
        if not await self._is_rotten(spot):
            return _Verdict.OVER
        debt: Debt | None = None
        older: list[Offer] = []
        (header,) = await parts.store.record_headers([spot])
        known = None if header is None else rank_of(told_version(header))
        if known is not None:
            heard, have_all_answered = await self._asking.offers(spot, sources.members, enough=known)
            if not have_all_answered and any(offer.rank >= known for offer in heard):
                await self._take_one(spot, [offer for offer in heard if offer.rank >= known], sources, None)
                if not await self._is_rotten(spot):
                    parts.events["healed"] += 1
                    return _Verdict.OVER
                # Who was the first to offer it could not give it: then all are heard.
                heard, have_all_answered = await self._asking.offers(spot, sources.members)
            offers = [offer for offer in heard if offer.rank >= known]
            older = [offer for offer in heard if offer.rank < known]
        elif not isinstance((await parts.store.read([spot]))[0], DamagedData):
            # It was deleted.
            parts.store.noticed.gone([spot])
            return _Verdict.OVER
        else:
            # Nothing older than the newest that is named takes its place; who names it may have lost its bytes.
            debt = await self._debt(spot) if sources.is_own else None
            heard, have_all_answered, debt = await self._asking.heard(spot, sources, debt)
            offers = [offer for offer in heard if debt is not None or offer.rank == heard[0].rank]
        have_all_answered &= await self._take_one(spot, offers, sources, debt)
        if have_all_answered and sources.is_own and self._is_to_be_given_up(spot) and await self._is_rotten(spot):
            # Somebody else may have it as a stray. Who does not answer brings it home later.
            least = known if known is not None else offers[0].rank if offers and debt is None else None
            strays = await self._asking.anywhere(spot, self._all_but(sources.members))
            fitting = [offer for offer in strays if least is None or offer.rank >= least]
            have_all_answered &= await self._take_one(spot, fitting, sources, debt)
        if have_all_answered and sources.is_nowhere_else and self._is_last_try(spot):
            # It was never acknowledged, and nobody got it since: the newest that they have is what counted before.
            if debt is not None:
                have_all_answered &= await self._take_one(spot, _newest(offers), sources, None)
            elif header is not None and await self._is_rotten(spot) and await self._is_told_to_nobody(spot, header):
                have_all_answered &= await self._take_one(spot, _newest(older), sources, None, RecordHeader.decode(header))
        if not await self._is_rotten(spot):
            parts.events["healed"] += 1
            return _Verdict.OVER
        return _Verdict.DENIED if have_all_answered else _Verdict.NOT_NOW

    def _is_last_try(self, spot: Spot) -> bool:
        """Whether it is given up now, if all have answered, and nobody could give it."""
        return self._tries.get(spot, 0) + 1 >= DENIED_TRIES_MAX

    def _is_to_be_given_up(self, spot: Spot) -> bool:
        """Likewise, for the first time."""
        return self._is_last_try(spot) and not self._parts.store.noticed.is_given_up(spot)

    def _all_but(self, members: Sequence[Member]) -> list[Member]:
        """All others that are registered."""
        registry, asked = self._parts.cluster_log.registry, {self._parts.own.me, *(member.node for member in members)}
        found = [registry.current(node) for node in registry.members if node not in asked]
        return [registered.member for registered in found if registered is not None]

    async def _is_told_to_nobody(self, spot: Spot, header: bytes) -> bool:
        """Whether this version is owed, unsettled, and waited for by no writer; and nothing else of it, or newer, is on its way."""
        if self._parts.store.noticed.is_given_up(spot):
            # Whoever was owed it has got what is left of it since.
            return False
        version, debt = version_of(header), await self._debt(spot)
        pendings = self._parts.unsettled.of(name_of(spot))
        are_left = all(pending.version == version and pending.is_stored and not pending.is_write for pending in pendings)
        return bool(pendings) and are_left and debt is not None and debt.version == version

    async def _take_one(
        self, spot: Spot, offers: Sequence[Offer], sources: Sources, debt: Debt | None, instead_of: RecordHeader | None = None
    ) -> bool:
        """Heal it by the first that is whole; False if one of those before, or of all, did not answer."""
        have_all_answered = True
        for offer in offers:
            try:
                if await self._take(spot, offer, sources, debt, instead_of):
                    break
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("a record that has rotted is not healed by one that has it: %s", problem)
                have_all_answered = False
        return have_all_answered

    async def _is_rotten(self, spot: Spot) -> bool:
        """What is known to be rotten is not read once more."""
        store = self._parts.store
        return store.noticed.is_rotten(spot) or isinstance((await store.read([spot]))[0], DamagedData)

    async def _sources(self, spot: Spot) -> Sources | None:
        debt, layout = await self._debt(spot), await self._layout(spot)
        debtors = () if debt is None else debt.nodes
        return sources_of(self._parts.keeper.copies, layout, spot, debtors, owns=self._parts.keeper.holding.owns(spot.home))

    async def _debt(self, spot: Spot) -> Debt | None:
        """What is owed of it, or was when it was given up: which version lay there, and who lacks it."""
        lost = self._given_up.debt(spot)
        if lost is not None:
            return lost
        (debt,) = await self._parts.store.debts_of([spot])
        return debt

    async def _layout(self, spot: Spot) -> Layout | None:
        try:
            return (await self._parts.scenes.known(spot.place.scene, ask=False)).layouts.get(spot.place.space)
        except Refused:
            return None

    async def _take(self, spot: Spot, offer: Offer, sources: Sources, debt: Debt | None, instead_of: RecordHeader | None) -> bool:
        """Whether the record is sound now; it is not if all that came is a husk. Refused if nothing came, or there is no room for it."""
        parts, place = self._parts, spot.place
        entry = RecordEntry(place.scene, place.space, offer.listed.location, spot.object, offer.listed.version.digest)
        reply = await parts.peers.ask(offer.member.node, Priority.LOW, FetchHeld((entry,)), HeldFetched, ASK_S_MAX)
        asked = Spot(RecordPlace(place.scene, place.space, offer.listed.location), spot.object)
        items = [item for item in reply.items if Spot(RecordPlace(item.scene, item.space, item.location), item.object) == asked]
        if not items:
            raise Refused(RejectReason.NOT_READY, "who has it gives another version by now")
        parts.budget.charge(sum(len(item.ciphertext) for item in items))
        if debt is not None and version_of(items[0].header) != debt.version:
            return False
        for verdict in await verified(parts, items[:1]):
            if isinstance(verdict, Put):
                await self._put(replace(verdict, at=place.location if spot.object else None, instead_of=instead_of), spot, sources)
        return not await self._is_rotten(spot)

    async def _put(self, put: Put, spot: Spot, sources: Sources) -> None:
        parts = self._parts
        if not sources.is_own:
            # As a stray it would be as good.
            _require_room(await parts.store.merge([put]))
            return
        with trio.move_on_after(GATE_S_MAX) as patience:
            async with parts.writing([spot.home], anywhere=bool(spot.object)):
                patience.deadline = float("inf")
                if not parts.keeper.holding.owns(spot.home):
                    raise Refused(RejectReason.NOT_MY_LOCATION, "the place is not this node's any more")
                _require_room(await self._merge([put]))


def _inside(arcs: Sequence[Arc]) -> Callable[[Location], bool]:
    """Whether a place lies in any of these: of many wrecks and many arcs not each is held against each."""
    ordered = sorted(arcs, key=lambda arc: arc.first)
    firsts, lasts = [arc.first for arc in ordered], list(accumulate((arc.last for arc in ordered), max))

    def is_inside(home: Location) -> bool:
        behind = bisect_right(firsts, home)
        return behind > 0 and home <= lasts[behind - 1]

    return is_inside


def _newest(offers: Sequence[Offer]) -> list[Offer]:
    return [offer for offer in offers if offer.rank == offers[0].rank]


def _require_room(results: Sequence[PutResult | NotKept]) -> None:
    if any(result.reason is RejectReason.STORAGE_FULL for result in results):
        raise Refused(RejectReason.STORAGE_FULL, "there is no room for the record")
