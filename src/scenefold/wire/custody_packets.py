"""Packets 88, 89, 92 to 95, 100 and 101: who is to hold what, what a node holds of a gap, and of places that are others'.

specs/20-copies.md, Custody, Recovery; 12-line.md, Strays.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

from scenefold.base.limits import HANDOVER_BATCH_RECORDS_MAX, HELD_CURSOR_BYTES_MAX, SCENES_KEPT_MAX
from scenefold.wire.common import (
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
    KeyId,
    Location,
    Packet,
    SceneId,
    SpaceId,
    row,
)
from scenefold.wire.containers import Many, Struct
from scenefold.wire.custody import CUSTODY_ENTRIES, CustodyEntry
from scenefold.wire.handover_packets import HAND_ITEMS, RECORD_ENTRY, HandItem, RecordEntry
from scenefold.wire.kinds import Bin, Maybe, Uint
from scenefold.wire.laws import All, Distinct, Inside, Order
from scenefold.wire.members import MEMBER, Member


@dataclass(frozen=True, slots=True)
class RecordVersion:
    """Which version a record is, without it: compared field by field, the highest wins. `digest` is the SHA-256 of its ciphertext.

    Nobody has signed it: it says what to ask for, and what comes is verified.
    """

    epoch: int
    seq: int
    writer: KeyId
    session: int
    digest: bytes


@dataclass(frozen=True, slots=True)
class HeldRecord:
    """A record that lies on a node's disk, by whatever right."""

    scene: SceneId
    space: SpaceId
    location: Location
    object: bytes
    version: RecordVersion


@dataclass(frozen=True, slots=True)
class SceneTurn:
    """The position at which copies of any space of a scene changed last."""

    scene: SceneId
    position: int


RECORD_VERSION = Struct(RecordVersion, ("epoch", U64), ("seq", U64), ("writer", U32), ("session", U64), ("digest", DIGEST))
SCENE_TURN = Struct(SceneTurn, ("scene", SCENE), ("position", Uint(64, least=1)))
HELD_RECORD = Struct(
    HeldRecord, ("scene", SCENE), ("space", SPACE), ("location", LOCATION), ("object", OBJECT), ("version", RECORD_VERSION)
)


@dataclass(frozen=True, slots=True)
class SetCustody(Packet):
    """From now on you hold this for me, and nothing else in this arc. Answered once that is durable.

    `number` is above all that the owner has met there; an entry that stays as it was keeps its own.
    """

    TYPE: ClassVar[int] = 88
    owner: Member
    holder: Member
    """Who is meant: who came to this address since refuses (18)."""
    number: int
    first: Location
    last: Location
    entries: tuple[CustodyEntry, ...]


@dataclass(frozen=True, slots=True)
class CustodySet(Packet):
    """`reason` 0: so it is, under `number`. 2: `number` is the highest one met there, of another owner."""

    TYPE: ClassVar[int] = 89
    reason: int
    number: int
    text: str


@dataclass(frozen=True, slots=True)
class ListHeld(Packet):
    """What is on your disk with its home between `first` and `last`, behind the cursor `after` (empty: from the beginning)?

    `log_position`: where the cluster's log let the asker adopt the gap; who does not know it yet has to learn it first.
    """

    TYPE: ClassVar[int] = 92
    asker: Member
    holder: Member
    log_position: int
    first: Location
    last: Location
    after: bytes
    limit: int


@dataclass(frozen=True, slots=True)
class HeldListed(Packet):
    """Records, and custody entries, which may come on several pages. `next`: the cursor to go on behind; None: that was all.

    `turns`: by which headers the entries are to be read, at least (specs/23-turns.md).
    """

    TYPE: ClassVar[int] = 93
    reason: int
    records: tuple[HeldRecord, ...]
    entries: tuple[CustodyEntry, ...]
    next: bytes | None
    turns: tuple[SceneTurn, ...] = ()


@dataclass(frozen=True, slots=True)
class FetchHeld(Packet):
    """These very versions, please."""

    TYPE: ClassVar[int] = 94
    BULK_ANSWER: ClassVar[bool] = True
    entries: tuple[RecordEntry, ...]


@dataclass(frozen=True, slots=True)
class HeldFetched(Packet):
    """Of the first entries asked for, as many as fit a frame, at least one: those that are here, and the positions of those
    that are not. The asker asks again for the rest."""

    TYPE: ClassVar[int] = 95
    items: tuple[HandItem, ...]
    missing: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class OfferStrays(Packet):
    """These lie here, and you own their homes: may they go?"""

    TYPE: ClassVar[int] = 100
    records: tuple[HeldRecord, ...]


@dataclass(frozen=True, slots=True)
class StraysJudged(Packet):
    """A reason for each, in order. 0: this or a newer version is durable where its space asks for it. 3: bring it. Else: keep it for now."""

    TYPE: ClassVar[int] = 101
    reasons: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Assigned:
    """What is set is the sender's own, numbered by it, and says of no place and layout two things."""

    def holds(self, value: Any) -> bool:
        if any(entry.members[:1] != (value.owner,) or entry.number > value.number for entry in value.entries):
            return False
        ordered = sorted(value.entries, key=lambda entry: (entry.layout, entry.first))
        return all(one.layout != other.layout or one.last < other.first for one, other in pairwise(ordered))

    def __str__(self) -> str:
        return "owner first of members of entries, of one layout apart, numbered number at most"


_ARC = (("first", LOCATION), ("last", LOCATION))
_ASCENDING = Order("first", "last")
_CURSOR = Bin(HELD_CURSOR_BYTES_MAX)
_INDEX = Uint(16, most=HANDOVER_BATCH_RECORDS_MAX - 1)

ROWS = (
    row(
        SetCustody,
        Carrier.TCP_LOW,
        ("owner", MEMBER),
        ("holder", MEMBER),
        ("number", U64),
        *_ARC,
        ("entries", CUSTODY_ENTRIES),
        law=All((_ASCENDING, Inside("entries"), Assigned())),
    ),
    row(CustodySet, Carrier.TCP_LOW, ("reason", REASON_OR_0), ("number", U64), ("text", MESSAGE)),
    row(
        ListHeld,
        Carrier.TCP_LOW,
        ("asker", MEMBER),
        ("holder", MEMBER),
        ("log_position", U64),
        *_ARC,
        ("after", _CURSOR),
        ("limit", Uint(16, least=1, most=HANDOVER_BATCH_RECORDS_MAX)),
        law=_ASCENDING,
    ),
    row(
        HeldListed,
        Carrier.TCP_LOW,
        ("reason", REASON_OR_0),
        ("records", Many(HELD_RECORD, HANDOVER_BATCH_RECORDS_MAX)),
        ("entries", CUSTODY_ENTRIES),
        ("next", Maybe(_CURSOR)),
        ("turns", Many(SCENE_TURN, SCENES_KEPT_MAX)),
    ),
    row(FetchHeld, Carrier.TCP_LOW, ("entries", Many(RECORD_ENTRY, HANDOVER_BATCH_RECORDS_MAX))),
    row(
        HeldFetched,
        Carrier.TCP_LOW,
        ("items", HAND_ITEMS),
        ("missing", Many(_INDEX, HANDOVER_BATCH_RECORDS_MAX)),
        law=Distinct("missing"),
    ),
    row(OfferStrays, Carrier.TCP_LOW, ("records", Many(HELD_RECORD, HANDOVER_BATCH_RECORDS_MAX))),
    row(StraysJudged, Carrier.TCP_LOW, ("reasons", Many(REASON_OR_0, HANDOVER_BATCH_RECORDS_MAX))),
)
STRUCTS = (RECORD_VERSION, HELD_RECORD, SCENE_TURN)
