"""Packets 1 to 4: who is there, and whose key is it (thesis C.1, C.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from scenefold.base.limits import BLACKLIST_MAX, NODES_MAX
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix
from scenefold.wire.common import (
    INCARNATION,
    LOCATION,
    SIGNATURE,
    U8,
    U32,
    U64,
    Carrier,
    KeyId,
    Location,
    NodeId,
    Packet,
    row,
)
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Maybe, Text, Uint
from scenefold.wire.laws import All, Masked, Needs, Order
from scenefold.wire.pieces import pack_piece

ADDRESS_BYTES_MAX = 64
"""A host, or host:port: the longest IPv6 address with a port is 47 characters."""
UNSIGNED = bytes(64)
"""Stands in a status that is yet to be signed."""


@dataclass(frozen=True, slots=True)
class Status:
    """What a node says about itself, signed by it, also when others pass it on."""

    lamport: int
    """Rises over the node's whole life, from boot x 2^32 on; hearing of a node counts only then."""
    node: NodeId
    incarnation: bytes
    """16 random bytes, drawn when the data folder was made."""
    boot: int
    address: str
    """Host, or host:port where the low-priority port is not the usual one."""
    left_fence: Location | None = None
    """The arc begins behind it; None: at the line's beginning."""
    right_bound: Location | None = None
    """The last location of the arc; None: the node owns nothing."""
    render_pool: int = 0
    scene_frame: int = 0
    offline_fraction: int = 0
    """Share of disk used, of 2^32."""
    offline_blocks: int = 0
    """Disk in blocks of 4 KiB."""
    online_fraction: int = 0
    online_blocks: int = 0
    rays_per_second: int = 0
    ray_queue_length: int = 0
    log_position: int = 0
    """How far the node knows the cluster's log."""
    blacklist: tuple[AddressPrefix, ...] = ()
    """Addresses of nodes that must not hold copies of what this one owns."""
    blacklist_version: int = 0
    """Rises with each change of the blacklist."""
    signature: bytes = UNSIGNED

    def signable(self) -> bytes:
        """The bytes that `signature` signs, under the domain scenefold/status."""
        return pack_piece(STATUS, replace(self, signature=UNSIGNED))


ADDRESS_PREFIX = Struct(AddressPrefix, ("address", U32), ("bits", Uint(8, most=ADDRESS_BITS)), law=Masked("address", "bits"))
BLACKLIST = Many(ADDRESS_PREFIX, BLACKLIST_MAX)
STATUS = Struct(
    Status,
    ("lamport", U64),
    ("node", U32),
    ("incarnation", INCARNATION),
    ("boot", U32),
    ("address", Text(ADDRESS_BYTES_MAX)),
    ("left_fence", Maybe(LOCATION)),
    ("right_bound", Maybe(LOCATION)),
    ("render_pool", U32),
    ("scene_frame", U64),
    ("offline_fraction", U32),
    ("offline_blocks", U64),
    ("online_fraction", U32),
    ("online_blocks", U32),
    ("rays_per_second", U32),
    ("ray_queue_length", U32),
    ("log_position", U64),
    ("blacklist", BLACKLIST),
    ("blacklist_version", U64),
    ("signature", SIGNATURE),
    law=All((Needs("left_fence", "right_bound"), Order("left_fence", "right_bound", strictly=True))),
)


@dataclass(frozen=True, slots=True)
class PublicKeyInfo:
    """A public key in full. `exponent` is 0 where the suite has none."""

    key: KeyId
    suite: int
    exponent: int
    raw: bytes


PUBLIC_KEY_INFO = Struct(PublicKeyInfo, ("key", U32), ("suite", U8), ("exponent", U32), ("raw", Bin(lengths=(32, 384))))


@dataclass(frozen=True, slots=True)
class PingBroadcast(Packet):
    """Statuses: the sender's own first, then others of its table."""

    TYPE: ClassVar[int] = 1
    statuses: tuple[Status, ...]


@dataclass(frozen=True, slots=True)
class RequestState(Packet):
    """Are you there? Answered by a PingBroadcast."""

    TYPE: ClassVar[int] = 2


@dataclass(frozen=True, slots=True)
class RequestPublicKey(Packet):
    TYPE: ClassVar[int] = 3
    key: KeyId


@dataclass(frozen=True, slots=True)
class RespondPublicKey(Packet):
    """The key, or None if it is unknown here."""

    TYPE: ClassVar[int] = 4
    answer: PublicKeyInfo | None


ROWS = (
    row(PingBroadcast, Carrier.UDP_HIGH, ("statuses", Many(STATUS, NODES_MAX))),
    row(RequestState, Carrier.UDP_HIGH),
    row(RequestPublicKey, Carrier.BOTH_HIGH, ("key", U32)),
    row(RespondPublicKey, Carrier.BOTH_HIGH, ("answer", Maybe(PUBLIC_KEY_INFO))),
)
STRUCTS = (ADDRESS_PREFIX, STATUS, PUBLIC_KEY_INFO)
