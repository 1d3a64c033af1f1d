"""Packets 19 to 23, and 46: render pools, and what their nodes tell each other while they trace (thesis C.5, C.6; specs/30-ray-links.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import BULK_BYTES_MAX, RAY_FRAME_ITEMS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.common import F64, REASON, U32, U64, Carrier, Packet, row
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Uint

SELECTIVE_BYTES_MAX = 32
RENDER_LOCATION = Many(F64, counts=(0, 1, 3))


@dataclass(frozen=True, slots=True)
class RequestLocalPoolJoin(Packet):
    """Will you join my pool?"""

    TYPE: ClassVar[int] = 19
    scene_frame: int


@dataclass(frozen=True, slots=True)
class RequestRemotePoolJoin(Packet):
    """May I join your pool?"""

    TYPE: ClassVar[int] = 20
    render_pool: int
    scene_frame: int


@dataclass(frozen=True, slots=True)
class AcceptPoolJoin(Packet):
    TYPE: ClassVar[int] = 21


@dataclass(frozen=True, slots=True)
class RejectPoolJoin(Packet):
    TYPE: ClassVar[int] = 22
    reason: RejectReason


@dataclass(frozen=True, slots=True)
class RayBatch:
    """So many of a packet's rays, behind those of the batches before, are of this pass and were addressed by the partition of this epoch."""

    pass_index: int
    partition_epoch: int
    count: int


@dataclass(frozen=True, slots=True)
class PassCounts:
    """A node's ledger of one pass: rays created and retired there, sent to and received from others."""

    pass_index: int
    created: int
    retired: int
    sent: int
    received: int


@dataclass(frozen=True, slots=True)
class SendRays(Packet):
    """All that a node has to say to another one of a job: rays, packed by the renderer; counts of the receiver's passes; passes of its own that are closed.

    `render_location` is where the sender's cell has its site: one or three coordinates, or none where the
    partition has no sites. `all_until` and `selective`: as in AcknowledgeRays, of the other direction.
    """

    TYPE: ClassVar[int] = 23
    job: int
    frame: int
    attempt: int
    link_sequence: int
    all_until: int
    selective: bytes
    render_location: tuple[float, ...]
    counts: tuple[PassCounts, ...]
    closed: tuple[int, ...]
    batches: tuple[RayBatch, ...]
    rays: bytes


@dataclass(frozen=True, slots=True)
class AcknowledgeRays(Packet):
    """Of the packets of a job's link the receiver has all up to a number, and those behind it whose bits are set (specs/30-ray-links.md)."""

    TYPE: ClassVar[int] = 46
    job: int
    attempt: int
    all_until: int
    selective: bytes


RAY_BATCH = Struct(RayBatch, ("pass_index", U32), ("partition_epoch", U64), ("count", Uint(32, least=1)))
PASS_COUNTS = Struct(PassCounts, ("pass_index", U32), ("created", U64), ("retired", U64), ("sent", U64), ("received", U64))
STRUCTS = (RAY_BATCH, PASS_COUNTS)

ROWS = (
    row(RequestLocalPoolJoin, Carrier.UDP_HIGH, ("scene_frame", U64)),
    row(RequestRemotePoolJoin, Carrier.UDP_HIGH, ("render_pool", U32), ("scene_frame", U64)),
    row(AcceptPoolJoin, Carrier.UDP_HIGH),
    row(RejectPoolJoin, Carrier.UDP_HIGH, ("reason", REASON)),
    row(
        SendRays,
        Carrier.BOTH_LOW,
        ("job", U64),
        ("frame", U32),
        ("attempt", U64),
        ("link_sequence", Uint(64, least=1)),
        ("all_until", U64),
        ("selective", Bin(SELECTIVE_BYTES_MAX)),
        ("render_location", RENDER_LOCATION),
        ("counts", Many(PASS_COUNTS, RAY_FRAME_ITEMS_MAX)),
        ("closed", Many(U32, RAY_FRAME_ITEMS_MAX)),
        ("batches", Many(RAY_BATCH, RAY_FRAME_ITEMS_MAX)),
        ("rays", Bin(BULK_BYTES_MAX)),
    ),
    row(
        AcknowledgeRays,
        Carrier.TCP_ANY,
        ("job", U64),
        ("attempt", U64),
        ("all_until", U64),
        ("selective", Bin(SELECTIVE_BYTES_MAX)),
    ),
)
