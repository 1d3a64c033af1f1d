"""What is left of a record whose ciphertext has rotted everywhere: a *husk* (specs/10-store.md, Husks).

The signed header and its signature, without a ciphertext: proof that there was this version, and which one it was. It is stored like a
record, so it counts in sums, answers as damaged, and is healed as any record that has rotted. It fills a place where nothing lies, and
replaces nothing that is sound; a wreck only if it comes from who decides about the place.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import DamagedData
from scenefold.base.location import Arc
from scenefold.crypto import Record, RecordPlace, object_of, version_key, wanted_place
from scenefold.store.judging import Outcome, Put, PutResult
from scenefold.store.keeping import keep_record
from scenefold.store.layout import RECORDS, Spot, record_key, remains_of, unpack_record
from scenefold.store.opened import OpenedStore
from scenefold.store.placing import free_place, place_of
from scenefold.store.reading import stored_value
from scenefold.store.tally import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction


def read_remains(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[Record | None]:
    """Of each record the husk; None where nothing lies, or its header has rotted, too. Whether the ciphertext is sound is not looked at."""
    found = [stored_value(transaction, spot) for spot in spots]
    return [None if value is None else remains_of(value) for value in found]


def keep_husk(transaction: WriteTransaction, tally: Tally, arc: Arc | None, put: Put) -> PutResult:
    """STORED if it, or something that tells no less, is here now; STALE if a newer version is; DAMAGED if an older one is, and sound."""
    header = put.record.header
    spot = _spot(transaction, arc, put)
    value = transaction.get(RECORDS, record_key(*spot))
    if value is None:
        keep_record(transaction, tally, spot, put.record, None)
        return PutResult(Outcome.STORED, header.digest, has_changed=True)
    remains = remains_of(value)
    if remains is None and put.over_wreck:
        keep_record(transaction, tally, spot, put.record, value)
        return PutResult(Outcome.STORED, header.digest, has_changed=True)
    if remains is None or remains.header == header:
        # Of a wreck nobody knows which version it was: it says as much.
        return PutResult(Outcome.STORED, header.digest)
    if version_key(remains.header) > version_key(header):
        return PutResult(Outcome.STALE, remains.header.digest)
    if _is_sound(value):
        return PutResult(Outcome.DAMAGED)
    keep_record(transaction, tally, spot, put.record, value)
    return PutResult(Outcome.STORED, header.digest, has_changed=True)


def _spot(transaction: ReadTransaction, arc: Arc | None, put: Put) -> Spot:
    header = put.record.header
    object_id = object_of(header)
    if not object_id:
        return Spot(RecordPlace(header.scene, header.space, header.location))
    at = place_of(transaction, header.scene, header.space, object_id)
    if at is None and arc is not None and wanted_place(object_id) in arc:
        at = free_place(transaction, header.scene, header.space, object_id, arc)
    return Spot(RecordPlace(header.scene, header.space, at or put.at or wanted_place(object_id)), object_id)


def _is_sound(value: memoryview) -> bool:
    try:
        unpack_record(value)
    except DamagedData:
        return False
    return True


class HuskStore(OpenedStore):
    """The part of the store that knows what is left of what has rotted."""

    async def remains(self, spots: Sequence[Spot]) -> list[Record | None]:
        """Husks of the records there, whether these are sound or not; None where nothing lies, or not even the header is sound."""
        return await self._view(read_remains, spots)
