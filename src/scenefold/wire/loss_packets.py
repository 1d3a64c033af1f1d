"""What may have been lost with removed nodes: kept by all nodes until an administrator has seen it (specs/20-copies.md, What is lost)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.ids import NodeId
from scenefold.base.limits import COPIES_MAX
from scenefold.wire.common import BOOL, U32, U64, Carrier, Packet, row
from scenefold.wire.containers import Many, Struct
from scenefold.wire.copy_packets import SPAN, Span
from scenefold.wire.kinds import Bin, Uint
from scenefold.wire.members import MEMBER, Member

LOSSES_KEPT_MAX = 64
"""By one node. There are as many only where nodes are lost again and again and nobody looks."""
LOSS_NODES_MAX = 16
LOSS_ARCS_MAX = 32
LOSS_ID_BYTES = 16


@dataclass(frozen=True, slots=True)
class NotedLoss:
    """In these arcs, of spaces with so many copies, something may be lost; `is_left`: only what was acknowledged last.

    `noted_by` recovered the place, at `noted_ms` of its clock (since the epoch). `removed`: on whose disks it lay.
    """

    noted_by: NodeId
    noted_ms: int
    copies: int
    is_left: bool
    removed: tuple[Member, ...]
    arcs: tuple[Span, ...]


@dataclass(frozen=True, slots=True)
class TellLosses(Packet):
    """A node to another one: I have noted these. Keep them, but for those that were acknowledged with you."""

    TYPE: ClassVar[int] = 123
    losses: tuple[NotedLoss, ...]


@dataclass(frozen=True, slots=True)
class AcknowledgeLosses(Packet):
    """An administrator has seen these."""

    TYPE: ClassVar[int] = 124
    ids: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class LossesKept(Packet):
    """Those that wait for somebody to see them, as is durable now."""

    TYPE: ClassVar[int] = 125
    ids: tuple[bytes, ...]


NOTED_LOSS = Struct(
    NotedLoss,
    ("noted_by", U32),
    ("noted_ms", U64),
    ("copies", Uint(8, least=2, most=COPIES_MAX)),
    ("is_left", BOOL),
    ("removed", Many(MEMBER, LOSS_NODES_MAX)),
    ("arcs", Many(SPAN, LOSS_ARCS_MAX)),
)
_IDS = Many(Bin(lengths=(LOSS_ID_BYTES,)), LOSSES_KEPT_MAX)

ROWS = (
    row(TellLosses, Carrier.TCP_LOW, ("losses", Many(NOTED_LOSS, LOSSES_KEPT_MAX))),
    row(AcknowledgeLosses, Carrier.TCP_HIGH, ("ids", _IDS)),
    row(LossesKept, Carrier.TCP_ANY, ("ids", _IDS)),
)
STRUCTS = (NOTED_LOSS,)
