"""What is sealed in a datagram: one byte that says which kind it is, and the content (specs/03-wire.md, Datagrams)."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.crypto import SEALED_OVERHEAD_BYTES

CHALLENGE_BYTES = 16
PACKET_BYTES_MAX = DATAGRAM_BYTES_MAX - SEALED_OVERHEAD_BYTES - 1
"""What one datagram carries."""


class Kind(IntEnum):
    PACKET = 1
    CHALLENGE = 2
    ANSWER = 3
    FIRST_ANSWER = 4
    """Like an answer, of one that has answered no other challenge under this salt: nothing that it said before has counted."""


class Content(NamedTuple):
    """`packet` of a PACKET; `challenge` of a CHALLENGE; of answers what it `echo`es, and a challenge of its own or b""."""

    kind: Kind
    packet: bytes = b""
    echo: bytes = b""
    challenge: bytes = b""


def packed_packet(packet: bytes) -> bytes:
    return b"\x01" + packet


def packed_challenge(challenge: bytes) -> bytes:
    return b"\x02" + challenge


def packed_answer(echo: bytes, challenge: bytes = b"", *, first: bool = False) -> bytes:
    return b"".join((b"\x04" if first else b"\x03", echo, challenge))


def unpacked(data: bytes) -> Content:
    """DamagedData if it is none of these: whoever sealed it is a member, and does not keep to the format."""
    rest = data[1:]
    match data[:1], len(rest):
        case b"\x01", _:
            return Content(Kind.PACKET, packet=rest)
        case b"\x02", 16:
            return Content(Kind.CHALLENGE, challenge=rest)
        case b"\x03" | b"\x04", 16 | 32:
            return Content(Kind(data[0]), echo=rest[:CHALLENGE_BYTES], challenge=rest[CHALLENGE_BYTES:])
    raise DamagedData(f"what is sealed in it, {len(data)} bytes, is of no known kind")
