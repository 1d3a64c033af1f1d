"""Packets 41 to 43, 64 to 70 and 73: pieces of the line pass from node to node, with what lies in them (specs/12-line.md).

Who gives speaks, who receives answers: offer, what there is, what is wanted, the records, the claim. Every step
names its handover by 16 random bytes and may be repeated. ConfirmBound asks a left neighbour where a dead node's arc
began, HandRecords brings records home that lie where they no longer belong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import HANDOVER_BATCH_RECORDS_MAX
from scenefold.wire.common import (
    BOOL,
    CIPHERTEXT,
    DIGEST,
    HANDOVER,
    HEADER,
    LOCATION,
    MESSAGE,
    OBJECT,
    REASON_OR_0,
    SCENE,
    SIGNATURE,
    SPACE,
    U64,
    Carrier,
    Location,
    Packet,
    SceneId,
    SpaceId,
    row,
)
from scenefold.wire.containers import Many, Struct
from scenefold.wire.custody import PASSED_SEGMENTS, Passed, PassedSegment
from scenefold.wire.kinds import Maybe, Uint
from scenefold.wire.laws import All, Inside, Order
from scenefold.wire.members import MEMBER, Member


@dataclass(frozen=True, slots=True)
class HandItem:
    """A whole record with its place. `object`: its id in a node-managed space, else empty."""

    scene: SceneId
    space: SpaceId
    location: Location
    object: bytes
    signature: bytes
    header: bytes
    ciphertext: bytes


@dataclass(frozen=True, slots=True)
class RecordEntry:
    """One exact version of a record, without it: `digest` is the SHA-256 of its ciphertext."""

    scene: SceneId
    space: SpaceId
    location: Location
    object: bytes
    digest: bytes


_PLACE = (("scene", SCENE), ("space", SPACE), ("location", LOCATION), ("object", OBJECT))
HAND_ITEM = Struct(HandItem, *_PLACE, ("signature", SIGNATURE), ("header", HEADER), ("ciphertext", CIPHERTEXT))
RECORD_ENTRY = Struct(RecordEntry, *_PLACE, ("digest", DIGEST))
HAND_ITEMS = Many(HAND_ITEM, HANDOVER_BATCH_RECORDS_MAX)


@dataclass(frozen=True, slots=True)
class OfferRange(Packet):
    """Will you take this piece of my arc? `records` and `bytes`: about how much lies in it."""

    TYPE: ClassVar[int] = 41
    handover: bytes
    giver: Member
    receiver: Member
    first: Location
    last: Location
    records: int
    bytes: int
    log_position: int


@dataclass(frozen=True, slots=True)
class ClaimRange(Packet):
    """The piece is yours: I have durably let it go. Answered once the receiver durably owns it."""

    TYPE: ClassVar[int] = 42
    handover: bytes
    first: Location
    last: Location
    number: int = 0
    """Below it the giver takes nothing there any more as a holder; nor does the receiver number anything."""
    segments: tuple[PassedSegment, ...] = ()
    """Who holds copies of the piece: the receiver goes on with them."""


@dataclass(frozen=True, slots=True)
class CopyRecords(Packet):
    """Records of the piece. Answered once they are durable."""

    TYPE: ClassVar[int] = 43
    handover: bytes
    items: tuple[HandItem, ...]


@dataclass(frozen=True, slots=True)
class HandoverReply(Packet):
    """`reason` 0: so it is; else a RejectReason, and `text` says more."""

    TYPE: ClassVar[int] = 64
    handover: bytes
    reason: int
    text: str


@dataclass(frozen=True, slots=True)
class OfferRecords(Packet):
    """These versions lie in the piece: which of them do you lack?"""

    TYPE: ClassVar[int] = 65
    handover: bytes
    entries: tuple[RecordEntry, ...]


@dataclass(frozen=True, slots=True)
class RecordsWanted(Packet):
    """Positions in the list of an OfferRecords."""

    TYPE: ClassVar[int] = 66
    handover: bytes
    indexes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class DropHandover(Packet):
    """The giver keeps its piece: forget that it was offered."""

    TYPE: ClassVar[int] = 67
    handover: bytes


@dataclass(frozen=True, slots=True)
class AskRange(Packet):
    """A node without an arc asks its right neighbour for a part of its arc, up to `place` if one is named.

    HandoverReply's handover is 16 zero bytes; reason 0: an offer will come.
    """

    TYPE: ClassVar[int] = 68
    receiver: Member
    place: Location | None


@dataclass(frozen=True, slots=True)
class ConfirmBound(Packet):
    """Where does your arc end? From the right neighbour, whose own arc begins at `first`."""

    TYPE: ClassVar[int] = 69
    asker: Member
    log_position: int
    first: Location


@dataclass(frozen=True, slots=True)
class BoundConfirmed(Packet):
    """`right_bound` is durable; None: the answerer owns nothing. `pending`: a handover on the asker's side is open.

    `revision` rises with every change of the answerer's holding, so that an asker of several sees whether one changed.
    """

    TYPE: ClassVar[int] = 70
    reason: int
    right_bound: Location | None
    pending: bool
    log_position: int
    revision: int


@dataclass(frozen=True, slots=True)
class HandRecords(Packet):
    """Records that lie in the wrong place, for their owner to verify and judge. Answered by a PutManyReply."""

    TYPE: ClassVar[int] = 73
    items: tuple[HandItem, ...]


_HANDOVER = ("handover", HANDOVER)
_PIECE = (("first", LOCATION), ("last", LOCATION))
_ASCENDING = Order("first", "last")
_INDEX = Uint(16, most=HANDOVER_BATCH_RECORDS_MAX - 1)

ROWS = (
    row(
        OfferRange,
        Carrier.TCP_LOW,
        _HANDOVER,
        ("giver", MEMBER),
        ("receiver", MEMBER),
        *_PIECE,
        ("records", U64),
        ("bytes", U64),
        ("log_position", U64),
        law=_ASCENDING,
    ),
    row(
        ClaimRange,
        Carrier.TCP_LOW,
        _HANDOVER,
        *_PIECE,
        ("number", U64),
        ("segments", PASSED_SEGMENTS),
        law=All((_ASCENDING, Inside("segments"), Passed())),
    ),
    row(CopyRecords, Carrier.TCP_LOW, _HANDOVER, ("items", HAND_ITEMS)),
    row(HandoverReply, Carrier.TCP_LOW, _HANDOVER, ("reason", REASON_OR_0), ("text", MESSAGE)),
    row(OfferRecords, Carrier.TCP_LOW, _HANDOVER, ("entries", Many(RECORD_ENTRY, HANDOVER_BATCH_RECORDS_MAX))),
    row(RecordsWanted, Carrier.TCP_LOW, _HANDOVER, ("indexes", Many(_INDEX, HANDOVER_BATCH_RECORDS_MAX))),
    row(DropHandover, Carrier.TCP_LOW, _HANDOVER),
    row(AskRange, Carrier.TCP_LOW, ("receiver", MEMBER), ("place", Maybe(LOCATION))),
    row(ConfirmBound, Carrier.TCP_LOW, ("asker", MEMBER), ("log_position", U64), ("first", LOCATION)),
    row(
        BoundConfirmed,
        Carrier.TCP_LOW,
        ("reason", REASON_OR_0),
        ("right_bound", Maybe(LOCATION)),
        ("pending", BOOL),
        ("log_position", U64),
        ("revision", U64),
    ),
    row(HandRecords, Carrier.TCP_LOW, ("items", HAND_ITEMS)),
)
STRUCTS = (HAND_ITEM, RECORD_ENTRY)
