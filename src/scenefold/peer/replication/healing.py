"""What has rotted on this node's disk is fetched from others who have it (specs/20-copies.md, Healing).

A record whose header is left is known: that version, or a newer one, from whomever. Of a wreck nobody knows which version it was, and
it may have counted for an acknowledgement: so an owner hears all who may have it, and a holder its owner, before anything takes its place.

What nobody can be asked for is left as it is, and not read again: it is known to be rotten until something is written over it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace
from scenefold.peer.copies.versions import Rank, rank_of, told_version
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.receiving import verified
from scenefold.peer.records.copying import NotKept
from scenefold.peer.replication.comparing_space import Merge
from scenefold.peer.replication.healing_sources import Sources, sources_of
from scenefold.store import Put, PutResult, Spot
from scenefold.wire import ArcSum, CompareRange, FetchHeld, HeldFetched, ListedRecord, Member, RangeCompared, RecordEntry, Span
from scenefold.world import Priority

QUEUE_MAX = 4_096
"""Records that wait; what is beyond is met again."""
TRIES_MAX = 20
"""Of one record in a row, a minute or two; then it waits until it is met again."""
AGAIN_S = 300.0
"""What was given up is asked for again, if there is anybody to ask: who has it may be back, or may hold it only now."""
AGAIN_MAX = 256
DENIED_TRIES_MAX = 3
"""Where all have answered, and nobody could give it: they may just have been writing it."""
ASK_S_MAX = 10.0
GATE_S_MAX = 2.0
_FEW = 2

_log = logging.getLogger("scenefold.peer.replication")


class _Offer(NamedTuple):
    rank: Rank
    member: Member
    listed: ListedRecord


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
        self._tries: dict[Spot, int] = {}
        self._unhealed: dict[Spot, None] = {}
        self._wake = trio.Event()
        parts.store.tell_of_rot(self.rotten)
        parts.keeping.awaits = self._awaits
        parts.keeping.awaits_within = self._awaits_within

    @property
    def waiting(self) -> int:
        """Records that have rotted and are being fetched."""
        return len(self._tries)

    @property
    def unhealed(self) -> int:
        """Records that have rotted since the start and were given up, or that nobody else has: up to QUEUE_MAX of them."""
        self._forget_healed()
        return len(self._unhealed)

    def rotten(self, spot: Spot) -> None:
        """Fetch this from others, soon. What was given up is asked for again in its own time, however often it is met."""
        if spot not in self._unhealed and len(self._tries) < QUEUE_MAX:
            self._tries.setdefault(spot, 0)
            self._wake.set()

    async def _awaits(self, spot: Spot) -> bool:
        """Whether somebody may know what lay at a wreck: of all who do, not all have answered."""
        sources = await self._sources(spot)
        if sources is None or not (sources.sure or sources.all_of) or self._parts.store.noticed.is_given_up(spot):
            return False
        self._unhealed.pop(spot, None)
        self.rotten(spot)
        return True

    async def _awaits_within(self, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]) -> bool:
        """Likewise of any wreck that was met in these arcs."""
        met = [
            spot for spot in {**self._tries, **self._unhealed} if spot.place[:2] == (scene, space) and any(spot.home in arc for arc in arcs)
        ]
        headers = await self._parts.store.record_headers(met)
        return any([await self._awaits(spot) for spot, header in zip(met, headers, strict=True) if header is None])

    async def run(self) -> None:
        """Heal until cancelled, one record after the other: where there are many, a disk dies, and others are in a hurry."""
        pauses = Pauses(self._parts.world)
        while True:
            if not self._tries:
                self._wake = trio.Event()
                with trio.move_on_after(AGAIN_S) as patience:
                    await self._wake.wait()
                if patience.cancelled_caught:
                    await self._look_again()
            before = len(self._tries)
            for spot in list(self._tries):
                await self._try(spot)
            if self._tries and len(self._tries) >= before:
                await pauses.wait()
            else:
                pauses.reset()

    async def _try(self, spot: Spot) -> None:
        try:
            verdict = await self._heal(spot)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("a record that has rotted is not healed yet: %s", problem)
            verdict = _Verdict.NOT_NOW
        self._tries[spot] += 1
        tries_max = DENIED_TRIES_MAX if verdict is _Verdict.DENIED else TRIES_MAX
        if verdict is _Verdict.OVER or self._tries[spot] >= tries_max:
            if verdict is _Verdict.DENIED:
                self._parts.store.noticed.give_up(spot)
            if verdict is not _Verdict.OVER:
                self._parts.events["not healed"] += 1
                self._give_up(spot)
            del self._tries[spot]

    async def _look_again(self) -> None:
        """At what was given up, the longest time ago first. None of it is read for that."""
        self._forget_healed()
        for spot in list(self._unhealed)[:AGAIN_MAX]:
            has_sources = await self._sources(spot) is not None
            self._unhealed.pop(spot, None)
            if has_sources:
                self.rotten(spot)
            elif self._parts.keeper.holding.owns(spot.home):
                self._give_up(spot)

    def _forget_healed(self) -> None:
        noticed = self._parts.store.noticed
        self._unhealed = {spot: None for spot in self._unhealed if noticed.is_rotten(spot)}

    def _give_up(self, spot: Spot) -> None:
        if len(self._unhealed) < QUEUE_MAX:
            self._unhealed[spot] = None

    async def _heal(self, spot: Spot) -> _Verdict:
        parts = self._parts
        sources = await self._sources(spot)
        if sources is None:
            if parts.keeper.holding.owns(spot.home):
                self._give_up(spot)
            return _Verdict.OVER
        if not await self._is_rotten(spot):
            return _Verdict.OVER
        (header,) = await parts.store.record_headers([spot])
        if header is not None:
            known = rank_of(told_version(header))
            offers, have_all_answered = await self._offers(spot, sources.members)
            offers = [offer for offer in offers if offer.rank >= known]
        elif not isinstance((await parts.store.read([spot]))[0], DamagedData):
            # It was deleted.
            parts.store.noticed.gone([spot])
            return _Verdict.OVER
        else:
            # Nothing older than the newest that is named takes its place; who names it may have lost its bytes.
            heard, have_all_answered = await self._heard(spot, sources)
            offers = [offer for offer in heard if offer.rank == heard[0].rank]
        for offer in offers:
            try:
                is_healed = await self._take(spot, offer, sources)
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("a record that has rotted is not healed by one that has it: %s", problem)
                have_all_answered = False
                continue
            if is_healed:
                parts.events["healed"] += 1
                return _Verdict.OVER
        return _Verdict.DENIED if have_all_answered else _Verdict.NOT_NOW

    async def _is_rotten(self, spot: Spot) -> bool:
        """What is known to be rotten is not read once more."""
        store = self._parts.store
        return store.noticed.is_rotten(spot) or isinstance((await store.read([spot]))[0], DamagedData)

    async def _sources(self, spot: Spot) -> Sources | None:
        (debtors,) = await self._parts.store.debtors_of([spot])
        layout = await self._layout(spot)
        return sources_of(self._parts.keeper.copies, layout, spot, debtors, owns=self._parts.keeper.holding.owns(spot.home))

    async def _offers(self, spot: Spot, members: Sequence[Member]) -> tuple[list[_Offer], bool]:
        """Of those who answer, the newest first; whether all of them did."""
        offers: list[_Offer] = []
        answered = 0
        for member in members:
            with suppress(Refused, Unreachable, PeerFault):
                offer = await self._ask(spot, member)
                offers += [] if offer is None else [offer]
                answered += 1
        return _newest_first(offers), answered == len(members)

    async def _heard(self, spot: Spot, sources: Sources) -> tuple[list[_Offer], bool]:
        """What lay there or newer, of all who have it, the newest first; and whether all have answered. Refused if nobody knows what lay there."""
        told: list[_Offer | None] = []
        for member in sources.sure:
            with suppress(Refused, Unreachable, PeerFault):
                # Of a sure one that has nothing it has rotted as well.
                told.append(await self._ask(spot, member, must_know=not sources.is_own))
        named = [offer for offer in told if offer is not None]
        if named:
            # Those who are sure may have lost its bytes; whoever else has that version has what lay there.
            others, have_all_answered = await self._offers(spot, [member for member in sources.members if member not in sources.sure])
            least = max(offer.rank for offer in named)
            found = [offer for offer in (*named, *others) if offer.rank >= least]
            return _newest_first(found), have_all_answered and len(told) == len(sources.sure)
        if not told and not sources.all_of:
            raise Refused(RejectReason.NOT_READY, "nobody answers who is sure to have what lay there")
        heard = [await self._ask(spot, member) for member in sources.all_of]
        return _newest_first(offer for offer in heard if offer is not None), True

    async def _layout(self, spot: Spot) -> Layout | None:
        try:
            return (await self._parts.scenes.known(spot.place.scene, ask=False)).layouts.get(spot.place.space)
        except Refused:
            return None

    async def _ask(self, spot: Spot, member: Member, *, must_know: bool = False) -> _Offer | None:
        """What a member has there. Refused if it `must_know`, and does not say that it has all."""
        request = CompareRange(spot.place.scene, spot.place.space, (Span(spot.home, spot.home),), _FEW)
        reply = await self._parts.peers.ask(member.node, Priority.LOW, request, RangeCompared, ASK_S_MAX)
        (told,) = reply.sums if len(reply.sums) == 1 else (ArcSum(0, bytes(32), None, whole=False),)
        if told.records is None or (must_know and not told.whole):
            raise Refused(RejectReason.NOT_READY, "who should know does not say what lies there")
        found = next((listed for listed in told.records if listed.object == spot.object), None)
        return None if found is None else _Offer(rank_of(found.version), member, found)

    async def _take(self, spot: Spot, offer: _Offer, sources: Sources) -> bool:
        """Whether the record is sound now; it is not if all that came is a husk. Refused if nothing came, or there is no room for it."""
        parts, place = self._parts, spot.place
        entry = RecordEntry(place.scene, place.space, offer.listed.location, spot.object, offer.listed.version.digest)
        reply = await parts.peers.ask(offer.member.node, Priority.LOW, FetchHeld((entry,)), HeldFetched, ASK_S_MAX)
        asked = Spot(RecordPlace(place.scene, place.space, offer.listed.location), spot.object)
        items = [item for item in reply.items if Spot(RecordPlace(item.scene, item.space, item.location), item.object) == asked]
        if not items:
            raise Refused(RejectReason.NOT_READY, "who has it gives another version by now")
        parts.budget.charge(sum(len(item.ciphertext) for item in items))
        for verdict in await verified(parts, items[:1]):
            if isinstance(verdict, Put):
                await self._put(replace(verdict, at=place.location if spot.object else None), spot, sources)
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


def _newest_first(offers: Iterable[_Offer]) -> list[_Offer]:
    return sorted(offers, key=lambda offer: offer.rank, reverse=True)


def _require_room(results: Sequence[PutResult | NotKept]) -> None:
    if any(result.reason is RejectReason.STORAGE_FULL for result in results):
        raise Refused(RejectReason.STORAGE_FULL, "there is no room for the record")
