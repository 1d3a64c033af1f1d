"""If this fails, one node can vouch for the dead, and what they owned has no owner for ever; or none can vouch for the living."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ALIVE_DOMAIN
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.membership.probing import REQUESTED_BURST
from scenefold.peer.membership.proofs import SIGNED_BURST, signable
from scenefold.wire import Member, ProbeFor, ProbeResult, RequestProof
from unit.peer.test_probing import REMOVE_AFTER_S, removals, start_all
from unit.peer.village import incarnation_of, key_of, node_at, until, village


def question_of(index: int, nonce: bytes = bytes(16), *, incarnation: bytes | None = None) -> ProbeFor:
    return ProbeFor(target=Member(node_at(index), incarnation_of(index) if incarnation is None else incarnation), nonce=nonce)


async def test_who_is_asked_probes_and_brings_a_proof(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await start_all(them, 3)
        handler, is_right = them.of(0).handlers[ProbeFor], them.of(2).gossip.proofs.is_right
        for index, incarnation in ((1, None), (0, None), (1, NO_INCARNATION), (0, NO_INCARNATION)):
            question = question_of(index, b"drawn just now..", incarnation=incarnation)
            proof = (await handler(question, "node:3")).proof
            assert is_right(question.target, question.nonce, proof)
            assert not is_right(question.target, bytes(16), proof), "not for another question"
            assert not is_right(question_of(2).target, question.nonce, proof), "nor for another node"
            assert not is_right(replace(question.target, incarnation=b"i" * 16), question.nonce, proof), "nor for another life"
        them.crash(1)
        assert await handler(question_of(1), "node:3") == ProbeResult(target=question_of(1).target, proof=b"")


async def test_a_node_signs_for_no_other_life_than_its_own(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await start_all(them, 3)
        for index in (0, 1):
            stranger = question_of(index, incarnation=b"i" * 16)
            assert (await them.of(0).handlers[ProbeFor](stranger, "node:3")).proof == b""


async def test_many_that_ask_for_one_node_each_get_a_proof_and_one_that_asks_without_end_does_not(
    autojump_clock: trio.testing.MockClock,
) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        answers: list[ProbeResult] = []
        refused: list[Refused] = []

        async def ask(number: int, peer: str) -> None:
            try:
                answers.append(await them.of(0).handlers[ProbeFor](question_of(1, number.to_bytes(16, "big")), peer))
            except Refused as refusal:
                refused.append(refusal)

        async with trio.open_nursery() as nursery:
            for number in range(50):
                nursery.start_soon(ask, number, f"node:{number}")
        assert len({answer.proof for answer in answers}) == 50 and all(answer.proof for answer in answers)
        async with trio.open_nursery() as nursery:
            for number in range(50):
                nursery.start_soon(ask, number, "node:77")
        assert len(answers) == 50 + REQUESTED_BURST and {one.reason for one in refused} == {RejectReason.BUSY}


async def test_a_node_gives_one_asker_so_many_proofs_and_no_more(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        proofs = them.of(0).gossip.proofs
        question = RequestProof(question_of(0).target, bytes(16))
        given = [proofs.given(question, node_at(1)) for _ in range(2 * SIGNED_BURST)]
        assert sum(one is not None for one in given) == SIGNED_BURST
        assert proofs.given(question, node_at(2)) is not None


async def test_one_lost_datagram_fails_no_proof(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        them.ether.lose_first(2, "127.0.0.2", "127.0.0.3")
        assert (await them.of(0).handlers[ProbeFor](question_of(1), "node:3")).proof


@pytest.mark.parametrize("count", [3, 5])
async def test_nobody_can_vouch_for_the_dead(count: int, autojump_clock: trio.testing.MockClock) -> None:
    async with village(count) as them:
        await start_all(them, count)
        dead = question_of(count - 1)
        # It has kept what the other signed while it lived, and makes up what it has not.
        kept = [await them.of(1).gossip.proofs.ask(dead.target, bytes([number]) * 16) for number in range(9)]
        told = 0

        async def vouch(packet: ProbeFor, _peer: str) -> ProbeResult:
            nonlocal told
            told += 1
            made_up = key_of(node_at(1)).sign(ALIVE_DOMAIN, signable(packet.target, packet.nonce))
            return ProbeResult(target=packet.target, proof=[*kept, made_up][told % 10])

        them.of(1).handlers[ProbeFor] = vouch
        them.crash(count - 1)
        them.of(0).log.lapsed_nodes = [node_at(count - 1)]
        with trio.fail_after(REMOVE_AFTER_S + 30):
            await until(lambda: bool(removals(them)))
        assert told and all(kept)
