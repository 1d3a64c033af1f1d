"""What readers do inside a view of the tables. Plain functions for the reading threads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.crypto import Record, RecordPlace
from scenefold.store.layout import (
    HEADERS,
    NO_OBJECT,
    OBJECTS_END,
    RECORDS,
    Spot,
    location_of,
    object_of,
    record_key,
    scene_of,
    sound_header,
    unpack_record,
)
from scenefold.store.placing import place_of
from scenefold.store.walking import describe
from scenefold.world.ports import ReadTransaction


@dataclass(frozen=True, slots=True)
class RangeAnswer:
    """Locations in order, and in a node-managed space the object at each. `covered` is the part of the arc that they
    are all of; all of it if `complete`."""

    locations: list[Location]
    covered: Arc
    complete: bool
    objects: list[bytes]


def read_records(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[Record | DamagedData | None]:
    """What lies at each spot, checked byte for byte; an error instead of a record that has changed on the disk."""
    return [_read_record(transaction, spot) for spot in spots]


def _read_record(transaction: ReadTransaction, spot: Spot) -> Record | DamagedData | None:
    value = stored_value(transaction, spot)
    if value is None:
        return None
    try:
        return unpack_record(value)
    except DamagedData as error:
        return DamagedData(error.what, where=describe(spot), remedy="write it anew, or restore it from a copy")


def stored_value(transaction: ReadTransaction, spot: Spot) -> memoryview | None:
    """An object is found wherever this node has put it."""
    place, object_id = spot
    value = transaction.get(RECORDS, record_key(place, object_id))
    if value is None and object_id:
        known = place_of(transaction, place.scene, place.space, object_id)
        value = None if known is None else transaction.get(RECORDS, record_key(RecordPlace(place.scene, place.space, known), object_id))
    return value


def read_record_headers(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[bytes | None]:
    """The headers alone: ciphertexts are not looked at. None for nothing, or for a header that has rotted."""
    found = [stored_value(transaction, spot) for spot in spots]
    return [None if value is None else sound_header(value) for value in found]


def read_digests(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[bytes | None]:
    """Which version lies at each spot; None for nothing, or nothing sound. Some 40 us for a full record, whose bytes are read."""
    return [_read_digest(transaction, spot) for spot in spots]


def _read_digest(transaction: ReadTransaction, spot: Spot) -> bytes | None:
    value = transaction.get(RECORDS, record_key(*spot))
    if value is None:
        return None
    try:
        # All of it is checked: who hears that a version is here deletes its own copy.
        return unpack_record(value).header.digest
    except DamagedData:
        # What comes instead heals it, and says so.
        return None


def read_range(transaction: ReadTransaction, scene: SceneId, space: SpaceId, arc: Arc, limit: int) -> RangeAnswer:
    """The first `limit` records in the arc; of one location all or none, so that the next question begins behind it."""
    first, last = record_key(RecordPlace(scene, space, arc.first)), record_key(RecordPlace(scene, space, arc.last), OBJECTS_END)
    locations: list[Location] = []
    objects: list[bytes] = []
    for key in transaction.keys(RECORDS, first, last):
        if len(locations) == limit:
            whole = _whole_places(locations, location_of(key))
            covered = Arc(arc.first, locations[whole - 1])
            return RangeAnswer(locations[:whole], covered, complete=False, objects=_objects(objects[:whole]))
        locations.append(location_of(key))
        objects.append(object_of(key))
    return RangeAnswer(locations, arc, complete=True, objects=_objects(objects))


def _objects(objects: list[bytes]) -> list[bytes]:
    """Nothing if there are none. Whoever writes records of both kinds into one space finds zeros for the fixed ones."""
    return [object_id or NO_OBJECT for object_id in objects] if any(objects) else []


def _whole_places(locations: Sequence[Location], following: Location) -> int:
    """How many of the locations are answered if the next record lies at `following`: objects may share a place."""
    count = len(locations)
    while count and locations[count - 1] == following:
        count -= 1
    # More objects at one place than an answer holds: the node chooses places so that this cannot come to pass.
    return count or len(locations)


def read_value(transaction: ReadTransaction, table: str, key: bytes) -> bytes | None:
    value = transaction.get(table, key)
    return bytes(value) if value is not None else None


def read_headers(transaction: ReadTransaction) -> dict[SceneId, bytes]:
    return {scene_of(key): bytes(value) for key, value in transaction.scan(HEADERS, b"", b"\xff" * 4)}
