"""What is signed by people and newcomers: an administrator's order, and the form of who wants to be enrolled.

Both are pieces: their bytes are signed as they travel, so whoever relays them can verify them and alter nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.wire.common import U32, U64, NodeId
from scenefold.wire.containers import Struct
from scenefold.wire.enrol_entries import FORM_BYTES_MAX, INVITATION_KEY, MEMBER_NAME
from scenefold.wire.kinds import Bin
from scenefold.wire.log_entries import SINGLE_ENTRY, SingleEntry
from scenefold.wire.pieces import pack_piece, unpack_piece

ORDER_BYTES_MAX = 8192


@dataclass(frozen=True, slots=True)
class Order:
    """An administrator wants this entry in the log of this cluster. `request` makes it happen once; `issued`: seconds since 1970."""

    cluster: bytes
    request: bytes
    by: str
    issued: int
    entry: SingleEntry

    def encode(self) -> bytes:
        return pack_piece(ORDER, self, size_max=ORDER_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> Order:
        """MalformedPacket if it is none."""
        return unpack_piece(ORDER, data, size_max=ORDER_BYTES_MAX)


@dataclass(frozen=True, slots=True)
class EnrolForm:
    """Who wants to be enrolled: name, address (0: a user), public keys, by which invitation. `keys`: as in a certificate."""

    invitation: bytes
    name: str
    address: NodeId
    tls_key: bytes
    keys: bytes

    def encode(self) -> bytes:
        return pack_piece(FORM, self, size_max=FORM_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> EnrolForm:
        """MalformedPacket if it is none."""
        return unpack_piece(FORM, data, size_max=FORM_BYTES_MAX)


ORDER = Struct(
    Order,
    ("cluster", Bin(lengths=(16,))),
    ("request", Bin(lengths=(16,))),
    ("by", MEMBER_NAME),
    ("issued", U64),
    ("entry", SINGLE_ENTRY),
)
FORM = Struct(
    EnrolForm,
    ("invitation", INVITATION_KEY),
    ("name", MEMBER_NAME),
    ("address", U32),
    ("tls_key", Bin(512)),
    ("keys", Bin(2048)),
)
STRUCTS = (ORDER, FORM)
