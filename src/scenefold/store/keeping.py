"""The one door through which stored records change, so that nothing that is derived from them can be forgotten.

Counts and digests follow from the records, and change with them in one transaction. Nobody else writes the table of records.
"""

from __future__ import annotations

from scenefold.base.location import Location
from scenefold.crypto import Record, RecordPlace
from scenefold.store.layout import OBJECTS, RECORDS, Spot, object_key, pack_record, record_key
from scenefold.store.tally import Tally
from scenefold.world.ports import WriteTransaction


def keep_record(transaction: WriteTransaction, tally: Tally, spot: Spot, record: Record) -> None:
    """Write a record, over whatever lies there."""
    key, packed = record_key(*spot), pack_record(record)
    tally.change(spot, transaction.get(RECORDS, key), record.header_bytes, len(packed))
    transaction.put(RECORDS, key, packed)
    if spot.object:
        _note_place(transaction, spot)


def drop_record(transaction: WriteTransaction, tally: Tally, spot: Spot) -> None:
    """Delete what lies there."""
    key = record_key(*spot)
    tally.change(spot, transaction.get(RECORDS, key), None, 0)
    transaction.delete(RECORDS, key)
    if spot.object:
        _forget_place(transaction, spot)


def move_object(transaction: WriteTransaction, spot: Spot, to: Location) -> None:
    """Put an object's record elsewhere, as it is. Its home stays, so nothing that is derived changes."""
    (scene, space, _), object_id = spot
    value = transaction.get(RECORDS, record_key(*spot))
    assert value is not None
    packed = bytes(value)
    moved = Spot(RecordPlace(scene, space, to), object_id)
    transaction.delete(RECORDS, record_key(*spot))
    transaction.put(RECORDS, record_key(*moved), packed)
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
