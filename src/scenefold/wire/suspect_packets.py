"""Packets 108 to 113: what a returned node keeps for those who hold a scene's key to decide about (specs/22-purge.md, Who was away)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from scenefold.base.limits import HANDOVER_BATCH_RECORDS_MAX, HELD_CURSOR_BYTES_MAX
from scenefold.wire.common import (
    DIGEST,
    LOCATION,
    OBJECT,
    SCENE,
    SIGNATURE,
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
from scenefold.wire.custody_packets import HELD_RECORD, HeldRecord
from scenefold.wire.handover_packets import HAND_ITEMS, RECORD_ENTRY, HandItem, RecordEntry
from scenefold.wire.kinds import Bin, Maybe, Uint
from scenefold.wire.laws import Distinct
from scenefold.wire.members import MEMBER, Member
from scenefold.wire.pieces import pack_piece
from scenefold.wire.status_packets import UNSIGNED

SUSPECTS_DISCARDED_MAX = 256
"""Of one order: as many as of a purge."""


@dataclass(frozen=True, slots=True)
class ListSuspects(Packet):
    """Which suspects of a scene do you keep, behind the cursor `after` (empty: from the beginning)?"""

    TYPE: ClassVar[int] = 108
    scene: SceneId
    after: bytes
    limit: int


@dataclass(frozen=True, slots=True)
class SuspectsListed(Packet):
    """`holder`: whose they are, for who has them discarded. `next`: the cursor to go on behind; None: that was all."""

    TYPE: ClassVar[int] = 109
    holder: Member
    records: tuple[HeldRecord, ...]
    next: bytes | None


@dataclass(frozen=True, slots=True)
class FetchSuspects(Packet):
    """These very suspects, please."""

    TYPE: ClassVar[int] = 110
    BULK_ANSWER: ClassVar[bool] = True
    entries: tuple[RecordEntry, ...]


@dataclass(frozen=True, slots=True)
class SuspectsFetched(Packet):
    """Of the first entries asked for, as many as fit a frame, at least one: those that are here, and the positions of those that are not."""

    TYPE: ClassVar[int] = 111
    items: tuple[HandItem, ...]
    missing: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class DiscardItem:
    """One exact version of a record: `digest` is the SHA-256 of its ciphertext."""

    space: SpaceId
    location: Location
    object: bytes
    digest: bytes


@dataclass(frozen=True, slots=True)
class DiscardOrder:
    """A writer of the scene wants these suspects of this incarnation deleted. `position`: of the header that he knows."""

    scene: SceneId
    position: int
    writer: KeyId
    holder: Member
    items: tuple[DiscardItem, ...]
    signature: bytes = UNSIGNED

    def signable(self, genesis: bytes) -> bytes:
        """What `signature` signs, under the domain scenefold/discard."""
        return genesis + pack_piece(DISCARD_ORDER, replace(self, signature=UNSIGNED))


@dataclass(frozen=True, slots=True)
class DiscardSuspects(Packet):
    """Delete them, by the word of who holds the scene's key."""

    TYPE: ClassVar[int] = 112
    order: DiscardOrder


@dataclass(frozen=True, slots=True)
class SuspectsDiscarded(Packet):
    """How many of them were there, and are not any more, durably."""

    TYPE: ClassVar[int] = 113
    discarded: int


_CURSOR = Bin(HELD_CURSOR_BYTES_MAX)
_INDEX = Uint(16, most=HANDOVER_BATCH_RECORDS_MAX - 1)
DISCARD_ITEM = Struct(DiscardItem, ("space", SPACE), ("location", LOCATION), ("object", OBJECT), ("digest", DIGEST))
DISCARD_ORDER = Struct(
    DiscardOrder,
    ("scene", SCENE),
    ("position", U64),
    ("writer", U32),
    ("holder", MEMBER),
    ("items", Many(DISCARD_ITEM, SUSPECTS_DISCARDED_MAX)),
    ("signature", SIGNATURE),
)
STRUCTS = (DISCARD_ITEM, DISCARD_ORDER)

ROWS = (
    row(
        ListSuspects,
        Carrier.TCP_LOW,
        ("scene", SCENE),
        ("after", _CURSOR),
        ("limit", Uint(16, least=1, most=HANDOVER_BATCH_RECORDS_MAX)),
    ),
    row(
        SuspectsListed,
        Carrier.TCP_LOW,
        ("holder", MEMBER),
        ("records", Many(HELD_RECORD, HANDOVER_BATCH_RECORDS_MAX)),
        ("next", Maybe(_CURSOR)),
    ),
    row(FetchSuspects, Carrier.TCP_LOW, ("entries", Many(RECORD_ENTRY, HANDOVER_BATCH_RECORDS_MAX))),
    row(
        SuspectsFetched,
        Carrier.TCP_LOW,
        ("items", HAND_ITEMS),
        ("missing", Many(_INDEX, HANDOVER_BATCH_RECORDS_MAX)),
        law=Distinct("missing"),
    ),
    row(DiscardSuspects, Carrier.TCP_LOW, ("order", DISCARD_ORDER)),
    row(SuspectsDiscarded, Carrier.TCP_LOW, ("discarded", Uint(16, most=SUSPECTS_DISCARDED_MAX))),
)
