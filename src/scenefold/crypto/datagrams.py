"""Signed datagrams: who sent it, to whom, and which one it was (specs/03-wire.md, Datagrams).

     0  magic      "SFD", "1"                8  target     u32, node id; 0: whoever hears it
     4  sender     u32, node id            12  counter    u64, rises over the sender's life
                                           20  signature  64 bytes, over all the rest
                                           84  packet

Thin for now: signed by the sender's key, not yet sealed. The counter joins the boot counter and a count within
the boot, so a restarted node goes on above what it used before; a receiver keeps a ReplayWindow for each sender.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId
from scenefold.crypto.keys import DATAGRAM_DOMAIN, SIGNATURE_BYTES, PublicKey, SigningKey

DATAGRAM_VERSION = 1
_FAMILY = b"SFD"
_MAGIC = b"%b%d" % (_FAMILY, DATAGRAM_VERSION)
_HEAD = struct.Struct(">4sIIQ")
DATAGRAM_OVERHEAD_BYTES = _HEAD.size + SIGNATURE_BYTES
EVERYBODY = NodeId(0)
WINDOW_BITS = 64


class StrangeVersion(DamagedData):
    """A datagram of a version of the protocol that this program does not take, or one that says so: nothing of it is verified."""


@dataclass(frozen=True, slots=True)
class SignedDatagram:
    """A datagram taken apart. Nothing of it is to be believed before `verify_datagram`."""

    sender: NodeId
    target: NodeId
    counter: int
    signature: bytes
    payload: bytes


def datagram_counter(boot: int, count: int) -> int:
    """The counter of the `count`th datagram of a boot; both below 2^32."""
    assert 0 <= boot < 1 << 32 and 0 <= count < 1 << 32
    return boot << 32 | count


def sign_datagram(signing_key: SigningKey, sender: NodeId, counter: int, payload: bytes, *, target: NodeId = EVERYBODY) -> bytes:
    """The datagram that carries `payload`. `counter` must be higher than in any before it."""
    try:
        head = _HEAD.pack(_MAGIC, sender, target, counter)
    except struct.error as error:
        raise LocalFault(f"a datagram cannot be written: {error}") from None
    return b"".join((head, signing_key.sign(DATAGRAM_DOMAIN, head + payload), payload))


def parse_datagram(data: bytes) -> SignedDatagram:
    """Takes a datagram apart, so that the sender's key can be looked up; DamagedData if it is none of ours.

    StrangeVersion if it is one of another version.
    """
    data = bytes(data)
    if data[: len(_MAGIC)] != _MAGIC and data.startswith(_FAMILY) and data[len(_FAMILY) : len(_MAGIC)].isdigit():
        version = data[len(_FAMILY) : len(_MAGIC)].decode()
        raise StrangeVersion(
            f"it is of version {version} of the protocol, this node takes version {DATAGRAM_VERSION}",
            remedy="let all nodes run the same version of scenefold",
        )
    if len(data) < DATAGRAM_OVERHEAD_BYTES:
        raise DamagedData(f"a datagram of {len(data)} bytes is too short to be ours")
    magic, sender, target, counter = _HEAD.unpack_from(data)
    if magic != _MAGIC:
        raise DamagedData("a datagram that is not ours")
    return SignedDatagram(sender, target, counter, data[_HEAD.size : DATAGRAM_OVERHEAD_BYTES], data[DATAGRAM_OVERHEAD_BYTES:])


def verify_datagram(datagram: SignedDatagram, public_key: PublicKey) -> bytes:
    """The payload, if this key signed it; InvalidSignature otherwise. Target and replay are the receiver's to judge."""
    head = _HEAD.pack(_MAGIC, datagram.sender, datagram.target, datagram.counter)
    public_key.verify(datagram.signature, DATAGRAM_DOMAIN, head + datagram.payload)
    return datagram.payload


class ReplayWindow:
    """Which counters of one sender have been seen. Late datagrams pass once, old ones and repeats never.

    Ask `is_fresh` before verifying, which is cheap, and call `accept` after it, so that forgeries leave no trace.
    """

    __slots__ = ("_highest", "_seen")

    def __init__(self) -> None:
        self._highest = -1
        self._seen = 0  # Bit n: the counter n below the highest was seen.

    def is_fresh(self, counter: int) -> bool:
        behind = self._highest - counter
        return behind < 0 or (behind < WINDOW_BITS and not self._seen >> behind & 1)

    def accept(self, counter: int) -> None:
        ahead = counter - self._highest
        if ahead > 0:
            # A leap clears the window; shifting by a boot's worth of bits would build an enormous number.
            self._seen = (self._seen << ahead & (1 << WINDOW_BITS) - 1 if ahead < WINDOW_BITS else 0) | 1
            self._highest = counter
        elif -ahead < WINDOW_BITS:
            self._seen |= 1 << -ahead
