"""Changes of records: what clients put, what other nodes hand over, what is given up (specs/10-store.md, Writing).

`PutRecords` is the only one that judges places: it reads the node's arc in its own transaction. Merging does not, since
a handover brings records before their arc, and whoever merges has decided where they belong.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from scenefold.base.errors import DamagedData
from scenefold.base.location import Arc, Location
from scenefold.crypto import PLACED_BY_NODE, Record, RecordHeader, RecordPlace, object_of
from scenefold.store.changes import storage_full
from scenefold.store.holding import read_arc
from scenefold.store.judging import Outcome, Put, PutResult, judge
from scenefold.store.layout import (
    OBJECTS,
    RECORDS,
    Spot,
    object_key,
    pack_record,
    record_key,
    spot_of,
    stored_header,
    unpack_record,
)
from scenefold.store.placing import free_place, place_in_arc
from scenefold.store.statistics import Tally
from scenefold.store.walking import entry_keys
from scenefold.world.ports import WriteTransaction

_FRAMING_BYTES = 512
"""Header, signature, key and the tree's own bytes of one record."""

_log = logging.getLogger("scenefold.store")


@dataclass(frozen=True, slots=True)
class PutRecords:
    """Records of clients, each judged on its own: against the arc, and against what is there."""

    puts: Sequence[tuple[RecordHeader, Put]]

    @property
    def size_bytes(self) -> int:
        return _size_of(self.puts)

    @property
    def uses_reserve(self) -> bool:
        return False

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[PutResult]:
        arc = read_arc(transaction)
        return [_put(transaction, tally, arc, header, put) for header, put in self.puts]

    def when_full(self) -> list[PutResult]:
        return [PutResult(Outcome.FULL)] * len(self.puts)


@dataclass(frozen=True, slots=True)
class MergeRecords:
    """Copies from other nodes: the highest version stays, wherever it lies. They may use the reserve.

    A node-managed object that is in this node's arc already stays at its one place, whatever place the copy comes from.
    """

    puts: Sequence[tuple[RecordHeader, Put]]

    @property
    def size_bytes(self) -> int:
        return _size_of(self.puts)

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[PutResult]:
        arc = read_arc(transaction)
        results = []
        for header, put in self.puts:
            known = place_in_arc(transaction, arc, header.scene, header.space, object_of(header))
            results.append(_write(transaction, tally, header, put.record, None, _spot(header, put.at if known is None else known)))
        return results

    def when_full(self) -> list[PutResult]:
        return [PutResult(Outcome.FULL)] * len(self.puts)


@dataclass(frozen=True, slots=True)
class RemoveRecords:
    """Give up exactly these versions; what has changed since stays. Gives the number removed."""

    versions: Sequence[tuple[Spot, bytes]]

    @property
    def size_bytes(self) -> int:
        return len(self.versions) * _FRAMING_BYTES

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._remove(transaction, tally, spot, digest) for spot, digest in self.versions)

    def _remove(self, transaction: WriteTransaction, tally: Tally, spot: Spot, digest: bytes) -> bool:
        key = record_key(*spot)
        value = transaction.get(RECORDS, key)
        present = None if value is None else _present(value)
        if value is None or present is None or present.digest != digest:
            return False
        _delete(transaction, tally, spot, len(value))
        return True

    def when_full(self) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class DiscardDamaged:
    """Delete what has changed on the disk, and only that. Gives the number deleted."""

    spots: Sequence[Spot]

    @property
    def size_bytes(self) -> int:
        return len(self.spots) * _FRAMING_BYTES

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._discard(transaction, tally, spot) for spot in self.spots)

    def _discard(self, transaction: WriteTransaction, tally: Tally, spot: Spot) -> bool:
        value = transaction.get(RECORDS, record_key(*spot))
        if value is None or _is_sound(value):
            return False
        _delete(transaction, tally, spot, len(value))
        return True

    def when_full(self) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class SlideObjects:
    """Put the first node-managed records of a piece elsewhere: the node keeps them while the piece goes.

    Gives how many slid; fewer than `limit` means that the piece has none left.
    """

    piece: Arc
    into: Arc
    limit: int

    @property
    def size_bytes(self) -> int:
        return self.limit * _FRAMING_BYTES

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> int:
        found: list[bytes] = []
        for key in entry_keys(transaction, [self.piece], managed_only=True):
            found.append(key)
            if len(found) == self.limit:
                break
        for key in found:
            self._slide(transaction, key)
        return len(found)

    def _slide(self, transaction: WriteTransaction, key: bytes) -> None:
        (scene, space, _), object_id = spot_of(key)
        value = transaction.get(RECORDS, key)
        assert value is not None
        location = free_place(transaction, scene, space, object_id, self.into)
        packed = bytes(value)
        transaction.delete(RECORDS, key)
        transaction.put(RECORDS, record_key(RecordPlace(scene, space, location), object_id), packed)
        transaction.put(OBJECTS, object_key(scene, space, object_id), location)

    def when_full(self) -> int:
        raise storage_full()


def _spot(header: RecordHeader, at: Location | None) -> Spot:
    return Spot(RecordPlace(header.scene, header.space, header.location if at is None else at), object_of(header))


def _put(transaction: WriteTransaction, tally: Tally, arc: Arc | None, new: RecordHeader, put: Put) -> PutResult:
    if arc is None:
        return PutResult(Outcome.NOT_OWNED)
    if new.placement == PLACED_BY_NODE:
        location = _managed_place(transaction, arc, new, put.at)
        if location not in arc:
            return PutResult(Outcome.NOT_OWNED)
        result = _write(transaction, tally, new, put.record, put.expect, _spot(new, location))
        return replace(result, location=location)
    if new.location not in arc:
        return PutResult(Outcome.NOT_OWNED)
    return _write(transaction, tally, new, put.record, put.expect, _spot(new, None))


def _managed_place(transaction: WriteTransaction, arc: Arc, new: RecordHeader, at: Location | None) -> Location:
    """Where a node-managed record is, or shall be: at `at`, where it slid to, or at a free place."""
    object_id = object_of(new)
    if at is not None and transaction.get(RECORDS, record_key(*_spot(new, at))) is not None:
        return at
    known = place_in_arc(transaction, arc, new.scene, new.space, object_id)
    if known is not None:
        return known
    return free_place(transaction, new.scene, new.space, object_id, arc) if at is None else at


def _write(transaction: WriteTransaction, tally: Tally, new: RecordHeader, record: Record, expect: bytes | None, spot: Spot) -> PutResult:
    key = record_key(*spot)
    value = transaction.get(RECORDS, key)
    present = _present(value) if value is not None else None
    result = judge(new, expect, present)
    # A repetition changes nothing, unless what is here has rotted: who is told that it is stored must find it so.
    if result.outcome is Outcome.STORED and (value is None or present != new or not _is_sound(value)):
        replaced_bytes = len(value) if value is not None else 0
        packed = pack_record(record)
        transaction.put(RECORDS, key, packed)
        tally.add((new.scene, new.space), 0 if value is not None else 1, len(packed) - replaced_bytes)
        if spot.object:
            transaction.put(OBJECTS, object_key(new.scene, new.space, spot.object), spot.place.location)
    return result


def _delete(transaction: WriteTransaction, tally: Tally, spot: Spot, stored_bytes: int) -> None:
    tally.add((spot.place.scene, spot.place.space), -1, -stored_bytes)
    transaction.delete(RECORDS, record_key(*spot))
    if spot.object:
        _forget_object(transaction, spot)


def _is_sound(value: memoryview) -> bool:
    try:
        unpack_record(value)
    except DamagedData:
        return False
    return True


def _forget_object(transaction: WriteTransaction, spot: Spot) -> None:
    key = object_key(spot.place.scene, spot.place.space, spot.object)
    known = transaction.get(OBJECTS, key)
    if known is not None and bytes(known) == spot.place.location:
        transaction.delete(OBJECTS, key)


def _present(value: memoryview) -> RecordHeader | None:
    """The header of what is there. Damaged data is nothing: the record that arrives heals it."""
    try:
        return stored_header(value)
    except DamagedData as error:
        _log.error("a damaged record is replaced: %s", error)
        return None


def _size_of(puts: Sequence[tuple[RecordHeader, Put]]) -> int:
    return sum(len(put.record.ciphertext) + _FRAMING_BYTES for _, put in puts)
