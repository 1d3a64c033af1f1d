"""Packets 19 to 23, and 46: render pools and the rays that their nodes pass on (thesis C.5, C.6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import BULK_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.common import F64, REASON, U32, U64, Carrier, Packet, row
from scenefold.wire.containers import Many
from scenefold.wire.kinds import Bin

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
class SendRays(Packet):
    """A batch of rays of one pass: `count` records in `rays`, packed by the renderer.

    `render_location` is where the sender's cell has its site: one or three coordinates, or none where the
    partition has no sites.
    """

    TYPE: ClassVar[int] = 23
    job: int
    frame: int
    pass_index: int
    attempt: int
    partition_epoch: int
    link_sequence: int
    render_location: tuple[float, ...]
    count: int
    rays: bytes


@dataclass(frozen=True, slots=True)
class AcknowledgeRays(Packet):
    """Of the packets of a job's link the receiver has all up to a number, and those behind it whose bits are set (specs/30-ray-links.md)."""

    TYPE: ClassVar[int] = 46
    job: int
    attempt: int
    all_until: int
    selective: bytes


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
        ("pass_index", U32),
        ("attempt", U64),
        ("partition_epoch", U64),
        ("link_sequence", U64),
        ("render_location", RENDER_LOCATION),
        ("count", U32),
        ("rays", Bin(BULK_BYTES_MAX)),
    ),
    row(
        AcknowledgeRays,
        Carrier.BOTH_LOW,
        ("job", U64),
        ("attempt", U64),
        ("all_until", U64),
        ("selective", Bin(SELECTIVE_BYTES_MAX)),
    ),
)
