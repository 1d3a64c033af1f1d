"""One space is compared with one holder, and both get what they lack (specs/20-copies.md, Repair).

The owner drives it, so it knows itself when the holder lacks nothing but what is owed to it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import replace

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId, address_of
from scenefold.base.limits import COMPARED_RECORDS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordPlace, version_of, wanted_place
from scenefold.peer.copies.versions import rank_of, told_sum, told_version
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.receiving import verified
from scenefold.peer.records.copying import NotKept
from scenefold.peer.records.verification import home_of
from scenefold.peer.replication.comparing_dialogue import Dialogue, Key, Known, Part, Question
from scenefold.peer.replication.comparing_progress import Progress
from scenefold.peer.replication.lane import item_of
from scenefold.store import Outcome, Put, PutResult, Spot
from scenefold.wire import (
    ArcSum,
    CompareRange,
    CopiesStored,
    FetchHeld,
    HandItem,
    HeldFetched,
    Member,
    RangeCompared,
    RecordEntry,
    Span,
    StoreCopies,
)
from scenefold.world import Priority

ASK_S_MAX = 10.0
SEND_S_MAX = 30.0
GATE_S_MAX = 2.0
"""For a place to thaw; what was to be taken there is found again."""
SEND_BYTES_MAX = 2 * 1024 * 1024
"""Of one StoreCopies: a quarter of a frame, so that other requests on the connection need not wait long."""
SEND_BYTES_MIN = 64 * 1024
SEND_S = 0.25
"""Under a small budget a part is what may be sent in this time, so that it flows instead of coming in bursts."""
SEND_RECORDS_MAX = 1_024
FLIGHTS = 3
FETCH_RECORDS = 64
ENTRY_BYTES = 128
"""About what an entry of a list costs on the wire."""

Merge = Callable[[Sequence[Put]], Awaitable[Sequence[PutResult | NotKept]]]
"""Take copies into this node's own arc, so that all holders get them, and wait for none of these."""


class HolderFull(Refused):
    """The holder has no room for what it lacks."""


class _NoRoomHere(Refused):
    """What the holder has newer cannot be kept here."""


class SpaceComparison:
    """Used from the Trio thread only."""

    def __init__(
        self, parts: Parts, merge: Merge, progress: Progress, holder: Member, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]
    ) -> None:
        self._parts = parts
        self._merge = merge
        self._progress = progress
        self._holder = holder
        self._scene, self._space = scene, space
        self._arcs = arcs
        self._complete = self._has_room = True
        self.can_rest = False
        """Whether to break off, between two questions or batches, once this node is told to rest."""
        self.has_new_husks = False
        """Whether this owner has learnt of versions that nobody can be given: other holders have to learn of them too."""

    async def run(self) -> bool:
        """Whether the holder has all that lay here when this began. Refused, Unreachable or PeerFault: not now."""
        dialogue = Dialogue(self._arcs)
        unremembered = self._unremembered()
        is_first = True
        try:
            while (question := dialogue.question()) is not None:
                self._check_rest()
                # In this order: what is written later is owed to the holder.
                own = await self._own(question)
                found = dialogue.answer(own, await self._theirs(question))
                if is_first:
                    self._progress.begin(self, dialogue.missing)
                    is_first = False
                if self._has_room:
                    await self._bring(found.newer)
                await self._send_all(found.lacking)
        finally:
            self._progress.end(self)
        # What lay there only others know, the holder perhaps not among them: it is not compared with what this owner has not.
        is_all_known = self._complete and self._unremembered() == unremembered
        return is_all_known and not await self._parts.keeping.awaits_within(self._scene, self._space, self._arcs)

    def _unremembered(self) -> int:
        """How often something has rotted past knowing, beyond all of which it is known who was asked."""
        return self._parts.store.noticed.unremembered(self._scene, self._space)

    def _check_rest(self) -> None:
        if self.can_rest and self._parts.resting.repair:
            raise Refused(RejectReason.BUSY, "repair is paused at this node")

    # ------------------------------------------------------------------------------------------------- questions

    async def _own(self, question: Question) -> list[Part]:
        store = self._parts.store
        if not question.lists:
            sums = await store.sums(self._scene, self._space, question.arcs)
            return [Part(total.records, told_sum(total)) for total in sums]
        parts: list[Part] = []
        for arc in question.arcs:
            listing = await store.listing(self._scene, self._space, arc, COMPARED_RECORDS_MAX)
            sound = [held for held in listing.records if held.version]
            records = {(held.home, held.spot.object): Known(rank_of(told_version(held.header)), held.spot, held.size) for held in sound}
            # Lists are compared one by one, whatever they add up to.
            parts.append(Part(len(sound), b"", records if listing.complete else None))
        return parts

    async def _theirs(self, question: Question) -> list[Part]:
        spans = tuple(Span(arc.first, arc.last) for arc in question.arcs)
        request = CompareRange(self._scene, self._space, spans, COMPARED_RECORDS_MAX if question.lists else 0)
        reply = await self._parts.peers.ask(self._holder.node, Priority.LOW, request, RangeCompared, ASK_S_MAX)
        self._parts.budget.charge(ENTRY_BYTES * sum(1 + len(told.records or ()) for told in reply.sums))
        return [self._part(told) for told in reply.sums]

    def _part(self, told: ArcSum) -> Part:
        if told.records is None:
            return Part(told.count, told.sum)
        records: dict[Key, Known] = {}
        for listed in told.records:
            home = wanted_place(listed.object) if listed.object else listed.location
            spot = Spot(RecordPlace(self._scene, self._space, listed.location), listed.object)
            records[home, listed.object] = Known(rank_of(listed.version), spot)
        return Part(told.count, told.sum, records)

    # --------------------------------------------------------------------------------------------------- sending

    def _batches(self, records: Sequence[Known]) -> Iterator[list[Known]]:
        bytes_max = min(max(self._parts.budget.bytes_per_s * SEND_S, SEND_BYTES_MIN), SEND_BYTES_MAX)
        batch: list[Known] = []
        size = 0
        for known in records:
            if batch and (size + known.size > bytes_max or len(batch) == SEND_RECORDS_MAX):
                yield batch
                batch, size = [], 0
            batch.append(known)
            size += known.size
        if batch:
            yield batch

    async def _send_all(self, records: Sequence[Known]) -> None:
        """A few batches at a time: while one is written there, the next is verified, and one is read here."""
        batches = self._batches(records)
        problems: list[Refused | Unreachable | PeerFault] = []

        async def fly() -> None:
            for batch in batches:
                try:
                    self._check_rest()
                    with self._parts.carrying.begun():
                        await self._send(batch)
                except (Refused, Unreachable, PeerFault) as problem:
                    problems.append(problem)
                if problems:
                    return

        async with trio.open_nursery() as nursery:
            for _ in range(min(FLIGHTS, len(records))):
                nursery.start_soon(fly)
        if problems:
            raise problems[0]

    async def _send(self, batch: Sequence[Known]) -> None:
        """The holder has these, or newer ones, durably; or the comparison is not complete."""
        parts = self._parts
        found = await parts.store.read([known.spot for known in batch])
        # What has slid or was written over meanwhile is met again, or owed.
        self._complete = self._complete and all(record is not None for record in found)
        sound = [(known.spot, record) for known, record in zip(batch, found, strict=True) if isinstance(record, Record)]
        rotten = [known.spot for known, record in zip(batch, found, strict=True) if isinstance(record, DamagedData)]
        husks = await self._husks(rotten) if rotten else []
        if not (sound or husks):
            return
        items = tuple(item_of(spot, record) for spot, record in (*sound, *husks))
        size = sum(_size(item) for item in items)
        await parts.budget.take(size)
        request = StoreCopies(parts.own.member, items)
        reply = await parts.peers.ask(self._holder.node, Priority.LOW, request, CopiesStored, SEND_S_MAX)
        if len(reply.reasons) != len(items):
            raise PeerFault("a holder answered for another number of records", where=address_of(self._holder.node))
        self._progress.sent(self, len(items), size)
        taken = [one for one, reason in zip(sound, reply.reasons, strict=False) if not reason]
        parts.events["copies sent"] += len(taken)
        parts.events["copied bytes"] += size
        if self._holder.node in parts.store.owed:
            await parts.store.paid([(spot, version_of(record.header_bytes), self._holder.node) for spot, record in taken])
        # Where something older is sound nothing is lost for what cannot be had any more.
        lost = [reason for reason in reply.reasons[len(sound) :] if reason != RejectReason.DAMAGED]
        refused = next((reason for reason in (*reply.reasons[: len(sound)], *lost) if reason), 0)
        if refused == RejectReason.STORAGE_FULL:
            raise HolderFull(RejectReason.STORAGE_FULL, reply.text or "the holder's disk is full")
        if refused:
            raise Refused(RejectReason(refused), reply.text or "the holder does not take it")

    async def _husks(self, rotten: Sequence[Spot]) -> list[tuple[Spot, Record]]:
        """What is left of what nobody can be given: the holder shall not say that there was nothing. What is owed to it anyway is left out."""
        store = self._parts.store
        owed = await store.debtors_of(rotten)
        lacking = [spot for spot, nodes in zip(rotten, owed, strict=True) if self._holder.node not in nodes]
        found = await store.remains(lacking)
        return [(spot, husk) for spot, husk in zip(lacking, found, strict=True) if husk is not None]

    # -------------------------------------------------------------------------------------------------- fetching

    async def _bring(self, newer: Sequence[Known]) -> None:
        """Whatever the holder has newer, or alone: the highest version counts, whoever has it."""
        try:
            for start in range(0, len(newer), FETCH_RECORDS):
                wanted = await self._wanted(newer[start : start + FETCH_RECORDS])
                while wanted:
                    wanted = wanted[await self._fetch(wanted) :]
        except _NoRoomHere:
            # What the holder lacks can be brought to it all the same.
            self._has_room = self._complete = False

    async def _wanted(self, named: Sequence[Known]) -> list[Known]:
        """Those that are newer than what lies here. Where nobody knows what lay, other members have to be heard first (healing.py)."""
        spots = [known.spot for known in named]
        headers = await self._parts.store.record_headers(spots)
        unknown = [spot for spot, header in zip(spots, headers, strict=True) if header is None]
        found = await self._parts.store.read(unknown) if unknown else []
        wrecks = {spot for spot, record in zip(unknown, found, strict=True) if record is not None}
        # Some of it came from here in the meantime.
        return [
            known
            for known, header in zip(named, headers, strict=True)
            if (known.spot not in wrecks if header is None else rank_of(told_version(header)) < known.rank)
        ]

    async def _fetch(self, wanted: Sequence[Known]) -> int:
        """How many of the first of these were answered for."""
        entries = tuple(RecordEntry(*known.spot.place, known.spot.object, known.rank[-1]) for known in wanted)
        reply = await self._parts.peers.ask(self._holder.node, Priority.LOW, FetchHeld(entries), HeldFetched, SEND_S_MAX)
        answered = len(reply.items) + len(reply.missing)
        if not 1 <= answered <= len(wanted):
            raise PeerFault("records that nobody asked for", where=address_of(self._holder.node))
        size = sum(map(_size, reply.items))
        self._parts.budget.charge(size)
        self._parts.events["fetched bytes"] += size
        asked = {known.spot for known in wanted}
        items = [item for item in reply.items if Spot(RecordPlace(item.scene, item.space, item.location), item.object) in asked]
        verdicts = await verified(self._parts, items, or_husks=True)
        puts = [
            replace(verdict, at=home_of(item)) if item.object else verdict
            for item, verdict in zip(items, verdicts, strict=True)
            if isinstance(verdict, Put) and any(home_of(item) in arc for arc in self._arcs)
        ]
        whole, husks = [put for put in puts if not put.is_husk], [put for put in puts if put.is_husk]
        if whole:
            await self._take(whole, self._merge)
        if husks:
            # Nobody can be sent these, so they are owed to nobody: whoever lacks them is found by comparing.
            await self._take(husks, self._keep_husks)
        return answered

    async def _keep_husks(self, husks: Sequence[Put]) -> Sequence[PutResult]:
        results = await self._parts.store.merge(husks)
        self.has_new_husks |= any(result.has_changed for result in results)
        return results

    async def _take(self, puts: Sequence[Put], merge: Merge) -> None:
        parts = self._parts
        homes = [_home(put) for put in puts]
        with trio.move_on_after(GATE_S_MAX) as patience:
            async with parts.writing(homes, anywhere=any(put.at is not None for put in puts)):
                patience.deadline = float("inf")
                if not all(map(parts.keeper.holding.owns, homes)):
                    raise Refused(RejectReason.NOT_MY_LOCATION, "the place is not this node's any more")
                results = await merge(puts)
        if patience.cancelled_caught:
            raise Refused(RejectReason.BUSY, "the place is being handed over")
        if any(isinstance(result, NotKept) or result.outcome is Outcome.FULL for result in results):
            raise _NoRoomHere(RejectReason.STORAGE_FULL, "what a holder has newer cannot be kept here")
        parts.events["copies fetched"] += len(puts)


def _home(put: Put) -> Location:
    """Of what was put at its home."""
    return put.record.header.location if put.at is None else put.at


def _size(item: HandItem) -> int:
    return len(item.header) + len(item.signature) + len(item.ciphertext)
