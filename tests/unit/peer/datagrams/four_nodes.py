"""Four nodes that talk to each other without a network."""

from __future__ import annotations

import random
from collections.abc import Callable

from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import SealingKey, SealingPublicKey
from scenefold.peer.datagrams import Drop, Exchange, Taken

CLUSTER = b"c" * 16
NODES = [NodeId(167772161 + index) for index in range(4)]
KEYS = {node: SealingKey(bytes([index + 1]) * 32) for index, node in enumerate(NODES)}
ADA, BOB, CAROL, DAVE = NODES


def key_of(node: NodeId) -> SealingPublicKey | None:
    key = KEYS.get(node)
    return None if key is None else key.public


def boot(me: NodeId, seed: int = 0, *, port: int = 1, known: Callable[[NodeId], SealingPublicKey | None] = key_of) -> Exchange:
    return Exchange(me, CLUSTER, port, KEYS[me], known, random.Random(f"{me} {seed}").randbytes)


def said(one: Exchange, target: NodeId, packet: bytes) -> bytes:
    data = one.seal(target, packet)
    assert data is not None
    return data


def source_of(data: bytes) -> str:
    """The address of the node that a datagram says it is from."""
    return address_of(NodeId(int.from_bytes(data[4:8])))


def take(one: Exchange, data: bytes, now: float = 0.0) -> Taken:
    return one.take(data, source_of(data), now)[1]


def reply(taken: Taken) -> bytes:
    assert len(taken.replies) == 1 and not taken.dropped
    return taken.replies[0]


def kinds(taken: Taken) -> list[Drop]:
    return [why for why, _ in taken.dropped]


def introduced(now: float = 0.0) -> tuple[Exchange, Exchange]:
    """Two that take each other's salt: Ada has said something."""
    ada, bob = boot(ADA), boot(BOB)
    answer = take(ada, reply(take(bob, said(ada, BOB, b"hello"), now)), now)
    heard = take(bob, reply(answer), now)
    assert heard.packets == [b"hello"]
    assert take(ada, reply(heard), now) == Taken()
    return ada, bob
