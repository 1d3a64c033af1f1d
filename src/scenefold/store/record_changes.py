"""Changes of records: what clients put, what other nodes hand over, what is given up (specs/10-store.md, Writing).

`PutRecords` is the only one that judges places: it reads the node's arc in its own transaction. Merging does not, since
a handover brings records before their arc, and whoever merges has decided where they belong. Of a node-managed object there is
one record in a store, wherever it lies: what brings it to another place takes it from where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Self

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.crypto import PLACED_BY_NODE, Record, RecordHeader, RecordPlace, object_of, wanted_place
from scenefold.store.changes import MayUseReserve, ReserveLeft, storage_full
from scenefold.store.holding import read_arc
from scenefold.store.husks import keep_husk
from scenefold.store.judging import Outcome, Put, PutResult, judge, judge_copy
from scenefold.store.keeping import drop_record, keep_record, move_object
from scenefold.store.layout import RECORDS, Spot, pack_record, record_key, stored_header, unpack_record
from scenefold.store.placing import displaced, free_place, place_of
from scenefold.store.tally import Tally
from scenefold.store.wrecks import judge_copy_over_wreck, judge_over_wreck
from scenefold.world.ports import ReadTransaction, WriteTransaction

_FRAMING_BYTES = 512
"""Header, signature, key and the tree's own bytes of one record."""
_DEBT_BYTES = 96
"""Key, version and some nodes."""
DELETION_BYTES_MAX = 4096
"""No deletion's record is larger: its payload has 2 KiB at most."""


Judge = Callable[[Record, RecordHeader | None, memoryview | None], PutResult]
"""Of a record over what is there: its header, None if there is nothing or that has rotted; and its bytes."""


@dataclass(frozen=True, slots=True)
class PutRecords:
    """Records of clients, each judged on its own: against the arc, and against what is there.

    `grown_bytes` None: there is room. Else a record may only take the place of one as large, or that it makes no larger than this.
    """

    puts: Sequence[tuple[RecordHeader, Put]]
    grown_bytes: int | None = None

    @property
    def size_bytes(self) -> int:
        return _size_of(self.puts)

    def in_reserve(self, left: ReserveLeft, /) -> PutRecords:
        return replace(self, grown_bytes=DELETION_BYTES_MAX if left.for_deletions > 0 else 0)

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[PutResult]:
        arc = read_arc(transaction)
        if self.grown_bytes is None:
            return [_put(transaction, tally, arc, header, put) for header, put in self.puts]
        return [_put_sparingly(transaction, tally, arc, header, put, self.grown_bytes) for header, put in self.puts]

    def when_full(self, transaction: ReadTransaction, /) -> list[PutResult]:
        """As `apply`, but what would have to be written is full: so a repetition of what is there is stored, whatever room there is."""
        arc = read_arc(transaction)
        return [_look(transaction, arc, header, put) for header, put in self.puts]


@dataclass(frozen=True, slots=True)
class MergeRecords(MayUseReserve):
    """Copies from other nodes: the highest version stays, wherever it lies. They leave some of the reserve to those who make room.

    A node-managed object with its home in this node's arc is put as a client's is, whatever place the copy comes from.
    `is_sparing`: there is no more of the reserve for them. A record may only take the place of another one, and be no larger than that, or than
    `grown_bytes`: what rotted can still be healed, and a deletion still be known.
    """

    puts: Sequence[tuple[RecordHeader, Put]]
    is_sparing: bool = False
    grown_bytes: int = 0

    @property
    def size_bytes(self) -> int:
        return _size_of(self.puts)

    def in_reserve(self, left: ReserveLeft, /) -> Self:
        if self.size_bytes <= self._bytes_of(left):
            return self
        return replace(self, is_sparing=True, grown_bytes=DELETION_BYTES_MAX if left.for_deletions > 0 else 0)

    def _bytes_of(self, left: ReserveLeft) -> int:
        return left.for_merging

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[PutResult]:
        arc = read_arc(transaction)
        if not self.is_sparing:
            return [_merge(transaction, tally, arc, header, put) for header, put in self.puts]
        return [_merge_sparingly(transaction, tally, arc, header, put, self.grown_bytes) for header, put in self.puts]

    def when_full(self, _transaction: ReadTransaction, /) -> list[PutResult]:
        return [PutResult(Outcome.FULL)] * len(self.puts)


@dataclass(frozen=True, slots=True)
class HoldRecords(MergeRecords):
    """Copies that are held for another owner. They leave more of the reserve, and what its owner could still take is held, too, or no deletion there would ever count."""

    def _bytes_of(self, left: ReserveLeft) -> int:
        return left.for_holding


@dataclass(frozen=True, slots=True)
class RemoveRecords(MayUseReserve):
    """Give up exactly these versions; what has changed since stays. Gives the number removed."""

    versions: Sequence[tuple[Spot, bytes]]

    @property
    def size_bytes(self) -> int:
        return len(self.versions) * _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._remove(transaction, tally, spot, digest) for spot, digest in self.versions)

    def _remove(self, transaction: WriteTransaction, tally: Tally, spot: Spot, digest: bytes) -> bool:
        key = record_key(*spot)
        value = transaction.get(RECORDS, key)
        present = None if value is None else _present(value)
        if value is None or present is None or present.digest != digest:
            return False
        drop_record(transaction, tally, spot)
        return True

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class DiscardDamaged(MayUseReserve):
    """Delete what has changed on the disk, and only that. Gives the number deleted."""

    spots: Sequence[Spot]

    @property
    def size_bytes(self) -> int:
        return len(self.spots) * _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._discard(transaction, tally, spot) for spot in self.spots)

    def _discard(self, transaction: WriteTransaction, tally: Tally, spot: Spot) -> bool:
        value = transaction.get(RECORDS, record_key(*spot))
        if value is None or _is_sound(value):
            return False
        drop_record(transaction, tally, spot)
        return True

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class PayDebts(MayUseReserve):
    """These nodes have these versions. Who was not to get them, or is to get a newer one, changes nothing."""

    paid: Sequence[tuple[Spot, bytes, NodeId]]

    @property
    def size_bytes(self) -> int:
        return len(self.paid) * _DEBT_BYTES

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(tally.debts.pay(transaction, *one) for one in self.paid)

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class SlideObjects(MayUseReserve):
    """Put node-managed records that lie in another of these parts than their home, or in none, into that part.

    Gives how many slid; fewer than `limit` means that none are left. An object whose home is in none of the parts stays.
    """

    parts: Sequence[Arc]
    limit: int

    @property
    def size_bytes(self) -> int:
        return self.limit * _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> int:
        found = ((spot, part) for spot, part in ((one.spot, one.part_among(self.parts)) for one in displaced(transaction)) if part)
        chosen = list(islice(found, self.limit))
        for spot, part in chosen:
            (scene, space, _), object_id = spot
            move_object(transaction, spot, free_place(transaction, scene, space, object_id, part))
        return len(chosen)

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


def _spot(header: RecordHeader, at: Location | None) -> Spot:
    return Spot(RecordPlace(header.scene, header.space, header.location if at is None else at), object_of(header))


def _put(transaction: WriteTransaction, tally: Tally, arc: Arc | None, new: RecordHeader, put: Put) -> PutResult:
    spot = _spot(new, None)
    if arc is None or spot.home not in arc:
        return PutResult(Outcome.NOT_OWNED)
    if not spot.object:
        return _write(transaction, tally, _judge_for_client, put, spot)
    spot = _place(transaction, arc, new, None)
    result = _write(transaction, tally, _judge_for_client, put, spot)
    return replace(result, location=spot.place.location)


def _put_sparingly(
    transaction: WriteTransaction, tally: Tally, arc: Arc | None, new: RecordHeader, put: Put, grown_bytes: int
) -> PutResult:
    looked = _look(transaction, arc, new, put)
    if looked.outcome is not Outcome.FULL:
        return looked
    value = transaction.get(RECORDS, record_key(*_lying(transaction, new)))
    if value is None or len(pack_record(put.record)) > max(len(value), grown_bytes):
        return looked
    return _put(transaction, tally, arc, new, put)


def _merge(transaction: WriteTransaction, tally: Tally, arc: Arc | None, new: RecordHeader, put: Put) -> PutResult:
    if put.is_husk:
        return keep_husk(transaction, tally, arc, put)
    return _write(transaction, tally, _judge_for_node, put, _place(transaction, arc, new, put.at))


def _merge_sparingly(
    transaction: WriteTransaction, tally: Tally, arc: Arc | None, new: RecordHeader, put: Put, grown_bytes: int
) -> PutResult:
    value = transaction.get(RECORDS, record_key(*_lying(transaction, new)))
    if value is None:
        return PutResult(Outcome.FULL)
    if not put.is_husk and len(pack_record(put.record)) > max(len(value), grown_bytes):
        present = _present(value)
        result = _judged(_judge_for_node, put, present, value)
        is_to_be_written = result.outcome is Outcome.STORED and _is_to_be_written(new, present, value)
        return PutResult(Outcome.FULL) if is_to_be_written else result
    return _merge(transaction, tally, arc, new, put)


def _lying(transaction: ReadTransaction, new: RecordHeader) -> Spot:
    """Where a record of its name lies, if there is one."""
    spot = _spot(new, None)
    known = place_of(transaction, new.scene, new.space, spot.object) if spot.object else None
    return spot if known is None else _spot(new, known)


def _look(transaction: ReadTransaction, arc: Arc | None, new: RecordHeader, put: Put) -> PutResult:
    if arc is None or _spot(new, None).home not in arc:
        return PutResult(Outcome.NOT_OWNED)
    spot = _lying(transaction, new)
    value = transaction.get(RECORDS, record_key(*spot))
    present = _present(value) if value is not None else None
    result = _judge_for_client(put.record, present, value)
    if result.outcome is Outcome.STORED and _is_to_be_written(new, present, value):
        return PutResult(Outcome.FULL)
    return replace(result, location=spot.place.location if spot.object and value is not None else None)


def _place(transaction: WriteTransaction, arc: Arc | None, new: RecordHeader, at: Location | None) -> Spot:
    """Where a record shall be, and a node-managed one from now on is if it was elsewhere.

    Of an object with its home in the arc the node decides: where it is, or at a free place. Any other lies `at` its place.
    """
    if new.placement != PLACED_BY_NODE:
        return _spot(new, None)
    object_id = object_of(new)
    known = place_of(transaction, new.scene, new.space, object_id)
    if arc is not None and wanted_place(object_id) in arc:
        at = known if known is not None and known in arc else free_place(transaction, new.scene, new.space, object_id, arc)
    assert at is not None
    spot = _spot(new, at)
    if known is not None and known != at:
        move_object(transaction, _spot(new, known), at)
    return spot


def _write(transaction: WriteTransaction, tally: Tally, judges: Judge, put: Put, spot: Spot) -> PutResult:
    record, new = put.record, put.record.header
    value = transaction.get(RECORDS, record_key(*spot))
    present = _present(value) if value is not None else None
    result = _judged(judges, put, present, value)
    if result.outcome is Outcome.STORED and _is_to_be_written(new, present, value):
        keep_record(transaction, tally, spot, record, value, put.debtors)
        return PutResult(result.outcome, result.current, result.location, has_changed=True, over_wreck=result.over_wreck)
    return result


def _judged(judges: Judge, put: Put, present: RecordHeader | None, value: memoryview | None) -> PutResult:
    if value is not None and present is not None and present == put.instead_of and not _is_sound(value):
        return PutResult(Outcome.STORED, put.record.header.digest)
    return judges(put.record, present, value)


def _judge_for_client(record: Record, present: RecordHeader | None, value: memoryview | None) -> PutResult:
    if present is None and value is not None:
        return replace(judge_over_wreck(record, value), over_wreck=True)
    return judge(record.header, present)


def _judge_for_node(record: Record, present: RecordHeader | None, value: memoryview | None) -> PutResult:
    if present is None and value is not None:
        return replace(judge_copy_over_wreck(record, value), over_wreck=True)
    return judge_copy(record.header, present)


def _is_to_be_written(new: RecordHeader, present: RecordHeader | None, value: memoryview | None) -> bool:
    """A repetition changes nothing, unless what is here has rotted: who is told that it is stored must find it so."""
    return value is None or present != new or not _is_sound(value)


def _is_sound(value: memoryview) -> bool:
    try:
        unpack_record(value)
    except DamagedData:
        return False
    return True


def _present(value: memoryview) -> RecordHeader | None:
    """The header of what is there; None if it is damaged, and its version not known any more."""
    try:
        return stored_header(value)
    except DamagedData:
        return None


def _size_of(puts: Sequence[tuple[RecordHeader, Put]]) -> int:
    return sum(len(put.record.ciphertext) + _FRAMING_BYTES for _, put in puts)
