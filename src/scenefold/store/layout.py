"""Tables and bytes of the store (specs/10-store.md).

    records     scene(4) | space(2) | location(20) [| object(16)]  ->  a packed record
    objects     scene(4) | space(2) | object(16)                   ->  location(20), where a node-managed record lies that is not at its home
    headers     scene(4)                                           ->  the scene's public header, opaque here
    statistics  scene(4) | space(2)                                ->  records(8) | bytes(8)
    holding     "arc" | "note" | "copies" | "incarnation"          ->  first(20) | last(20), or nothing; the line's notes; whose they are
    notes       a name                                             ->  a small value that a service wants to survive a restart
    identity    "format" | "node" | "incarnation" | "boot"
    digests     scene(4) | space(2) | level(1) | bound(20)         ->  what lies up to the bound (digest_tree.py)
    debts       as of records                                      ->  version(32) | node(4), for each that is still to get it
    debtors     node(4)                                            ->  records(8) that it is still to get
    suspects    as of records                                      ->  a packed record that a former life has left (suspects.py)
    logs        genesis(32) [| position(8)]                        ->  what is promised and voted for, what is decided (log_rows.py)

A packed record:

    0x8000 + header size(2) | signature size(2) | CRC-32 of header and signature(4) | header | signature | ciphertext

The header holds the SHA-256 of the ciphertext, so with the CRC every byte is covered: what rots on the disk is
found when it is read, and a rotten version number never judges a new record.

All numbers are big endian, so that the order of bytes is the order of the line, and a range is one cursor walk. The key
of a node-managed record goes on behind its location, so it stands among its neighbours on the line.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX, RECORD_OVERHEAD_BYTES_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.crypto import OBJECT_BYTES, Record, RecordHeader, RecordPlace, wanted_place

RECORDS = "records"
OBJECTS = "objects"
HEADERS = "headers"
STATISTICS = "statistics"
HOLDING = "holding"
NOTES = "notes"
IDENTITY = "identity"
DIGESTS = "digests"
DEBTS = "debts"
DEBTORS = "debtors"
SUSPECTS = "suspects"
LOGS = "logs"
TABLES = (RECORDS, OBJECTS, HEADERS, STATISTICS, HOLDING, NOTES, IDENTITY, DIGESTS, DEBTS, DEBTORS, SUSPECTS, LOGS)

FORMER_LIFE = b"former-life"
"""The note that says that records of a former life were not looked through yet."""
OBJECTS_END = b"\xff" * OBJECT_BYTES
"""Behind a location's key: the last object that may lie there."""
NO_OBJECT = bytes(OBJECT_BYTES)
"""No object has this id."""

_SCENE = struct.Struct(">I")
_SPACE = struct.Struct(">IH")
_SIZES = struct.Struct(">HH")
_CHECK = struct.Struct(">I")
_CHECKED = 0x8000
"""Since format 2: the checksum follows."""
HEADER_AT = _SIZES.size + _CHECK.size
"""Where the header of a packed record begins."""
STORED_BYTES_MAX = HEADER_AT + CIPHERTEXT_BYTES_MAX + RECORD_OVERHEAD_BYTES_MAX
"""Of any packed record."""
SPACE_BYTES = _SPACE.size
"""Of the key of a space, with which most keys begin."""
_LOCATION_END = _SPACE.size + LOCATION_BYTES


SpaceAddress = tuple[SceneId, SpaceId]


class Spot(NamedTuple):
    """Where a record is kept: its place, and in a node-managed space its object id (else b"")."""

    place: RecordPlace
    object: bytes = b""

    @property
    def home(self) -> Location:
        """The place whose owner decides about the record: its own, or the one that its object id names."""
        return wanted_place(self.object) if self.object else self.place.location


def scene_key(scene: SceneId) -> bytes:
    return _SCENE.pack(scene)


def scene_of(key: bytes) -> SceneId:
    return SceneId(_SCENE.unpack(key)[0])


def log_note(scene: SceneId) -> bytes:
    """The name of the note that keeps a scene's sealed log."""
    return b"scene-log/%08x" % scene


def space_key(scene: SceneId, space: SpaceId) -> bytes:
    return _SPACE.pack(scene, space)


def space_of(key: bytes) -> tuple[SceneId, SpaceId]:
    """The space of any key that begins with one."""
    scene, space = _SPACE.unpack_from(key)
    return SceneId(scene), SpaceId(space)


def record_key(place: RecordPlace, object_id: bytes = b"") -> bytes:
    return _SPACE.pack(place.scene, place.space) + place.location + object_id


def object_key(scene: SceneId, space: SpaceId, object_id: bytes) -> bytes:
    return _SPACE.pack(scene, space) + object_id


def object_of_key(key: bytes) -> bytes:
    """The object id of a key of the table of objects."""
    return key[_SPACE.size :]


def location_of(key: bytes) -> Location:
    return Location(key[_SPACE.size : _LOCATION_END])


def object_of(key: bytes) -> bytes:
    """The object id of a record's key; b"" in a fixed space."""
    return key[_LOCATION_END:]


def spot_of(key: bytes) -> Spot:
    return Spot(RecordPlace(*space_of(key), location_of(key)), object_of(key))


def pack_record(record: Record) -> bytes:
    header, signature = record.header_bytes, record.signature
    sizes = _SIZES.pack(_CHECKED | len(header), len(signature))
    return b"".join((sizes, _CHECK.pack(_checksum(header, signature)), header, signature, record.ciphertext))


def unpack_record(value: memoryview) -> Record:
    """A copy of the record in a stored value; DamagedData if it is not what was stored. Some 40 us for a full one."""
    header = _checked_header(value)
    signature_end = _ends(value)[1]
    record = Record(
        header_bytes=header,
        signature=bytes(value[HEADER_AT + len(header) : signature_end]),
        ciphertext=bytes(value[signature_end:]),
    )
    if hashlib.sha256(record.ciphertext).digest() != RecordHeader.decode(record.header_bytes).digest:
        left = "have changed on the disk" if record.ciphertext else "are lost, here and where they came from: only its header is left"
        raise DamagedData(f"the bytes of a stored record {left}")
    return record


def remains_of(value: memoryview) -> Record | None:
    """The header and the signature of a stored value, without a ciphertext; None if they are not what was written."""
    header = sound_header(value)
    return None if header is None else Record(header, bytes(value[HEADER_AT + len(header) : _ends(value)[1]]), b"")


def sound_header(value: memoryview) -> bytes | None:
    """The bytes of a stored value's header; None if they are not what was written."""
    try:
        return _checked_header(value)
    except DamagedData:
        return None


def stored_header(value: memoryview) -> RecordHeader:
    """Only the header of a stored value, so that judging versions never touches the ciphertext's pages."""
    return RecordHeader.decode(_checked_header(value))


def _checked_header(value: memoryview) -> bytes:
    header_end, signature_end = _ends(value)
    if _CHECK.unpack_from(value, _SIZES.size)[0] != zlib.crc32(value[HEADER_AT:signature_end]):
        raise DamagedData("the header of a stored record has changed on the disk")
    return bytes(value[HEADER_AT:header_end])


def _checksum(header: bytes, signature: bytes) -> int:
    return zlib.crc32(signature, zlib.crc32(header))


def _ends(value: memoryview) -> tuple[int, int]:
    if not HEADER_AT <= len(value) <= STORED_BYTES_MAX:
        # Where the tree says so, what is taken for the record goes on behind the end of the file.
        raise DamagedData("a stored record is shorter than its sizes, or longer than any")
    header_bytes, signature_bytes = _SIZES.unpack_from(value)
    if not header_bytes & _CHECKED:
        raise DamagedData("the sizes of a stored record have changed on the disk")
    header_end = HEADER_AT + (header_bytes & ~_CHECKED)
    signature_end = header_end + signature_bytes
    if signature_end > len(value):
        raise DamagedData("a stored record is shorter than its header and signature")
    return header_end, signature_end
