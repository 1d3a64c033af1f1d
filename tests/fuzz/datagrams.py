"""What the fuzzer feeds to a node's port: datagrams of strangers, and what a member that keeps to no format has sealed."""

from __future__ import annotations

import random

from fuzz.findings import Finding
from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import SealingKey
from scenefold.peer.datagrams import Exchange, Kind, Taken, unpacked
from scenefold.peer.datagrams.contents import packed_answer, packed_challenge, packed_packet

ADA, BOB = NodeId(167772161), NodeId(167772162)
KEYS = {ADA: SealingKey(b"a" * 32), BOB: SealingKey(b"b" * 32)}
PACKETS = [b"", b"one", bytes(1000)]
CONTENTS = [
    packed_packet(b""),
    packed_packet(bytes(99)),
    packed_challenge(bytes(16)),
    packed_answer(bytes(16)),
    packed_answer(bytes(16), bytes(16)),
    packed_answer(bytes(16), first=True),
    packed_answer(bytes(16), bytes(16), first=True),
]


def boot(me: NodeId) -> Exchange:
    return Exchange(me, bytes(16), 1, KEYS[me], lambda node: KEYS[node].public if node in KEYS else None, random.Random(me).randbytes)


def _said(one: Exchange, packet: bytes) -> bytes:
    data = one.seal(BOB, packet)
    assert data is not None
    return data


def take(one: Exchange, data: bytes) -> Taken:
    """What comes of a datagram from the address of the node that it says it is from."""
    return one.take(data, address_of(NodeId(int.from_bytes(data[4:8]))), 0.0)[1]


_ada = boot(ADA)
_HELLO = _said(_ada, b"hello")
_ANSWER = take(_ada, take(boot(BOB), _HELLO).replies[0]).replies[0]
SEALED = [_said(_ada, packet) for packet in PACKETS]


def listener() -> Exchange:
    """Bob, always the same, who takes what Ada says."""
    bob = boot(BOB)
    for data in (_HELLO, _ANSWER):
        take(bob, data)
    return bob


def datagram(data: bytes, _dice: random.Random) -> str:
    """What nobody has sealed counts for nothing and is not answered, and leaves no trace."""
    bob = listener()
    taken = take(bob, data)
    if data in SEALED:
        if taken.packets != [PACKETS[SEALED.index(data)]]:
            raise Finding("a good datagram does not count")
        return "accepted a datagram"
    if taken.packets or taken.replies or len(taken.dropped) != 1:
        raise Finding("a datagram counts that nobody has sealed")
    if take(bob, SEALED[0]).packets != [PACKETS[0]]:
        raise Finding("a good datagram does not count any more behind a bad one")
    return f"refused {taken.dropped[0][0]}"


def contents(data: bytes, _dice: random.Random) -> str:
    try:
        found = unpacked(data)
    except DamagedData:
        return "refused contents"
    again = {
        Kind.PACKET: packed_packet(found.packet),
        Kind.CHALLENGE: packed_challenge(found.challenge),
        Kind.ANSWER: packed_answer(found.echo, found.challenge),
        Kind.FIRST_ANSWER: packed_answer(found.echo, found.challenge, first=True),
    }[found.kind]
    if again != data:
        raise Finding("contents were accepted from bytes that are not their own")
    return f"accepted contents of kind {found.kind}"
