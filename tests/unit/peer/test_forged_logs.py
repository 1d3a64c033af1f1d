"""If this fails, somebody without the log's key writes the cluster's log, or somebody else's lease is had for the asking."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from scenefold.base.errors import DamagedData, Refused, ScenefoldError
from scenefold.base.reasons import RejectReason
from scenefold.crypto import HEADER_DOMAIN, LEASE_DOMAIN, SigningKey
from scenefold.peer.cluster_log.lives import Lives
from scenefold.peer.cluster_log.log_packets import answer_of
from scenefold.peer.cluster_log.log_rules import lease_message
from scenefold.peer.cluster_log.log_voter import Voter
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.wire import Member, RemoveNode, RequestSceneLog, SceneLogAnswer, SceneLogPublic, SignedRecord, Want, pack_log
from unit.peer.log_cluster import LogCluster, LogNode
from unit.peer.logs_made import LOG_KEY, key_of, node, record, signed
from unit.peer.test_cluster_log import simulate


@pytest.fixture(autouse=True)
def _in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """What nodes say of each other's crashes is not the subject here."""
    caplog.set_level(logging.CRITICAL + 1, "scenefold")


STRANGER = SigningKey.from_seed(b"s" * 32)


def header_of(one: LogNode, key: SigningKey = LOG_KEY, **changes: Any) -> SceneLogPublic:
    public = replace(one._cluster.facts.genesis_header, position=one.log.registry.position + 1, **changes)
    return replace(public, signature=key.sign(HEADER_DOMAIN, public.signable()))


def bringing(one: LogNode, written: SignedRecord, header: SceneLogPublic | None = None) -> SceneLogAnswer:
    return answer_of(header_of(one) if header is None else header, 0, pack_log([written]))


def remove_of(_one: LogNode) -> RemoveNode:
    """An entry that fits: the third founder never came."""
    return RemoveNode(Member(node(2), NO_INCARNATION), "never came")


def signed_by_a_stranger(one: LogNode) -> SceneLogAnswer:
    return bringing(one, signed(record(one.log.registry, remove_of(one)), STRANGER))


def with_a_strangers_header(one: LogNode) -> SceneLogAnswer:
    return bringing(one, signed(record(one.log.registry, remove_of(one))), header_of(one, STRANGER))


def of_another_cluster(one: LogNode) -> SceneLogAnswer:
    return bringing(one, signed(record(one.log.registry, remove_of(one))), header_of(one, genesis=bytes(32)))


def with_a_broken_chain(one: LogNode) -> SceneLogAnswer:
    written = replace(record(one.log.registry, remove_of(one)), prev_hash=b"x" * 32)
    return bringing(one, signed(written))


def with_a_changed_byte(one: LogNode) -> SceneLogAnswer:
    whole = signed(record(one.log.registry, remove_of(one)))
    return bringing(one, SignedRecord(whole.record[:-1] + bytes([whole.record[-1] ^ 1]), whole.signature))


def that_leaves_a_gap(one: LogNode) -> SceneLogAnswer:
    return bringing(one, signed(replace(record(one.log.registry, remove_of(one)), position=one.log.registry.position + 2)))


FORGERIES = [
    signed_by_a_stranger,
    with_a_strangers_header,
    of_another_cluster,
    with_a_broken_chain,
    with_a_changed_byte,
    that_leaves_a_gap,
]


@pytest.mark.parametrize("forged", FORGERIES)
def test_a_log_that_the_voter_did_not_write_changes_nothing(forged: Callable[[LogNode], SceneLogAnswer]) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        one = cluster.nodes[1]
        before, kept = one.log.registry, one.log._copy.answer(0, 0)
        with pytest.raises(ScenefoldError) as refusal:
            await one.log._copy.install(forged(one))
        assert isinstance(refusal.value, DamagedData | Refused)
        assert one.log.registry is before and one.log._copy.answer(0, 0) == kept
        await cluster.crash(1)
        await cluster.start(1)
        assert cluster.nodes[1].log._copy.answer(0, 0) == kept, "nor is anything of it on the disk"

    simulate(scenario, founders=3)


def test_what_the_voter_wrote_is_taken() -> None:
    """The forgeries above fail for what is false in them, and for nothing else."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        one = cluster.nodes[1]
        await one.log._copy.install(bringing(one, signed(record(one.log.registry, remove_of(one)))))
        assert one.log.registry.order == (node(0), node(1))

    simulate(scenario, founders=3)


NONCE = (7 << 32) + 1


def request_of(one: LogNode, under: tuple[int, ...] | None = None, **false: Any) -> RequestSceneLog:
    """What node 1 asks a lease with; `false` says what is otherwise in what its proof signs."""
    facts, registry, mini = one._cluster.facts, one.log.registry, one.own.mini()
    lives = one.lease._life.lives if under is None else under
    true = {
        "genesis": facts.genesis_header.genesis,
        "have": registry.position,
        "head": registry.head,
        "nonce": NONCE,
        "member": one.own.member,
        "lives": Lives(*lives) if len(lives) == 2 else Lives(),
    }
    key = false.pop("key", one.own.key)
    assert isinstance(key, SigningKey)
    proof = key.sign(LEASE_DOMAIN, lease_message(**{**true, **false}))
    public = facts.genesis_header
    member = one.own.member
    return RequestSceneLog(public.scene, public.genesis, registry.position, NONCE, Want.LEASE, member, proof, lives, mini_status=mini)


FALSE = [
    {"key": key_of(0)},
    {"key": STRANGER},
    {"nonce": NONCE + 1},
    {"lives": Lives(1, 2)},
    {"head": b"h" * 32},
    {"have": 1},
    {"genesis": bytes(32)},
    {"member": Member(node(1), bytes(16))},
    {"member": Member(node(0), bytes(16))},
]


@pytest.mark.parametrize("false", FALSE, ids=lambda one: next(iter(one)))
def test_a_lease_is_lent_only_to_who_signs_for_it_now(false: dict[str, object]) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        # A voter of its own, which has lent nothing yet.
        voter, one = cluster.nodes[0].log._voter, cluster.nodes[1]
        assert isinstance(voter, Voter)
        voter._leased_at.clear()
        with pytest.raises(Refused) as refusal:
            await voter.grant(request_of(one, **false), node(1))
        assert refusal.value.reason is RejectReason.SIGNATURE_INVALID
        assert voter.leased_at(node(1)) is None

    simulate(scenario, founders=3)


@pytest.mark.parametrize("lives", [(), (1,), (1, 0), (0, 0), (1, 2, 3)], ids=str)
def test_a_lease_is_asked_for_under_a_life(lives: tuple[int, ...]) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        voter, one = cluster.nodes[0].log._voter, cluster.nodes[1]
        assert isinstance(voter, Voter)
        voter._leased_at.clear()
        with pytest.raises(Refused, match="under two lives") as refusal:
            await voter.grant(request_of(one, lives), node(1))
        assert refusal.value.reason is RejectReason.ILL_FORMED and voter.leased_at(node(1)) is None

    simulate(scenario, founders=3)


def test_somebody_elses_request_is_no_request() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        voter, one = cluster.nodes[0].log._voter, cluster.nodes[1]
        assert isinstance(voter, Voter)
        with pytest.raises(Refused) as refusal:
            await voter.grant(request_of(one), node(0))
        assert refusal.value.reason is RejectReason.NOT_AUTHORISED

    simulate(scenario, founders=3)
