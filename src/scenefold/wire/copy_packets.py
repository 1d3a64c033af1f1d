"""Packets 44, 87, 90, 91, 96, 97, 114 and 115: copies are stored, read, and compared (specs/20-copies.md, Writes, Reads, Repair)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

from scenefold.base.limits import (
    BULK_ITEMS_MAX,
    COMPARED_ARCS_MAX,
    COMPARED_RECORDS_MAX,
    COPIES_TOLD_MAX,
    CUSTODY_ENTRIES_MAX,
    HANDOVER_BATCH_RECORDS_MAX,
)
from scenefold.base.location import Arc
from scenefold.wire.common import (
    BOOL,
    DIGEST,
    LOCATION,
    MESSAGE,
    OBJECT,
    REASON_OR_0,
    SCENE,
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
from scenefold.wire.containers import Many, Struct
from scenefold.wire.custody import CONFIGURATION, Configuration
from scenefold.wire.custody_packets import RECORD_VERSION, RecordVersion
from scenefold.wire.data_packets import RECORD_BYTES, RECORD_KEY, RecordBytes, RecordKey
from scenefold.wire.handover_packets import HAND_ITEMS, HandItem
from scenefold.wire.kinds import Bin, Choice, Maybe, Uint
from scenefold.wire.laws import All, Only, Order
from scenefold.wire.members import MEMBER, Member


@dataclass(frozen=True, slots=True)
class Span:
    """An arc of the line, as packets name several of them."""

    first: Location
    last: Location

    @property
    def arc(self) -> Arc:
        return Arc(self.first, self.last)


@dataclass(frozen=True, slots=True)
class ListedRecord:
    """A record of an arc that two nodes compare."""

    location: Location
    object: bytes
    version: RecordVersion


@dataclass(frozen=True, slots=True)
class ArcSum:
    """What lies in one arc: how many records, the sum of their digests, and which they are, if they are few (None: they are not)."""

    count: int
    sum: bytes
    records: tuple[ListedRecord, ...] | None
    whole: bool
    """The answerer owns all of the arc, or holds a whole copy of it; else more may belong there."""


class CopyState(IntEnum):
    """What a holder says of one key."""

    NO_CUSTODY = 0
    NOTHING = 1
    RECORD = 2
    DIGEST = 3
    DAMAGED = 4


@dataclass(frozen=True, slots=True)
class Copy:
    """One key of a GetCopies. `holders`: under which of the holders of its packet the answer counts, 0 with NO_CUSTODY."""

    state: CopyState
    holders: int
    digest: bytes
    record: RecordBytes | None


@dataclass(frozen=True, slots=True)
class CompareRange(Packet):
    """What lies in these arcs of a space? Of each with no more than `list_below` records a list is wanted beside the sum."""

    TYPE: ClassVar[int] = 44
    scene: SceneId
    space: SpaceId
    arcs: tuple[Span, ...]
    list_below: int


@dataclass(frozen=True, slots=True)
class RangeCompared(Packet):
    """For each arc, in order."""

    TYPE: ClassVar[int] = 87
    sums: tuple[ArcSum, ...]


@dataclass(frozen=True, slots=True)
class GetCopies(Packet):
    """Records of a scene, from one who holds copies of them. `position`: how far the reader knows the scene's log.

    `digests_only`: of what is there its digest is enough. `any_copy`: also without a lease, and where the copy is not whole.
    """

    TYPE: ClassVar[int] = 90
    BULK_ANSWER: ClassVar[bool] = True
    scene: SceneId
    position: int
    keys: tuple[RecordKey, ...]
    digests_only: bool
    any_copy: bool

    def answer_bytes_max(self) -> int:
        return records_bytes_max(len(self.keys))


@dataclass(frozen=True, slots=True)
class CopiesFound(Packet):
    """Of the first keys asked for, in order, as many as fit a frame (at least one). The asker asks again for the rest."""

    TYPE: ClassVar[int] = 91
    holders: tuple[Configuration, ...]
    copies: tuple[Copy, ...]


@dataclass(frozen=True, slots=True)
class StoreCopies(Packet):
    """Hold these, which `owner` owns: each is verified and merged. Answered once what is taken, or something newer, is durable."""

    TYPE: ClassVar[int] = 96
    owner: Member
    items: tuple[HandItem, ...]


@dataclass(frozen=True, slots=True)
class CopiesStored(Packet):
    """A reason for each item, in order; 0: it is durable here, or something newer is. `text`: of the first that was refused."""

    TYPE: ClassVar[int] = 97
    reasons: tuple[int, ...]
    text: str


@dataclass(frozen=True, slots=True)
class LookAtCopies(Packet):
    """A reader to an owner: what this node has of these, as one that holds their copies, is not what counts."""

    TYPE: ClassVar[int] = 114
    scene: SceneId
    holder: NodeId
    keys: tuple[RecordKey, ...]


@dataclass(frozen=True, slots=True)
class CopiesLookedAt(Packet):
    """So many of them are going to be compared."""

    TYPE: ClassVar[int] = 115
    taken: int


@dataclass(frozen=True, slots=True)
class Listed:
    """A list of an arc is complete."""

    def holds(self, value: Any) -> bool:
        return value.records is None or len(value.records) == value.count

    def __str__(self) -> str:
        return "records nil or as many as count"


@dataclass(frozen=True, slots=True)
class Counted:
    """Every answer that counts at all counts under holders that the packet names."""

    def holds(self, value: Any) -> bool:
        known = len(value.holders)
        return all(copy.holders < known if copy.state else copy.holders == 0 for copy in value.copies)

    def __str__(self) -> str:
        return "holders of copies a place in holders, 0 with NO_CUSTODY"


SPAN = Struct(Span, ("first", LOCATION), ("last", LOCATION), law=Order("first", "last"))
LISTED_RECORD = Struct(ListedRecord, ("location", LOCATION), ("object", OBJECT), ("version", RECORD_VERSION))
ARC_SUM = Struct(
    ArcSum,
    ("count", U64),
    ("sum", DIGEST),
    ("records", Maybe(Many(LISTED_RECORD, COMPARED_RECORDS_MAX))),
    ("whole", BOOL),
    law=Listed(),
)
COPY = Struct(
    Copy,
    ("state", Choice(CopyState)),
    ("holders", Uint(16, most=CUSTODY_ENTRIES_MAX - 1)),
    ("digest", Bin(lengths=(0, 32))),
    ("record", Maybe(RECORD_BYTES)),
    law=All((Only("digest", "state", CopyState.DIGEST), Only("record", "state", CopyState.RECORD))),
)
STRUCTS = (SPAN, LISTED_RECORD, ARC_SUM, COPY)

ROWS = (
    row(
        CompareRange,
        Carrier.TCP_LOW,
        ("scene", SCENE),
        ("space", SPACE),
        ("arcs", Many(SPAN, COMPARED_ARCS_MAX)),
        ("list_below", Uint(16, most=COMPARED_RECORDS_MAX)),
    ),
    row(RangeCompared, Carrier.TCP_LOW, ("sums", Many(ARC_SUM, COMPARED_ARCS_MAX))),
    row(
        GetCopies,
        Carrier.TCP_LOW,
        ("scene", SCENE),
        ("position", U64),
        ("keys", Many(RECORD_KEY, BULK_ITEMS_MAX)),
        ("digests_only", BOOL),
        ("any_copy", BOOL),
    ),
    row(
        CopiesFound,
        Carrier.TCP_LOW,
        ("holders", Many(CONFIGURATION, CUSTODY_ENTRIES_MAX)),
        ("copies", Many(COPY, BULK_ITEMS_MAX)),
        law=Counted(),
    ),
    row(StoreCopies, Carrier.TCP_LOW, ("owner", MEMBER), ("items", HAND_ITEMS)),
    row(CopiesStored, Carrier.TCP_LOW, ("reasons", Many(REASON_OR_0, HANDOVER_BATCH_RECORDS_MAX)), ("text", MESSAGE)),
    row(LookAtCopies, Carrier.TCP_LOW, ("scene", SCENE), ("holder", U32), ("keys", Many(RECORD_KEY, COPIES_TOLD_MAX))),
    row(CopiesLookedAt, Carrier.TCP_LOW, ("taken", Uint(16, most=COPIES_TOLD_MAX))),
)
