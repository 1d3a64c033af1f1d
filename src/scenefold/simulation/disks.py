"""What lies on the true disks of all machines, whoever believes what: records by place and version, arcs, incarnations."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Protocol

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import LOCATION_BYTES, Arc, Location
from scenefold.crypto import RecordPlace
from scenefold.crypto.record_header import version_key
from scenefold.peer.cluster_log.held_notes import READY, unpack_ready
from scenefold.peer.cluster_log.lives import Lives, note_of, unpack_granted, unpack_lives
from scenefold.peer.cluster_log.own_life import NOTE as LIVES_NOTE
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.copies_note import decode_copies
from scenefold.peer.line.holding import Handover, Step
from scenefold.peer.line.holding_note import decode_holding
from scenefold.simulation.history import Place, Version
from scenefold.store.layout import (
    HOLDING,
    IDENTITY,
    NOTES,
    OBJECTS,
    RECORDS,
    location_of,
    object_key,
    object_of,
    record_key,
    space_of,
    spot_of,
    stored_header,
)
from scenefold.store.sealing import opened
from scenefold.wire import Member

_ARC = b"arc"
_NOTE = b"note"
_INCARNATION = b"incarnation"
_COPIES = b"copies"
_NODE = b"node"


class Disk(Protocol):
    """What of a simulated disk is looked at."""

    def peek(self, table: str, /) -> Mapping[bytes, bytes]: ...
    def written(self, table: str, /) -> Mapping[bytes, bytes]: ...
    def replaced(self, table: str, /) -> list[tuple[bytes, bytes | None]]: ...
    def rotten(self, table: str, /) -> Mapping[bytes, bytes]: ...


def note_on(disk: Disk, name: str) -> bytes | None:
    """A service's note, as its node has written it last."""
    return _kept(disk, NOTES, name.encode())


def _kept(disk: Disk, table: str, key: bytes) -> bytes | None:
    """What a node has written, also if it has rotted since: until the node stops over that, it acts by it."""
    stored = disk.written(table).get(key)
    return None if stored is None else bytes(opened(table, key, memoryview(stored)))


def arc_of(disk: Disk) -> Arc | None:
    """The arc that puts are checked against."""
    value = _kept(disk, HOLDING, _ARC)
    if not value:
        return None
    return Arc(Location(value[:LOCATION_BYTES]), Location(value[LOCATION_BYTES:]))


def holding_of(disk: Disk) -> tuple[bytes | None, bytes | None]:
    """The stored bytes of a node's arc and of the line's note, to notice changes by."""
    table = disk.written(HOLDING)
    return table.get(_ARC), table.get(_NOTE)


def receivers_of(disk: Disk) -> list[tuple[Arc, Member]]:
    """The pieces that a node is giving away, each with whom it goes to, as its note says."""
    note = _kept(disk, HOLDING, _NOTE)
    if not note:
        return []
    return [(handover.piece, handover.peer) for _, handover in decode_holding(note).handovers if handover.gives]


def handovers_of(disk: Disk) -> list[Handover]:
    """What is under way here, on either side, down to the last deletion."""
    note = _kept(disk, HOLDING, _NOTE)
    return [handover for _, handover in decode_holding(note).handovers] if note else []


def counted(disk: Disk, taken: Collection[Place] = ()) -> dict[Place, Version]:
    """The records on a disk that count: not those that its node has given away for good and is about to delete.

    `taken`: what another node durably owned a moment ago. If this one has released it, the other's word of that may be on its way.
    """
    return counting_of(disk, records_of(disk), taken)


def counting_of(disk: Disk, records: dict[Place, Version], taken: Collection[Place] = ()) -> dict[Place, Version]:
    """Likewise, of some records that lie on the disk."""
    found = dict(records)
    for handover in handovers_of(disk):
        if handover.step in (Step.GIVEN, Step.RELEASED):
            for place in records_of(disk, handover.piece):
                if handover.step is Step.GIVEN or place in taken:
                    found.pop(place, None)
    return found


def has_open_handover(disk: Disk) -> bool:
    """Whether a handover is under way here, on either side, down to the last deletion."""
    return bool(handovers_of(disk))


def incarnation_of(disk: Disk) -> bytes | None:
    """The incarnation under which the disk's node runs, or ran last."""
    return _kept(disk, IDENTITY, _INCARNATION)


def lives_of(disk: Disk) -> Lives:
    """Under which lives the disk's node asks for leases."""
    note = note_on(disk, LIVES_NOTE)
    return unpack_lives(note) if note else Lives()


def granted_life(voter: Disk, node: NodeId) -> tuple[bytes, int] | None:
    """Under which incarnation and life a node was last granted a lease, as the voter's disk has it."""
    note = note_on(voter, note_of(node))
    return unpack_granted(note) if note else None


def ready_at(voter: Disk) -> int:
    """The newest change of voters as of which this one knows what those before granted; 0 if there is none."""
    note = _kept(voter, NOTES, READY.encode())
    return unpack_ready(note) if note else 0


def records_of(disk: Disk, arc: Arc | None = None) -> dict[Place, Version]:
    """Every record that can be read (in an arc), with its version. Node-managed ones are named by object, not by location."""
    found: dict[Place, Version] = {}
    for key, value in disk.peek(RECORDS).items():
        if arc is not None and spot_of(key).home not in arc:
            continue
        version = version_in(value)
        if version is not None:
            found[place_of(key)] = version
    return found


def version_at(disk: Disk, place: Place, location: Location) -> Version | None:
    """The readable version of one record at a location."""
    value = disk.peek(RECORDS).get(_key_at(place, location))
    return None if value is None else version_in(value)


def key_of_place(place: Place) -> bytes:
    """The key of a record that has a place of its own."""
    return _key_at(place, Location(place.location))


def found_at(disk: Disk, place: Place) -> Version | None:
    """The readable version of one record, wherever on the line an object lies."""
    location = place.home
    if place.is_object:
        stored = disk.peek(OBJECTS).get(object_key(SceneId(place.scene), SpaceId(place.space), place.location))
        if stored is not None:
            location = Location(stored[:LOCATION_BYTES])
    return version_at(disk, place, location)


def copies_of(disk: Disk) -> Copies | None:
    """What the disk's node keeps about copies; None if nothing, or another incarnation's."""
    note, incarnation = _kept(disk, HOLDING, _COPIES), incarnation_of(disk)
    node = _kept(disk, IDENTITY, _NODE)
    if not note or incarnation is None or not node:
        return None
    return _decoded(note, Member(NodeId(int.from_bytes(node, "big")), incarnation))


@lru_cache(maxsize=64)
def _decoded(note: bytes, me: Member) -> Copies | None:
    # Each disk is looked at many times a second, and changes seldom.
    try:
        return decode_copies(note, me)
    except DamagedData:
        return None


def _key_at(place: Place, location: Location) -> bytes:
    object_id = place.location if place.is_object else b""
    return record_key(RecordPlace(SceneId(place.scene), SpaceId(place.space), location), object_id)


def keys_outside(disk: Disk, arc: Arc | None) -> list[bytes]:
    """Keys of records whose homes lie outside of an arc: all of them if there is none."""
    return [key for key in disk.peek(RECORDS) if arc is None or spot_of(key).home not in arc]


def objects_decided(disk: Disk) -> list[Place]:
    """The node-managed records that this disk's node decides about, as often as they lie there."""
    arc = arc_of(disk)
    if arc is None:
        return []
    return [place for place in map(place_of, disk.peek(RECORDS)) if place.is_object and place.home in arc]


def place_of(key: bytes) -> Place:
    """How histories call the record with this key."""
    scene, space = space_of(key)
    return Place(scene, space, object_of(key) or location_of(key))


def version_in(value: bytes) -> Version | None:
    """Of a stored record; None if that cannot be read."""
    try:
        header = stored_header(memoryview(value))
    except DamagedData:
        return None
    return Version(version_key(header), header.digest)
