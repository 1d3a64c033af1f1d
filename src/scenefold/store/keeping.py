"""The one door through which stored records change, so that nothing that is derived from them can be forgotten.

Counts and digests follow from the records, and what is owed is owed of them: all that changes in one transaction. Nobody else writes the table of records.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.crypto import Record, RecordPlace
from scenefold.store.debts import move_debt
from scenefold.store.digest_changes import Former
from scenefold.store.layout import OBJECTS, RECORDS, Spot, object_key, pack_record, record_key, sound_header
from scenefold.store.tally import Tally
from scenefold.store.versions import version_of
from scenefold.world.ports import WriteTransaction


def keep_record(
    transaction: WriteTransaction, tally: Tally, spot: Spot, record: Record, over: memoryview | None, debtors: Sequence[NodeId] = ()
) -> None:
    """Write a record over what lies there, which was just read. `debtors` are still to get it, if what lies there is not the same."""
    key, packed = record_key(*spot), pack_record(record)
    before, version = _former(over), version_of(record.header_bytes)
    tally.change(spot, before, version, len(packed))
    transaction.put(RECORDS, key, packed)
    # Where nothing lay, nothing is owed: a debt goes with its record.
    if (before is not None or debtors) and (before is None or before.header != record.header_bytes):
        tally.debts.write_debt(transaction, key, version, debtors)
    if spot.object:
        _note_place(transaction, spot)


def drop_record(transaction: WriteTransaction, tally: Tally, spot: Spot) -> None:
    """Delete what lies there."""
    key = record_key(*spot)
    tally.change(spot, _former(transaction.get(RECORDS, key)), None, 0)
    transaction.delete(RECORDS, key)
    tally.debts.forget_debt(transaction, key)
    if spot.object:
        _forget_place(transaction, spot)


def _former(value: memoryview | None) -> Former | None:
    return None if value is None else Former(sound_header(value), len(value))


def move_object(transaction: WriteTransaction, spot: Spot, to: Location) -> None:
    """Put an object's record elsewhere, as it is, and what is owed of it. Its home stays, so nothing that is derived changes."""
    (scene, space, _), object_id = spot
    value = transaction.get(RECORDS, record_key(*spot))
    assert value is not None
    packed = bytes(value)
    moved = Spot(RecordPlace(scene, space, to), object_id)
    transaction.delete(RECORDS, record_key(*spot))
    transaction.put(RECORDS, record_key(*moved), packed)
    move_debt(transaction, record_key(*spot), record_key(*moved))
    _note_place(transaction, moved)


def _note_place(transaction: WriteTransaction, spot: Spot) -> None:
    """Remember where an object lies, if that does not follow from its id."""
    key = object_key(spot.place.scene, spot.place.space, spot.object)
    if spot.place.location != spot.home:
        transaction.put(OBJECTS, key, spot.place.location)
    elif transaction.get(OBJECTS, key) is not None:
        transaction.delete(OBJECTS, key)


def _forget_place(transaction: WriteTransaction, spot: Spot) -> None:
    key = object_key(spot.place.scene, spot.place.space, spot.object)
    known = transaction.get(OBJECTS, key)
    if known is not None and bytes(known) == spot.place.location:
        transaction.delete(OBJECTS, key)
