"""Packets 102 to 107: deleted records are dropped once no node has anything older (specs/22-purge.md).

A writer with the scene's key says which, and signs that; the owner of the places asks everybody, and has them dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import ClassVar

from scenefold.wire.common import (
    LOCATION,
    MESSAGE,
    OBJECT,
    REASON_OR_0,
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
from scenefold.wire.custody_packets import RECORD_VERSION, RecordVersion
from scenefold.wire.kinds import Choice, Maybe
from scenefold.wire.laws import Distinct
from scenefold.wire.members import MEMBER, Member
from scenefold.wire.pieces import pack_piece
from scenefold.wire.status_packets import UNSIGNED

PURGE_ITEMS_MAX = 256
"""Of one packet: each node that is asked reads as many places."""


class PlaceState(IntEnum):
    """What lies at a place on a node's disk, by whatever right."""

    NOTHING = 0
    THIS = 1
    OTHER = 2
    """Another version, an older or a newer one, or what has rotted so that nobody can tell."""


@dataclass(frozen=True, slots=True)
class PurgeItem:
    """A deleted record, as this very version."""

    space: SpaceId
    location: Location
    object: bytes
    version: RecordVersion


@dataclass(frozen=True, slots=True)
class PurgeOrder:
    """A writer's word that these records are deleted, and may go. `position`: of the scene's header that it goes by."""

    scene: SceneId
    position: int
    writer: KeyId
    items: tuple[PurgeItem, ...]
    signature: bytes

    def signable(self, genesis: bytes) -> bytes:
        """What the signature signs, under the domain scenefold/purge."""
        return genesis + pack_piece(PURGE_ORDER, replace(self, signature=UNSIGNED))


@dataclass(frozen=True, slots=True)
class PurgeRecords(Packet):
    """Drop these wherever they are, if nobody has anything else there."""

    TYPE: ClassVar[int] = 102
    order: PurgeOrder


@dataclass(frozen=True, slots=True)
class RecordsPurged(Packet):
    """A reason for each item, in order. 0: nothing is there any more. 16: later; `text` says what one of them waits for."""

    TYPE: ClassVar[int] = 103
    reasons: tuple[int, ...]
    text: str


@dataclass(frozen=True, slots=True)
class AskPlaces(Packet):
    """What have you there? Take nothing older from now on. Without an order: are you still who was asked?"""

    TYPE: ClassVar[int] = 104
    asker: Member
    asked: Member
    log_position: int
    order: PurgeOrder | None


@dataclass(frozen=True, slots=True)
class PlacesAsked(Packet):
    """`boot`: which process of the node answers. `states`: of each place, if `reason` is 0."""

    TYPE: ClassVar[int] = 105
    reason: int
    boot: int
    states: tuple[PlaceState, ...]
    text: str


@dataclass(frozen=True, slots=True)
class DropPurged(Packet):
    """Drop exactly these versions, of which the process with this boot counter was asked."""

    TYPE: ClassVar[int] = 106
    asker: Member
    asked: Member
    boot: int
    scene: SceneId
    items: tuple[PurgeItem, ...]


@dataclass(frozen=True, slots=True)
class PurgedDropped(Packet):
    """`reason` 0: none of them is there any more, durably."""

    TYPE: ClassVar[int] = 107
    reason: int
    text: str


PURGE_ITEM = Struct(PurgeItem, ("space", SPACE), ("location", LOCATION), ("object", OBJECT), ("version", RECORD_VERSION))
_ITEMS = Many(PURGE_ITEM, PURGE_ITEMS_MAX)
PURGE_ORDER = Struct(
    PurgeOrder,
    ("scene", SCENE),
    ("position", U64),
    ("writer", U32),
    ("items", _ITEMS),
    ("signature", SIGNATURE),
    law=Distinct("items"),
)

ROWS = (
    row(PurgeRecords, Carrier.TCP_LOW, ("order", PURGE_ORDER)),
    row(RecordsPurged, Carrier.TCP_LOW, ("reasons", Many(REASON_OR_0, PURGE_ITEMS_MAX)), ("text", MESSAGE)),
    row(
        AskPlaces,
        Carrier.TCP_LOW,
        ("asker", MEMBER),
        ("asked", MEMBER),
        ("log_position", U64),
        ("order", Maybe(PURGE_ORDER)),
    ),
    row(
        PlacesAsked,
        Carrier.TCP_LOW,
        ("reason", REASON_OR_0),
        ("boot", U32),
        ("states", Many(Choice(PlaceState), PURGE_ITEMS_MAX)),
        ("text", MESSAGE),
    ),
    row(
        DropPurged,
        Carrier.TCP_LOW,
        ("asker", MEMBER),
        ("asked", MEMBER),
        ("boot", U32),
        ("scene", SCENE),
        ("items", _ITEMS),
    ),
    row(PurgedDropped, Carrier.TCP_LOW, ("reason", REASON_OR_0), ("text", MESSAGE)),
)
STRUCTS = (PURGE_ITEM, PURGE_ORDER)
