"""Kinds that several packets share, the base of all packets, and a row of the table (specs/03-wire.md)."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from dataclasses import fields as dataclass_fields
from enum import StrEnum
from typing import Any, ClassVar

from scenefold.base.ids import SPACE_ID_MAX, KeyId, NodeId, SceneId, SpaceId
from scenefold.base.limits import (
    CIPHERTEXT_BYTES_MAX,
    DOCUMENT_BYTES_MAX,
    FRAME_BYTES_MAX,
    LOG_BYTES_MAX,
    RECORD_OVERHEAD_BYTES_MAX,
    TEXT_BYTES_MAX,
)
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.wire.containers import Struct, since_of
from scenefold.wire.kinds import Bin, Choice, Flag, Float, Kind, Maybe, Place, Text, Uint
from scenefold.wire.laws import Law

U8 = Uint(8)
U16 = Uint(16)
U32 = Uint(32)
U64 = Uint(64)
F64 = Float()
BOOL = Flag()
LOCATION = Place()
SCENE = Uint(32, least=1)
SPACE = Uint(16, least=1, most=SPACE_ID_MAX)
SPACE_OR_NONE = Uint(16, most=SPACE_ID_MAX)
REASON = Choice(RejectReason)
REASON_OR_0 = Uint(8, most=max(RejectReason))
SIGNATURE = Bin(lengths=(64, 384))
DIGEST = Bin(lengths=(32,))
INCARNATION = Bin(lengths=(16,))
HANDOVER = Bin(lengths=(16,))
OBJECT = Bin(lengths=(0, 16))
HEADER = Bin(RECORD_OVERHEAD_BYTES_MAX)
CIPHERTEXT = Bin(CIPHERTEXT_BYTES_MAX)
MESSAGE = Text(TEXT_BYTES_MAX)
DOCUMENT = Bin(DOCUMENT_BYTES_MAX)
LOG = Bin(LOG_BYTES_MAX)

__all__ = ["Carrier", "KeyId", "Location", "MiniStatus", "NodeId", "Packet", "Row", "SceneId", "SpaceId"]


class Carrier(StrEnum):
    """How a packet travels; each transport comes on the port of its priority."""

    UDP_HIGH = "UDP high"
    TCP_HIGH = "TCP high"
    BOTH_HIGH = "UDP or TCP high"
    UDP_LOW = "UDP low"
    TCP_LOW = "TCP low"
    BOTH_LOW = "TCP or UDP low"
    TCP_ANY = "TCP"


@dataclass(frozen=True, slots=True)
class MiniStatus:
    """What every node says about itself on each packet, so that tables stay fresh for free."""

    lamport: int
    node: NodeId
    right_bound: Location | None
    """None: owns nothing."""
    render_pool: int
    offline_fraction: int
    """Share of disk used, of 2^32."""
    online_fraction: int
    rays_per_second: int
    ray_queue_length: int
    log_position: int = 0
    """How far the node knows the cluster's log."""


MINI_STATUS = Struct(
    MiniStatus,
    ("lamport", U64),
    ("node", U32),
    ("right_bound", Maybe(LOCATION)),
    ("render_pool", U32),
    ("offline_fraction", U32),
    ("online_fraction", U32),
    ("rays_per_second", U32),
    ("ray_queue_length", U32),
    ("log_position", U64),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Packet:
    """What all packets have: a number, an id that joins request and reply, and the sender's mini status."""

    TYPE: ClassVar[int] = 0
    BULK_ANSWER: ClassVar[bool] = False
    """Whether the answer may be large, so that only so much of them may be made at a time as memory allows."""
    request_id: int = 0
    """Chosen by the asker, repeated in the reply; 0 where no reply is awaited."""
    mini_status: MiniStatus | None = None
    """None from a client, which is no node."""

    def answer_bytes_max(self) -> int:
        """How large the answer may be, before it is made; 0 if no answer to such a packet is large."""
        return FRAME_BYTES_MAX if self.BULK_ANSWER else 0


def records_bytes_max(count: int) -> int:
    """Of an answer with so many records, each with who holds it."""
    return min(FRAME_BYTES_MAX, count * (CIPHERTEXT_BYTES_MAX + 2 * RECORD_OVERHEAD_BYTES_MAX))


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table of packets."""

    packet: type[Packet]
    carrier: Carrier
    fields: tuple[tuple[str, Kind[Any]], ...]
    law: Law | None = None
    since: int = 1
    """The version of the protocol that brought it."""

    @property
    def number(self) -> int:
        return self.packet.TYPE

    @property
    def name(self) -> str:
        return self.packet.__name__


def row(packet: type[Packet], carrier: Carrier, *fields: tuple[str, Kind[Any]], law: Law | None = None, since: int = 1) -> Row:
    """A row; it must name the fields of the class, in their order, those of later versions behind the others and with a default."""
    named = [name for name, _ in fields]
    declared = [field.name for field in dataclass_fields(packet) if not field.kw_only]
    assert named == declared, f"{packet.__name__}: the table says {named}, the class {declared}"
    brought = [since_of(kind) for _, kind in fields]
    defaults = {field.name for field in dataclass_fields(packet) if field.default is not MISSING}
    assert brought == sorted(brought), f"{packet.__name__}: a field stands behind one of a later version"
    assert all(name in defaults for name, kind in fields if since_of(kind)), f"{packet.__name__}: a later field has no default"
    return Row(packet, carrier, fields, law, since)
