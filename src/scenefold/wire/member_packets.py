"""Packets 71, 72, 74 to 76, 85, 86, 98 and 99: does that node live, is it to leave, how does it do, whom does it shun.

specs/11-peers.md, specs/13-balance.md, and of blacklists specs/20-copies.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.prefixes import AddressPrefix
from scenefold.wire.common import BOOL, DOCUMENT, SIGNATURE, U64, Carrier, Packet, row
from scenefold.wire.kinds import Bin, Maybe
from scenefold.wire.laws import Apart, OneOf
from scenefold.wire.members import MEMBER, Member
from scenefold.wire.status_packets import BLACKLIST


@dataclass(frozen=True, slots=True)
class ProbeFor(Packet):
    """I hear nothing of `target`: have it sign `nonce`, which I drew just now, for me."""

    TYPE: ClassVar[int] = 71
    target: Member
    nonce: bytes


@dataclass(frozen=True, slots=True)
class ProbeResult(Packet):
    """`proof`: what it signed just now; empty if it did not."""

    TYPE: ClassVar[int] = 72
    target: Member
    proof: bytes


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


@dataclass(frozen=True, slots=True)
class RequestProof(Packet):
    """Prove that you live, as this member: somebody asks me."""

    TYPE: ClassVar[int] = 85
    member: Member
    nonce: bytes


@dataclass(frozen=True, slots=True)
class ReturnProof(Packet):
    """`proof`: signature of the asked node, under the domain scenefold/alive."""

    TYPE: ClassVar[int] = 86
    nonce: bytes
    proof: bytes


@dataclass(frozen=True, slots=True)
class ChangeBlacklist(Packet):
    """Put these on your blacklist, and take those off it. Both empty: only say what stands there. `expected`: the version that is to be changed."""

    TYPE: ClassVar[int] = 98
    add: tuple[AddressPrefix, ...] = ()
    remove: tuple[AddressPrefix, ...] = ()
    expected: int | None = None


@dataclass(frozen=True, slots=True)
class BlacklistChanged(Packet):
    """The blacklist, as it is durable now."""

    TYPE: ClassVar[int] = 99
    version: int
    prefixes: tuple[AddressPrefix, ...]


NONCE = Bin(lengths=(16,))
PROOF_OR_NONE = Bin(lengths=(0, 64, 384))

ROWS = (
    row(ProbeFor, Carrier.TCP_HIGH, ("target", MEMBER), ("nonce", NONCE)),
    row(ProbeResult, Carrier.TCP_HIGH, ("target", MEMBER), ("proof", PROOF_OR_NONE)),
    row(DrainNode, Carrier.TCP_HIGH, ("check_only", BOOL), ("cancel", BOOL), law=OneOf("check_only", "cancel")),
    row(NodeReport, Carrier.TCP_HIGH, ("document", DOCUMENT)),
    row(RequestReport, Carrier.TCP_HIGH),
    row(RequestProof, Carrier.UDP_HIGH, ("member", MEMBER), ("nonce", NONCE)),
    row(ReturnProof, Carrier.UDP_HIGH, ("nonce", NONCE), ("proof", SIGNATURE)),
    row(
        ChangeBlacklist,
        Carrier.TCP_HIGH,
        ("add", BLACKLIST),
        ("remove", BLACKLIST),
        ("expected", Maybe(U64)),
        law=Apart("add", "remove"),
    ),
    row(BlacklistChanged, Carrier.TCP_HIGH, ("version", U64), ("prefixes", BLACKLIST)),
)
