"""Tables and bytes of the store (specs/10-store.md).

    records     scene(4) | space(2) | location(20)  ->  header size(2) | signature size(2) | header | signature | ciphertext
    headers     scene(4)                            ->  the scene's public header, opaque here
    statistics  scene(4) | space(2)                 ->  records(8) | bytes(8)
    notes       a name                              ->  a small value that a service wants to survive a restart
    identity    "format" | "node" | "incarnation" | "boot"

All numbers are big endian, so that the order of bytes is the order of the line, and a range is one cursor walk.
"""

from __future__ import annotations

import struct

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import Record, RecordPlace

RECORDS = "records"
HEADERS = "headers"
STATISTICS = "statistics"
NOTES = "notes"
IDENTITY = "identity"
TABLES = (RECORDS, HEADERS, STATISTICS, NOTES, IDENTITY)

_SCENE = struct.Struct(">I")
_SPACE = struct.Struct(">IH")
_SIZES = struct.Struct(">HH")


def scene_key(scene: SceneId) -> bytes:
    return _SCENE.pack(scene)


def scene_of(key: bytes) -> SceneId:
    return SceneId(_SCENE.unpack(key)[0])


def space_key(scene: SceneId, space: SpaceId) -> bytes:
    return _SPACE.pack(scene, space)


def space_of(key: bytes) -> tuple[SceneId, SpaceId]:
    scene, space = _SPACE.unpack(key)
    return SceneId(scene), SpaceId(space)


def record_key(place: RecordPlace) -> bytes:
    return _SPACE.pack(place.scene, place.space) + place.location


def location_of(key: bytes) -> Location:
    return Location(key[_SPACE.size :])


def pack_record(record: Record) -> bytes:
    header, signature = record.header_bytes, record.signature
    return b"".join((_SIZES.pack(len(header), len(signature)), header, signature, record.ciphertext))


def unpack_record(value: memoryview) -> Record:
    """A copy of the record in a stored value; DamagedData if its sizes cannot be."""
    header_end, signature_end = _ends(value)
    return Record(
        header_bytes=bytes(value[_SIZES.size : header_end]),
        signature=bytes(value[header_end:signature_end]),
        ciphertext=bytes(value[signature_end:]),
    )


def stored_header(value: memoryview) -> bytes:
    """Only the header of a stored value, so that judging versions never touches the ciphertext's pages."""
    return bytes(value[_SIZES.size : _ends(value)[0]])


def _ends(value: memoryview) -> tuple[int, int]:
    if len(value) < _SIZES.size:
        raise DamagedData("a stored record is shorter than its sizes")
    header_bytes, signature_bytes = _SIZES.unpack_from(value)
    header_end = _SIZES.size + header_bytes
    signature_end = header_end + signature_bytes
    if signature_end > len(value):
        raise DamagedData("a stored record is shorter than its header and signature")
    return header_end, signature_end
