"""Sealed datagrams: their bytes and keys (specs/03-wire.md, Datagrams).

     0  magic      "SFD", "2"                28  counter    u64, from 0: per salt and target
     4  sender     u32, node id              36  sealed     AES-256-GCM, with its tag of 16 bytes;
     8  target     u32, node id                             the 36 bytes before it are authenticated, too
    12  salt       16 bytes, of the sender's boot

The key follows from the Diffie-Hellman secret of the two nodes and the salt, so each boot has keys of its own and may count
from 0: no nonce is ever used twice. Whether a salt is of the boot that lives now, and what was there before, is judged by
whoever receives (peer/datagrams).
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId

DATAGRAM_VERSION = 2
SALT_BYTES = 16
_FAMILY = b"SFD"
_MAGIC = b"%b%d" % (_FAMILY, DATAGRAM_VERSION)
_FRONT = struct.Struct(">4sII16s")
_COUNTER = struct.Struct(">Q")
_HEAD_BYTES = _FRONT.size + _COUNTER.size
_TAG_BYTES = 16
_KEY_BYTES = 32
_PURPOSE = b"scenefold/datagram"
_PAIR = struct.Struct(">IIB")
_NONCE_FRONT = bytes(4)
SEALED_OVERHEAD_BYTES = _HEAD_BYTES + _TAG_BYTES
WINDOW_BITS = 1024
"""Datagrams of one sender that may overtake another: 64 questions at a time, sent as fast as they can be over two paths of which
one is ten milliseconds longer, do not reach it. It costs 128 bytes a peer."""


class StrangeVersion(DamagedData):
    """A datagram of a version that this program does not take, or one that says so: nothing of it is verified."""


class DatagramHead(NamedTuple):
    """What stands before the sealed part. Nothing of it is to be believed before that has opened."""

    sender: NodeId
    target: NodeId
    salt: bytes
    counter: int


def head_of(data: bytes) -> DatagramHead:
    """The head of a datagram, so that its key can be looked up; DamagedData if it is none of ours.

    StrangeVersion if it is one of another version.
    """
    if data[: len(_MAGIC)] != _MAGIC:
        if data.startswith(_FAMILY) and data[len(_FAMILY) : len(_MAGIC)].isdigit():
            version = data[len(_FAMILY) : len(_MAGIC)].decode()
            raise StrangeVersion(
                f"it is of version {version}, this node takes version {DATAGRAM_VERSION}",
                remedy="let all nodes run the same version of scenefold",
            )
        raise DamagedData("it is none of ours")
    if len(data) < SEALED_OVERHEAD_BYTES:
        raise DamagedData(f"it is too short, {len(data)} bytes")
    _, sender, target, salt = _FRONT.unpack_from(data)
    return DatagramHead(NodeId(sender), NodeId(target), salt, _COUNTER.unpack_from(data, _FRONT.size)[0])


class DatagramKey:
    """Seals and opens what one node says to another one at one port under one salt."""

    __slots__ = ("_front", "_raw", "salt")

    def __init__(self, secret: bytes, cluster_id: bytes, port: int, sender: NodeId, target: NodeId, salt: bytes) -> None:
        """`secret`: what the sealing keys of the two agree on. `port`: 0 low, 1 high."""
        self.salt = salt
        self._front = _FRONT.pack(_MAGIC, sender, target, salt)
        self._raw = derived(secret, salt, b"".join((_PURPOSE, cluster_id, _PAIR.pack(sender, target, port))))

    def seal(self, counter: int, content: bytes) -> bytes:
        """The datagram. Each counter is used once, ever, with this key."""
        try:
            count = _COUNTER.pack(counter)
        except struct.error as error:
            raise LocalFault(f"a datagram cannot be counted: {error}") from None
        head = self._front + count
        # The cipher is set up each time, which costs a microsecond: kept ones have 2.5 KB each, for each peer and direction.
        return head + AESGCM(self._raw).encrypt(_NONCE_FRONT + count, content, head)

    def open(self, data: bytes) -> bytes:
        """The content of a datagram with a head for this key; DamagedData unless it was sealed with it, bit by bit."""
        head = data[:_HEAD_BYTES]
        try:
            return AESGCM(self._raw).decrypt(_NONCE_FRONT + head[_FRONT.size :], data[_HEAD_BYTES:], head)
        except InvalidTag:
            raise DamagedData("it was not sealed by whom it names, or is damaged") from None


def derived(secret: bytes, salt: bytes, info: bytes) -> bytes:
    return HKDF(hashes.SHA256(), _KEY_BYTES, salt, info).derive(secret)


class ReplayWindow:
    """Which counters of one sender have been seen. Late datagrams pass once, old ones and repeats never.

    Ask `is_fresh` before opening, which is cheap, and call `accept` after it, so that forgeries leave no trace.
    """

    __slots__ = ("_highest", "_seen")

    def __init__(self, seen_below: int = 0) -> None:
        """`seen_below`: all counters under it count as seen."""
        self._highest = seen_below - 1
        self._seen = (1 << WINDOW_BITS) - 1  # Bit n: the counter n below the highest was seen.

    def is_fresh(self, counter: int) -> bool:
        behind = self._highest - counter
        return behind < 0 or (behind < WINDOW_BITS and not self._seen >> behind & 1)

    def accept(self, counter: int) -> None:
        ahead = counter - self._highest
        if ahead > 0:
            # A leap clears the window; shifting by all that was leapt over would build an enormous number.
            self._seen = (self._seen << ahead & (1 << WINDOW_BITS) - 1 if ahead < WINDOW_BITS else 0) | 1
            self._highest = counter
        elif -ahead < WINDOW_BITS:
            self._seen |= 1 << -ahead
