"""If this fails, a client takes another key for the one that it asked for, or misses one that some node knows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest
from trio.testing import MockClock

from scenefold.base.errors import PeerFault, Unreachable
from scenefold.base.ids import KeyId
from scenefold.client.public_keys import KEY_ASKED_MAX, find_public_key
from scenefold.crypto import ED25519, RSA3072, SUITES, PublicKey
from scenefold.wire import Packet, PublicKeyInfo, RequestPublicKey, RespondPublicKey
from unit.client.fake_nodes import FakeNodes
from unit.crypto.suites_made import SIGNING


def info_of(key: PublicKey) -> PublicKeyInfo:
    return PublicKeyInfo(key.key_id, key.suite, SUITES[key.suite].exponent, key.raw)


@dataclass
class KnowingNodes(FakeNodes):
    """Nodes that answer for keys."""

    known: dict[str, PublicKeyInfo] = field(default_factory=dict)

    def _answer(self, address: str, packet: Packet) -> Packet:
        if isinstance(packet, RequestPublicKey):
            return RespondPublicKey(answer=self.known.get(address))
        return super()._answer(address, packet)


ED, RSA = SIGNING[ED25519].public, SIGNING[RSA3072].public


@pytest.mark.parametrize("key", [ED, RSA], ids=["ed25519", "rsa3072"])
async def test_the_first_node_that_knows_a_key_tells_it(key: PublicKey) -> None:
    nodes = KnowingNodes(known={"127.0.0.3": info_of(key)})
    assert await find_public_key(nodes.calls(), nodes.addresses, key.key_id) == key
    assert [address for address, _ in nodes.asked] == ["127.0.0.2", "127.0.0.3"]


@pytest.mark.parametrize(
    "lie",
    [
        info_of(ED),
        replace(info_of(RSA), key=ED.key_id),
        replace(info_of(RSA), exponent=3),
        replace(info_of(RSA), exponent=0),
        replace(info_of(RSA), suite=ED25519),
        replace(info_of(RSA), suite=3),
        replace(info_of(RSA), raw=bytes(384)),
    ],
    ids=["another key", "another id", "exponent 3", "no exponent", "another suite", "an unknown suite", "no key"],
)
async def test_a_node_that_tells_another_key_is_passed_over(lie: PublicKeyInfo) -> None:
    nodes = KnowingNodes(known={"127.0.0.2": lie, "127.0.0.4": info_of(RSA)})
    assert await find_public_key(nodes.calls(), nodes.addresses, RSA.key_id) == RSA
    alone = KnowingNodes(addresses=("127.0.0.2",), known={"127.0.0.2": lie})
    with pytest.raises(PeerFault):
        await find_public_key(alone.calls(), alone.addresses, RSA.key_id)


async def test_nobody_knows_it(autojump_clock: MockClock) -> None:
    nodes = KnowingNodes(away={"127.0.0.3"})
    assert await find_public_key(nodes.calls(), nodes.addresses, KeyId(7)) is None
    assert len(nodes.asked) == 3
    many = KnowingNodes(addresses=tuple(f"127.0.1.{index}" for index in range(1, KEY_ASKED_MAX + 9)))
    assert await find_public_key(many.calls(), many.addresses, KeyId(7)) is None
    assert len(many.asked) == KEY_ASKED_MAX


async def test_nobody_answers(autojump_clock: MockClock) -> None:
    nodes = KnowingNodes(away=set(KnowingNodes().addresses))
    with pytest.raises(Unreachable, match="no node of the cluster answers"):
        await find_public_key(nodes.calls(), nodes.addresses, KeyId(7))
