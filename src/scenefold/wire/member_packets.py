"""Packets 71, 72 and 74 to 76: is that node there, is it to leave, how does it do (specs/11-peers.md, specs/13-balance.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.wire.common import BOOL, DOCUMENT, U32, Carrier, NodeId, Packet, row


@dataclass(frozen=True, slots=True)
class ProbeFor(Packet):
    """I hear nothing of `target`: ask it for me."""

    TYPE: ClassVar[int] = 71
    target: NodeId


@dataclass(frozen=True, slots=True)
class ProbeResult(Packet):
    """`heard`: it answered just now."""

    TYPE: ClassVar[int] = 72
    target: NodeId
    heard: bool


@dataclass(frozen=True, slots=True)
class DrainNode(Packet):
    """Give everything away and leave; answered by a NodeReport. `check_only`: only say whether this node may be
    switched off now. `cancel`: stay after all. Neither: begin, or say how far it is."""

    TYPE: ClassVar[int] = 74
    check_only: bool
    cancel: bool


@dataclass(frozen=True, slots=True)
class NodeReport(Packet):
    """How the node does, as a document."""

    TYPE: ClassVar[int] = 75
    document: bytes


@dataclass(frozen=True, slots=True)
class RequestReport(Packet):
    """How do you do? Answered by a NodeReport."""

    TYPE: ClassVar[int] = 76


ROWS = (
    row(ProbeFor, Carrier.TCP_HIGH, ("target", U32)),
    row(ProbeResult, Carrier.TCP_HIGH, ("target", U32), ("heard", BOOL)),
    row(DrainNode, Carrier.TCP_HIGH, ("check_only", BOOL), ("cancel", BOOL)),
    row(NodeReport, Carrier.TCP_HIGH, ("document", DOCUMENT)),
    row(RequestReport, Carrier.TCP_HIGH),
)
