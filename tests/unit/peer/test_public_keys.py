"""If this fails, a node keeps a key to itself that it knows, tells it as another suite's, or can be made to flood who asks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.ids import KeyId
from scenefold.crypto import ED25519, RSA3072, PublicKey
from scenefold.peer.membership.answering import ANSWER_S_MIN
from scenefold.peer.public_keys import PublicKeys
from scenefold.peer.records.verification import KnownScene
from scenefold.wire import KeyEntry, Packet, RequestPublicKey, RespondPublicKey, WriterEntry, encode_packet
from scenefold.world.profile import ClusterProfile
from unit.crypto.suites_made import SIGNING
from unit.peer.scenes_made import FOR_EVER, HEADER_KEY, STRANGER, WRITER, first_header
from unit.peer.village import key_of, node_at, village

RSA_WRITER = SIGNING[RSA3072]
SCENE = KnownScene.of(
    first_header(
        keys=tuple(KeyEntry(key.suite, key.public.raw) for key in (HEADER_KEY, WRITER, RSA_WRITER)),
        writers=tuple(WriterEntry(key.key_id, 0, FOR_EVER) for key in (WRITER, RSA_WRITER)),
    )
)


def answering(registry: Any, facts: Any) -> PublicKeys:
    return PublicKeys(facts, lambda: registry, cast(Any, SimpleNamespace(everyone=lambda: [SCENE])))


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> ClusterProfile:
    return ClusterProfile.create(tmp_path_factory.mktemp("profiles") / "studio", "studio", ["127.0.0.2"], suite=RSA3072)


async def test_keys_of_members_users_scenes_and_the_log_are_told(profile: ClusterProfile, autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        keys = answering(them.of(0).log.registry, profile.facts())
        owner = profile.user_secrets().signing
        for key in (key_of(node_at(1)), HEADER_KEY, WRITER, RSA_WRITER, owner):
            info = keys.answer(RequestPublicKey(key=key.key_id, request_id=5))
            assert info.request_id == 5 and info.answer is not None
            assert (info.answer.key, info.answer.suite) == (key.key_id, key.suite)
            assert info.answer.exponent == (65537 if key.suite == RSA3072 else 0)
            assert PublicKey(info.answer.raw, info.answer.suite) == key.public
        assert owner.suite == RSA3072 and key_of(node_at(1)).suite == ED25519
        assert keys.find(profile.log_key.key_id) == profile.log_key
        assert keys.answer(RequestPublicKey(key=STRANGER.key_id)).answer is None


async def test_a_sealing_key_is_nobodys_signing_key(profile: ClusterProfile) -> None:
    keys = answering(SimpleNamespace(order=(), roll=SimpleNamespace(cards={})), profile.facts())
    assert keys.find(profile.user_secrets().sealing.public.key_id) is None


@pytest.mark.expect_log("a RespondPublicKey has no business here")
async def test_nodes_are_answered_by_datagram_and_only_so_often(autojump_clock: trio.testing.MockClock) -> None:
    asked: list[KeyId] = []
    told: list[Packet] = []

    def answer(packet: RequestPublicKey) -> RespondPublicKey:
        asked.append(packet.key)
        return RespondPublicKey(request_id=packet.request_id, answer=None)

    async with village(2) as them:
        for index in range(2):
            await them.start(index)
        await trio.sleep(3)
        asker, knower = them.of(0).gossip, them.of(1).gossip
        knower.answering.key_answer = answer
        hearing = asker._hearing
        packet_of = hearing.packet_of

        def listen(data: bytes) -> Packet:
            packet = packet_of(data)
            told.append(packet)
            return packet

        hearing.packet_of = listen  # type: ignore[method-assign]
        question = encode_packet(RequestPublicKey(key=WRITER.key_id, request_id=7))
        for _ in range(10):
            await asker._datagrams.send(question, node_at(1))
        await trio.sleep(ANSWER_S_MIN * 2)
        await asker._datagrams.send(question, node_at(1))
        await trio.sleep(1)
    assert asked == [WRITER.key_id] * 2
    answers = [packet for packet in told if isinstance(packet, RespondPublicKey)]
    assert [(packet.request_id, packet.answer) for packet in answers] == [(7, None)] * 2
    assert all(packet.mini_status is not None for packet in answers)
