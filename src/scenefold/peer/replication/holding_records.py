"""Copies as records: a holder stores, compares and shows what it has: StoreCopies, CompareRange, FetchHeld (specs/20-copies.md).

What an owner sends is verified like what comes with a piece, and counts only while this node has custody of its place for that
owner. An answer is an owner's reason to say that a write is done: so custody is looked at once more when the record is durable.
Who has asked meanwhile what lies here has either found the record, or its asking has ended that custody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scenefold.base.cover import without
from scenefold.base.errors import DamagedData, Refused
from scenefold.base.limits import BULK_BYTES_MAX, STORE_READ_BATCH_MAX
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordPlace
from scenefold.peer.copies.versions import told_sum, told_version
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.receiving import verified
from scenefold.peer.line.rightful import layout_of
from scenefold.peer.records.verification import epochs_of, home_of
from scenefold.peer.replication.holding_rules import require_member, require_sender
from scenefold.store import Outcome, Put, RangeSum, Spot
from scenefold.store.versions import sum_of
from scenefold.wire import (
    ArcSum,
    CompareRange,
    CopiesStored,
    FetchHeld,
    HandItem,
    HeldFetched,
    ListedRecord,
    Member,
    Packet,
    RangeCompared,
    RecordEntry,
    StoreCopies,
)
from scenefold.world.metering import charge_forged

NEVER_HONEST = (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED)
SCENES_MAX = 64
"""Scenes of the records of one StoreCopies. Each that is unknown sets off a question to every node."""
_TEXT_MAX = 256
_ITEM_FRAMING_BYTES = 64
_SOME = 2
"""Records that a listing has room for, at least."""


class HoldingRecords:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts

    def register(self, handlers: Handlers) -> None:
        handlers.add(StoreCopies, self._on_store, senders=Senders.NODES)
        handlers.add(CompareRange, self._on_compare, senders=Senders.NODES)
        handlers.add(FetchHeld, self._on_fetch, senders=Senders.NODES)

    # ------------------------------------------------------------------------------------------------ StoreCopies

    async def _on_store(self, packet: StoreCopies, peer: str) -> Packet:
        require_sender(peer, packet.owner)
        problems = await self._store(packet.owner, packet.items)
        text = next((str(problem) for problem in problems if problem is not None), "")
        return CopiesStored(tuple(0 if problem is None else int(problem.reason) for problem in problems), text[:_TEXT_MAX])

    async def _store(self, owner: Member, items: Sequence[HandItem]) -> list[Refused | None]:
        """Why each is not kept; None: it, or something newer, is durable here, and this node holds it for that owner."""
        layouts = await self._layouts(items)
        problems = [self._refused(owner, item, layout) for item, layout in zip(items, layouts, strict=True)]
        open_ones = [index for index, problem in enumerate(problems) if problem is None]
        verdicts = await verified(self._parts, [items[index] for index in open_ones], or_husks=True)
        charge_forged(sum(isinstance(verdict, Refused) and verdict.reason in NEVER_HONEST for verdict in verdicts))
        puts: list[tuple[int, Put]] = []
        for index, verdict in zip(open_ones, verdicts, strict=True):
            if isinstance(verdict, Refused):
                problems[index] = verdict
            else:
                # The owner decides what lies here: where this node knows less, that is what it says.
                puts.append((index, replace(_at_home(verdict, items[index]), over_wreck=True)))
        results = await self._parts.store.hold([put for _, put in puts]) if puts else []
        for (index, _), result in zip(puts, results, strict=True):
            if result.outcome in (Outcome.STORED, Outcome.STALE):
                problems[index] = self._refused(owner, items[index], layouts[index])
            else:
                problems[index] = Refused(result.reason or RejectReason.STORAGE_FULL, f"the holder cannot keep it: {result.outcome.value}")
        self._parts.events["copies stored"] += sum(problem is None for problem in problems)
        return problems

    async def _layouts(self, items: Sequence[HandItem]) -> list[Layout | None]:
        """That of each record's space, by a header that its author knew; None if that is unknown here."""
        epochs = epochs_of(items)
        if len(epochs) > SCENES_MAX:
            raise Refused(RejectReason.LIMIT_EXCEEDED, f"records of more than {SCENES_MAX} scenes in one packet", remedy="send fewer")
        found: dict[tuple[int, int], Layout | None] = {}
        for item in items:
            address = item.scene, item.space
            if address not in found:
                layout = await layout_of(self._parts, item.scene, item.space)
                if layout is None or not self._holds_any(layout):
                    # The space, or its copies, may be newer than what is known here.
                    await self._pull(item, epochs[item.scene])
                    layout = await layout_of(self._parts, item.scene, item.space)
                found[address] = layout
        return [found[item.scene, item.space] for item in items]

    async def _pull(self, item: HandItem, epoch: int) -> None:
        try:
            await self._parts.scenes.known(item.scene, position=epoch)
        except Refused:
            self._parts.events["copies of unknown scenes"] += 1

    def _holds_any(self, layout: Layout) -> bool:
        return bool(self._parts.keeper.copies.custody.arcs(layout))

    def _refused(self, owner: Member, item: HandItem, layout: Layout | None) -> Refused | None:
        if self._parts.keeping.closed:
            return Refused(RejectReason.BUSY, "this node is leaving, and holds nothing more")
        if layout is None:
            return Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "the space is unknown to the holder")
        custody, home = self._parts.keeper.copies.custody, home_of(item)
        if custody.takes_from(owner, layout, home):
            return None
        known = self._parts.scenes.here(item.scene)
        turn = None if known is None else known.turns.get(item.space)
        # The owner may not know yet that the space has other copies now.
        if turn is not None and any(custody.takes_from(owner, former, home) for former in custody.layouts if turn.may_have_had(former)):
            return None
        return Refused(RejectReason.NOT_MY_LOCATION, "this node does not hold the place for that owner")

    # ----------------------------------------------------------------------------------------------- CompareRange

    async def _on_compare(self, packet: CompareRange, peer: str) -> Packet:
        require_member(self._parts, peer)
        self._parts.arrival.require()
        arcs = [span.arc for span in packet.arcs]
        layout = await layout_of(self._parts, packet.scene, packet.space)
        totals = await self._parts.store.sums(packet.scene, packet.space, arcs)
        return RangeCompared(
            tuple([await self._sum(packet, arc, layout, total) for arc, total in zip(arcs, totals, strict=True)]),
        )

    async def _sum(self, packet: CompareRange, arc: Arc, layout: Layout | None, total: RangeSum) -> ArcSum:
        whole = self._has_whole(arc, layout)
        if not packet.list_below or total.records > packet.list_below:
            return ArcSum(total.records, told_sum(total), None, whole)
        # One more, so that a record that has rotted, and is in no sum, is met as such.
        listing = await self._parts.store.listing(packet.scene, packet.space, arc, max(_SOME, packet.list_below))
        sound = [held for held in listing.records if held.version]
        if not listing.complete or len(sound) > packet.list_below:
            return ArcSum(total.records, told_sum(total), None, whole)
        listed = tuple(ListedRecord(held.spot.place.location, held.spot.object, told_version(held.header)) for held in sound)
        total = RangeSum()
        for held in sound:
            total = total.and_also(1, sum_of(held.version))
        return ArcSum(total.records, told_sum(total), listed, whole)

    def _has_whole(self, arc: Arc, layout: Layout | None) -> bool:
        """Whether this node owns all of it, or has custody of all of it and a whole copy."""
        keeper = self._parts.keeper
        own = keeper.holding.arc
        if own is not None and own.first <= arc.first and arc.last <= own.last:
            return True
        rest = [arc]
        for entry in keeper.copies.custody.within(arc):
            if entry.whole and entry.layout == layout:
                rest = [left for part in rest for left in without(part, entry.arc)]
        return not rest

    # -------------------------------------------------------------------------------------------------- FetchHeld

    async def _on_fetch(self, packet: FetchHeld, peer: str) -> Packet:
        require_member(self._parts, peer)
        items: list[HandItem] = []
        missing: list[int] = []
        room = BULK_BYTES_MAX
        for start in range(0, len(packet.entries), STORE_READ_BATCH_MAX):
            batch = packet.entries[start : start + STORE_READ_BATCH_MAX]
            found = await self._found([_spot_of(entry) for entry in batch])
            for index, (entry, record) in enumerate(zip(batch, found, strict=True), start):
                if record is None or record.header.digest != entry.digest:
                    # What was written over since was listed anew.
                    missing.append(index)
                    continue
                room -= len(record.signature) + len(record.header_bytes) + len(record.ciphertext) + _ITEM_FRAMING_BYTES
                if room < 0 and (items or missing):
                    return HeldFetched(tuple(items), tuple(missing))
                items.append(_item(entry, record))
        return HeldFetched(tuple(items), tuple(missing))

    async def _found(self, spots: Sequence[Spot]) -> list[Record | None]:
        """What lies there; of what has rotted what is left. That is not read once more if it is known."""
        store = self._parts.store
        unread = [spot for spot in spots if not store.noticed.is_rotten(spot)]
        read = dict(zip(unread, await store.read(unread), strict=True))
        rotten = [spot for spot in spots if spot not in read or isinstance(read[spot], DamagedData)]
        husks = dict(zip(rotten, await store.remains(rotten), strict=True)) if rotten else {}
        self._parts.events["damaged"] += len(rotten)
        sound = {spot: record for spot, record in read.items() if isinstance(record, Record)}
        return [husks[spot] if spot in husks else sound.get(spot) for spot in spots]


def _at_home(put: Put, item: HandItem) -> Put:
    """An object lies at its home at a holder, wherever its owner has put it: no bound of this node's own arc comes between."""
    return replace(put, at=home_of(item)) if item.object else put


def _spot_of(entry: RecordEntry) -> Spot:
    return Spot(RecordPlace(entry.scene, entry.space, entry.location), entry.object)


def _item(entry: RecordEntry, record: Record) -> HandItem:
    return HandItem(entry.scene, entry.space, entry.location, entry.object, record.signature, record.header_bytes, record.ciphertext)
