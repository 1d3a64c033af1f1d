"""Packets 10 to 18, and their bulk forms 32 to 35: records go in and out, ranges are listed (thesis C.4).

A record travels as three byte strings: signature, header (clear, signed) and ciphertext. What is inside them
is the business of `crypto` (specs/04-records.md); here they only have bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import BULK_ITEMS_MAX, RANGE_LOCATIONS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.common import (
    BOOL,
    CIPHERTEXT,
    HEADER,
    LOCATION,
    OBJECT,
    REASON,
    REASON_OR_0,
    SCENE,
    SIGNATURE,
    SPACE,
    U32,
    U64,
    Carrier,
    Location,
    NodeId,
    Packet,
    SceneId,
    SpaceId,
    records_bytes_max,
    row,
)
from scenefold.wire.containers import Many, Struct, many_locations, many_of_size
from scenefold.wire.kinds import Maybe
from scenefold.wire.laws import All, Order, Pairs
from scenefold.wire.scene_headers import SCENE_LOG_PUBLIC, SceneLogPublic

NO_NODE = NodeId(0)


@dataclass(frozen=True, slots=True)
class PutItem:
    """One record of a PutMany. What it may replace its header says."""

    scene: SceneId
    space: SpaceId
    location: Location
    signature: bytes
    header: bytes
    ciphertext: bytes


@dataclass(frozen=True, slots=True)
class PutOutcome:
    """What became of one record: `reason` 0 is stored; `owner` is the node to ask instead, the answerer itself if it stored nothing for want of a lease, or 0."""

    reason: int
    location: Location
    owner: NodeId


@dataclass(frozen=True, slots=True)
class RecordKey:
    """`object`: the record's id in a node-managed space, empty in a fixed one."""

    space: SpaceId
    location: Location
    object: bytes = b""


@dataclass(frozen=True, slots=True)
class RecordBytes:
    """A record as it travels."""

    signature: bytes
    header: bytes
    ciphertext: bytes


DAMAGED_RECORD = RecordBytes(bytes(64), b"", b"")
"""In a GetManyReply: a record is there and has changed on its owner's disk. No record has an empty header."""


PUT_ITEM = Struct(
    PutItem,
    ("scene", SCENE),
    ("space", SPACE),
    ("location", LOCATION),
    ("signature", SIGNATURE),
    ("header", HEADER),
    ("ciphertext", CIPHERTEXT),
)
PUT_OUTCOME = Struct(PutOutcome, ("reason", REASON_OR_0), ("location", LOCATION), ("owner", U32))
RECORD_KEY = Struct(RecordKey, ("space", SPACE), ("location", LOCATION), ("object", OBJECT))
RECORD_BYTES = Struct(RecordBytes, ("signature", SIGNATURE), ("header", HEADER), ("ciphertext", CIPHERTEXT))


@dataclass(frozen=True, slots=True)
class ProposeData(Packet):
    """Store this record, as PutItem."""

    TYPE: ClassVar[int] = 10
    scene: SceneId
    space: SpaceId
    location: Location
    signature: bytes
    header: bytes
    ciphertext: bytes


@dataclass(frozen=True, slots=True)
class AcceptData(Packet):
    """Durable. `location` differs from the asked one in a node-managed space only."""

    TYPE: ClassVar[int] = 11
    signature: bytes
    location: Location


@dataclass(frozen=True, slots=True)
class RejectData(Packet):
    """Not stored. `owner` with reason 10, else 0; `public` where the author's header is behind."""

    TYPE: ClassVar[int] = 12
    reason: RejectReason
    owner: NodeId = NO_NODE
    public: SceneLogPublic | None = None


@dataclass(frozen=True, slots=True)
class GetData(Packet):
    """`position`: how far the reader knows the scene's log; `object` as in RecordKey."""

    TYPE: ClassVar[int] = 13
    scene: SceneId
    space: SpaceId
    location: Location
    position: int
    object: bytes = b""


@dataclass(frozen=True, slots=True)
class ReturnData(Packet):
    """`stale`: a newer version may exist elsewhere, since the answerer holds no owner lease."""

    TYPE: ClassVar[int] = 14
    scene: SceneId
    space: SpaceId
    location: Location
    signature: bytes
    header: bytes
    ciphertext: bytes
    position: int
    write_floor: int
    stale: bool = False


@dataclass(frozen=True, slots=True)
class EmptyData(Packet):
    """The owner, under its lease, says: nothing is there."""

    TYPE: ClassVar[int] = 15
    scene: SceneId
    space: SpaceId
    location: Location
    position: int
    write_floor: int


@dataclass(frozen=True, slots=True)
class QueryRange(Packet):
    """Which locations between `first` and `last`, both included, hold a record?"""

    TYPE: ClassVar[int] = 16
    BULK_ANSWER: ClassVar[bool] = True
    scene: SceneId
    space: SpaceId
    first: Location
    last: Location


@dataclass(frozen=True, slots=True)
class ReturnRange(Packet):
    """Every location held between `first` and `last`, the part that this answer covers.

    `objects`: in a node-managed space the id of each record, beside its location; else empty. `stale`: more or others
    may exist elsewhere.
    """

    TYPE: ClassVar[int] = 17
    scene: SceneId
    space: SpaceId
    first: Location
    last: Location
    locations: tuple[Location, ...]
    objects: tuple[bytes, ...] = ()
    stale: bool = False


@dataclass(frozen=True, slots=True)
class RejectRange(Packet):
    TYPE: ClassVar[int] = 18
    scene: SceneId
    space: SpaceId
    location: Location
    reason: RejectReason


@dataclass(frozen=True, slots=True)
class PutMany(Packet):
    """Store these records; each has its own outcome."""

    TYPE: ClassVar[int] = 32
    items: tuple[PutItem, ...]


@dataclass(frozen=True, slots=True)
class PutManyReply(Packet):
    """One outcome for each item, in order; what is stored is durable."""

    TYPE: ClassVar[int] = 33
    outcomes: tuple[PutOutcome, ...]


@dataclass(frozen=True, slots=True)
class GetMany(Packet):
    TYPE: ClassVar[int] = 34
    BULK_ANSWER: ClassVar[bool] = True
    scene: SceneId
    position: int
    keys: tuple[RecordKey, ...]

    def answer_bytes_max(self) -> int:
        return records_bytes_max(len(self.keys))


@dataclass(frozen=True, slots=True)
class GetManyReply(Packet):
    """Records of the first keys asked for, in order, as many as fit a frame (at least one); None: nothing there.

    DAMAGED_RECORD: something is there that nobody can have. The asker asks again for the rest. `stale`: of some record a newer version may exist.
    `position`, `write_floor`: of the oldest header that an answerer goes by.
    """

    TYPE: ClassVar[int] = 35
    records: tuple[RecordBytes | None, ...]
    stale: bool = False
    position: int = 0
    write_floor: int = 0


_KEY = (("scene", SCENE), ("space", SPACE), ("location", LOCATION))
_RECORD = (("signature", SIGNATURE), ("header", HEADER), ("ciphertext", CIPHERTEXT))
_FRESHNESS = (("position", U64), ("write_floor", U64))
_ASCENDING = Order("first", "last")
_RANGE = (("scene", SCENE), ("space", SPACE), ("first", LOCATION), ("last", LOCATION))

ROWS = (
    row(ProposeData, Carrier.TCP_LOW, *_KEY, *_RECORD),
    row(AcceptData, Carrier.TCP_LOW, ("signature", SIGNATURE), ("location", LOCATION)),
    row(RejectData, Carrier.TCP_LOW, ("reason", REASON), ("owner", U32), ("public", Maybe(SCENE_LOG_PUBLIC))),
    row(GetData, Carrier.TCP_LOW, *_KEY, ("position", U64), ("object", OBJECT)),
    row(ReturnData, Carrier.TCP_LOW, *_KEY, *_RECORD, *_FRESHNESS, ("stale", BOOL)),
    row(EmptyData, Carrier.TCP_LOW, *_KEY, *_FRESHNESS),
    row(QueryRange, Carrier.BOTH_LOW, *_RANGE, law=_ASCENDING),
    row(
        ReturnRange,
        Carrier.BOTH_LOW,
        *_RANGE,
        ("locations", many_locations(RANGE_LOCATIONS_MAX)),
        ("objects", many_of_size(16, RANGE_LOCATIONS_MAX)),
        ("stale", BOOL),
        law=All((_ASCENDING, Pairs("objects", "locations"))),
    ),
    row(RejectRange, Carrier.BOTH_LOW, *_KEY, ("reason", REASON)),
    row(PutMany, Carrier.TCP_LOW, ("items", Many(PUT_ITEM, BULK_ITEMS_MAX))),
    row(PutManyReply, Carrier.TCP_LOW, ("outcomes", Many(PUT_OUTCOME, BULK_ITEMS_MAX))),
    row(GetMany, Carrier.TCP_LOW, ("scene", SCENE), ("position", U64), ("keys", Many(RECORD_KEY, BULK_ITEMS_MAX))),
    row(GetManyReply, Carrier.TCP_LOW, ("records", Many(Maybe(RECORD_BYTES), BULK_ITEMS_MAX)), ("stale", BOOL), *_FRESHNESS),
)
STRUCTS = (PUT_ITEM, PUT_OUTCOME, RECORD_KEY, RECORD_BYTES)
