"""The giver's copying: what lies in the piece, what the receiver lacks, those records; pass after pass.

A pass walks the piece in the store's order. What the receiver has answered for, a version at a place, is not spoken of
again. The last pass, while writers wait, looks only where something was written meanwhile. A digest alone says too little:
any writer can sign somebody else's ciphertext for another place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.line.holding import Handover
from scenefold.peer.line.parts import Parts, check_reply
from scenefold.store import Entry, Spot
from scenefold.store.layout import record_key
from scenefold.wire import CopyRecords, HandItem, HandoverReply, OfferRecords, RecordEntry, RecordsWanted
from scenefold.world import Priority

LIST_RECORDS_MAX = 1024
"""Of one OfferRecords, less than it may hold: so many entries keep the event loop for some 5 ms."""
COPY_BYTES_MAX = 2 * 1024 * 1024
"""Of one CopyRecords: a quarter of a frame, so that other requests on the connection need not wait long."""
COPY_BYTES_MIN = 64 * 1024
COPY_S = 0.25
"""Under a small budget a part is what may be sent in this time, so that it flows instead of coming in bursts."""
ENTRY_BYTES = 96
"""About what an entry costs on the wire."""
ANSWERED_MAX = 400_000
"""Versions remembered as answered for: some 50 MB. What is beyond is offered again in each pass, and not wanted."""
LIST_S_MAX = 10.0
COPY_S_MAX = 30.0


@dataclass(frozen=True, slots=True)
class Pass:
    """What one pass sent."""

    records: int
    bytes: int


class Copier:
    """Copies one handover's piece to its receiver."""

    def __init__(self, parts: Parts, handover: Handover) -> None:
        self._parts = parts
        self._handover = handover
        self._answered: set[bytes] = set()

    async def copy(self, *, only: Sequence[Arc] | None = None, hurry: bool = False) -> Pass:
        """One pass. Afterwards the receiver has answered for every version that lay in the piece when it was reached.

        `only`: these parts of it (ascending, apart). In a hurry the budget is charged and not waited for.
        """
        pieces = [self._handover.piece] if only is None else only
        records = stored_bytes = 0
        cursor: bytes | None = None
        while True:
            manifest = await self._parts.store.manifest(pieces, cursor, LIST_RECORDS_MAX)
            await self._require_known(manifest.damaged)
            # An object that came to lie here while its home stays slides out before the piece is let go of.
            there = [entry for entry in manifest.entries if entry.home in self._handover.piece]
            entries = [entry for entry in there if _version(entry) not in self._answered]
            unsent: set[bytes] = set()
            for batch in _batches(await self._wanted(entries, hurry), self._part_bytes):
                with self._parts.carrying.begun():
                    stored_bytes += await self._send(batch, hurry, unsent)
                records += len(batch)
            if len(self._answered) < ANSWERED_MAX:
                self._answered.update(version for version in map(_version, entries) if version not in unsent)
            cursor = manifest.cursor
            if cursor is None:
                return Pass(records, stored_bytes)

    async def _require_known(self, wrecks: Sequence[Spot]) -> None:
        """Refused (13) while others may have what lay there: its receiver would say that nothing does, and only here is it known to whom it was owed."""
        for spot in wrecks:
            if spot.home in self._handover.piece and await self._parts.keeping.awaits(spot):
                raise Refused(RejectReason.BUSY, "a record there has rotted, and is being fetched from those who have copies of it")

    @property
    def _part_bytes(self) -> float:
        return min(max(self._parts.budget.bytes_per_s * COPY_S, COPY_BYTES_MIN), COPY_BYTES_MAX)

    async def _wanted(self, entries: Sequence[Entry], hurry: bool) -> list[Entry]:
        if not entries:
            return []
        await self._spend(len(entries) * ENTRY_BYTES, hurry)
        listed = tuple(
            RecordEntry(entry.place.scene, entry.place.space, entry.place.location, entry.object, entry.digest) for entry in entries
        )
        request = OfferRecords(self._handover.id, listed)
        reply = await self._parts.peers.ask(self._handover.peer.node, Priority.LOW, request, RecordsWanted, LIST_S_MAX)
        # Each once, however often it is named: else one answer could draw thousands of times what lies here.
        return [entries[index] for index in dict.fromkeys(reply.indexes) if index < len(entries)]

    async def _send(self, batch: Sequence[Entry], hurry: bool, unsent: set[bytes]) -> int:
        """What has rotted, or was replaced just now, is `unsent`: the same version may be whole again before the last pass."""
        found = await self._parts.store.read([entry.spot for entry in batch])
        unsent.update(_version(entry) for entry, record in zip(batch, found, strict=True) if not isinstance(record, Record))
        rotten = [entry for entry, record in zip(batch, found, strict=True) if isinstance(record, DamagedData)]
        self._parts.events["damaged"] += len(rotten)
        whole = [(entry, record) for entry, record in zip(batch, found, strict=True) if isinstance(record, Record)]
        # What is left of them goes along: where it lay nobody shall be told that there was nothing.
        husks = zip(rotten, await self._parts.store.remains([entry.spot for entry in rotten]), strict=True) if rotten else ()
        items = tuple(hand_item(entry, record) for entry, record in [*whole, *husks] if record is not None)
        if not items:
            return 0
        size_bytes = sum(entry.size for entry in batch)
        await self._spend(size_bytes, hurry)
        request = CopyRecords(self._handover.id, items)
        check_reply(await self._parts.peers.ask(self._handover.peer.node, Priority.LOW, request, HandoverReply, COPY_S_MAX))
        self._parts.events["copied"] += len(items)
        self._parts.events["handed bytes"] += size_bytes
        return size_bytes

    async def _spend(self, count: int, hurry: bool) -> None:
        if hurry:
            self._parts.budget.charge(count)
        else:
            await self._parts.budget.take(count)


def _version(entry: Entry) -> bytes:
    """Which version lies where, in one short name."""
    return record_key(entry.place, entry.object) + entry.digest


def hand_item(entry: Entry, record: Record) -> HandItem:
    """A record with its place, for the wire."""
    place = entry.place
    return HandItem(place.scene, place.space, place.location, entry.object, record.signature, record.header_bytes, record.ciphertext)


def _batches(entries: Sequence[Entry], bytes_max: float) -> Iterator[list[Entry]]:
    """Parts of so many bytes at most, or of one record."""
    batch: list[Entry] = []
    size_bytes = 0
    for entry in entries:
        if batch and size_bytes + entry.size > bytes_max:
            yield batch
            batch, size_bytes = [], 0
        batch.append(entry)
        size_bytes += entry.size
    if batch:
        yield batch
