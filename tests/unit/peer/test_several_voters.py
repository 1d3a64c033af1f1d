"""If this fails, several voters do not decide a cluster's log, or grant leases, as one did, or one of them that is lost takes the cluster along.

Whole lives of nodes in virtual time, with nothing in them but the cluster's log, leases and enrolment.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.missed import MISSED_AGAIN_S, MISSED_S
from scenefold.peer.membership.evicting import Evicting
from scenefold.peer.timing import LIFE_S, T_EVICT_S, T_LEASE_S, T_WAIT_S
from scenefold.wire import DecidedLog, RemoveNode, RemoveParticipant, RequestSceneLog, Want
from scenefold.wire.enrol_entries import Trust
from scenefold.world.sim import run_simulated
from unit.peer.log_cluster import LogCluster, log_cluster
from unit.peer.logs_made import node, secrets_of


@pytest.fixture(autouse=True)
def _in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """What nodes say of each other's crashes is not the subject here."""
    caplog.set_level(logging.CRITICAL + 1, "scenefold")


def simulate(scenario: Callable[[LogCluster], Awaitable[None]], seed: int = 1, founders: int = 5, spares: int = 0, **net: object) -> None:
    async def main() -> None:
        async with log_cluster(seed, founders, spares, **net) as cluster:
            await scenario(cluster)

    run_simulated(seed, main, virtual_s_max=3_600, wall_s_max=100)


async def begun(cluster: LogCluster, *voters: int, count: int = 5) -> None:
    await cluster.start(*range(count))
    await cluster.members(*range(count))
    await cluster.name_voters(*voters)
    await cluster.equal()
    assert {one.log.registry.voters for one in cluster.nodes.values()} == {tuple(node(number) for number in sorted(voters))}


async def removed(cluster: LogCluster, by: int, number: int) -> None:
    """A node dies, and is removed once no voter knows of a lease of it."""
    gone = cluster.nodes[number].own.member
    await cluster.crash(number)
    await trio.sleep(T_WAIT_S)
    await cluster.nodes[by].log.propose(RemoveNode(gone, "gone"))
    await cluster.equal()
    assert not any(one.log.registry.stands(gone.node) for one in cluster.nodes.values())


@pytest.mark.parametrize("voters", [(0,), (0, 1), (0, 1, 2)])
def test_voters_take_over_from_the_key_and_everybody_learns_what_they_decide(voters: tuple[int, ...]) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, *voters)
        await trio.sleep(2 * T_LEASE_S)
        assert all(one.lease.holds() for one in cluster.nodes.values())
        await removed(cluster, 3, 4)
        await cluster.start(4)
        await cluster.members(4)
        assert cluster.nodes[4].renewed == 1
        await cluster.equal()

    simulate(scenario)


def test_the_first_voter_is_missed_by_nobody() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        await cluster.crash(0)
        await trio.sleep(2 * T_LEASE_S)
        assert all(one.lease.holds() for one in cluster.nodes.values())
        await removed(cluster, 3, 4)
        await cluster.crash(3)
        await cluster.start(3)
        await cluster.members(3)
        await cluster.start(0)
        await cluster.members(0)
        await cluster.equal()
        assert cluster.nodes[0].renewed == 0 and not cluster.nodes[0].log.registry.stands(node(4))

    simulate(scenario)


def test_without_a_majority_nothing_is_decided_and_nobody_holds_a_lease_until_it_is_back() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        gone = cluster.nodes[4].own.member
        for number in (0, 1, 4):
            await cluster.crash(number)
        await trio.sleep(2 * T_LEASE_S)
        assert not any(one.lease.holds() for one in cluster.nodes.values())
        position = cluster.nodes[2].log.registry.position
        for number in (2, 3):
            with pytest.raises((Refused, Unreachable)):
                await cluster.nodes[number].log.propose(RemoveNode(gone, "gone"))
        assert cluster.nodes[2].log.registry.position == position
        await cluster.start(1)
        await cluster.members(1, 2, 3)
        await cluster.start(0, 4)
        await cluster.members(0, 4)
        await cluster.equal()

    simulate(scenario)


def test_a_cluster_whose_power_fails_comes_back() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        for number in range(5):
            await cluster.crash(number)
        await cluster.start(*range(5))
        await cluster.members(*range(5))
        assert not any(one.renewed for one in cluster.nodes.values())

    simulate(scenario)


def test_a_cluster_whose_power_fails_in_the_midst_of_a_vote_comes_back() -> None:
    """Who has voted for what is not decided grants no leases; so it must be decided by itself, whoever began it."""

    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, *range(5))
        before = cluster.nodes[0].log.registry.position
        logs = [one.log.voting.voted.log for one in cluster.nodes.values()]

        async def begin() -> None:
            with suppress(Refused, Unreachable):
                await cluster.nodes[2].log.propose(Trust(node(4), True, secrets_of(4).sealing.public.raw, b"anew"))

        def voted() -> int:
            return sum(log._state.slot.accepted is not None for log in logs)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(begin)
            with trio.fail_after(10.0):
                while voted() < 3:  # noqa: ASYNC110  what it waits for is on disks, which tell nobody
                    await trio.sleep(0.0001)
            assert all(log.position == before for log in logs)
            nursery.cancel_scope.cancel()
        for number in range(5):
            await cluster.crash(number)
        await cluster.start(*range(5))
        await cluster.members(*range(5), within_s=100.0)
        await cluster.equal()
        assert cluster.nodes[0].log.registry.position > before

    simulate(scenario)


@pytest.mark.parametrize("lost", [0, 2])
def test_a_voter_that_loses_its_disk_comes_back_as_a_member_and_no_voter(lost: int) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        address = cluster.nodes[lost].address
        await cluster.crash(lost)
        cluster.net.machine(address).disk.wipe()
        cluster.has_key = False
        await cluster.start(lost)
        await cluster.members(lost)
        await cluster.equal()
        registry = cluster.nodes[1].log.registry
        assert node(lost) not in registry.voters and len(registry.voters) == 2 and cluster.nodes[lost].failure is None
        await cluster.patiently(cluster.nodes[1], cluster.naming(lost))
        await cluster.equal()
        assert len(cluster.nodes[lost].log.registry.voters) == 3

    simulate(scenario)


def test_voters_come_and_go_until_none_of_the_first_is_left() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        for gone, come in ((0, 3), (1, 4)):
            out = RemoveParticipant(cluster.nodes[gone].own.member)
            await cluster.patiently(cluster.nodes[2], Trust(node(come), True, secrets_of(come).sealing.public.raw, b"sealed"))
            await cluster.patiently(cluster.nodes[2], cluster.naming(come))
            await cluster.patiently(cluster.nodes[2], out)
        await cluster.equal()
        assert cluster.nodes[0].log.registry.voters == (node(2), node(3), node(4))
        await cluster.ready(2, 3, 4)
        await cluster.crash(0)
        await cluster.crash(1)
        await trio.sleep(2 * T_LEASE_S)
        assert all(cluster.nodes[number].lease.holds() for number in (2, 3, 4))
        await cluster.start(0, 1)
        await cluster.members(0, 1)

    simulate(scenario)


def test_whom_one_voter_hears_is_not_removed_by_another_that_does_not() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        for number in (1, 2):
            cluster.net.cut(cluster.nodes[number].address, cluster.nodes[4].address)
        await trio.sleep(T_WAIT_S)
        with pytest.raises(Refused, match="busy"):
            await cluster.nodes[1].log.propose(RemoveNode(cluster.nodes[4].own.member, "silent"))

    simulate(scenario)


def test_a_voter_whose_disk_is_full_keeps_nobody_from_being_removed() -> None:
    """It lives, and can promise nothing: that all who are there agree is waited for a while, and no longer."""

    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        gone = cluster.nodes[4].own.member
        await cluster.crash(4)
        cluster.net.machine(cluster.nodes[1].address).disk.fill()
        await trio.sleep(T_WAIT_S)
        began, said = trio.current_time(), set[RejectReason]()
        while cluster.nodes[0].log.registry.stands(gone.node):
            try:
                await cluster.nodes[0].log.propose(RemoveNode(gone, "gone"))
            except Refused as refused:
                said.add(refused.reason)
            assert trio.current_time() - began < 2 * MISSED_S
        assert said == {RejectReason.PEER_MISSED}
        assert trio.current_time() - began >= MISSED_S

    simulate(scenario)


def test_a_voter_that_was_missed_long_ago_is_asked_all_the_same() -> None:
    """Of what it could not write then nothing follows for now: the first attempt needs its word, as the one of then did."""

    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        gone, disk = cluster.nodes[4].own.member, cluster.net.machine(cluster.nodes[1].address).disk
        await cluster.crash(4)
        for _ in range(2):
            disk.fill()
            await trio.sleep(T_WAIT_S)
            with pytest.raises(Refused) as refusal:
                await cluster.nodes[0].log.propose(RemoveNode(gone, "gone"))
            assert refusal.value.reason is RejectReason.PEER_MISSED
            disk.fill(None)
            await trio.sleep(MISSED_AGAIN_S)
        assert cluster.nodes[0].log.registry.stands(gone.node)

    simulate(scenario)


@pytest.mark.parametrize("ahead", [0, 1, 2**63, None])
def test_who_claims_to_have_more_than_there_is_is_told_how_far_the_log_is(ahead: int | None) -> None:
    """Anybody may ask, a user too, and says himself how much he has; None: the highest position that a packet can name."""

    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        voting, position = cluster.nodes[3].log.voting, cluster.nodes[3].log.registry.position
        have = 2**64 - 1 if ahead is None else position + ahead
        public = cluster.facts.genesis_header
        for genesis in (public.genesis, b""):
            packet = RequestSceneLog(public.scene, genesis, have, 0, Want.DECIDED, request_id=7)
            answer = await voting.on_decided(packet, "user:ada")
            assert answer is not None and answer.decided == DecidedLog(public.genesis, position, ())

    simulate(scenario)


def test_a_copy_of_a_disk_that_fell_behind_is_told_by_the_voters() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        disk = cluster.net.machine(cluster.nodes[4].address).disk
        backup = disk.snapshot()
        await trio.sleep(2 * LIFE_S)
        await cluster.crash(4)
        disk.restore(backup)
        await cluster.start(4)
        await cluster.members(4)
        assert cluster.nodes[4].renewed == 1

    simulate(scenario)


def test_a_voter_that_is_away_for_long_is_removed_as_one_and_of_two_none_is() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await begun(cluster, 0, 1, 2)
        roster: Any = SimpleNamespace(proof_at=lambda _node: None)
        one = cluster.nodes[1]
        evicting = Evicting(one.clock, one.log, roster, one.id)
        await cluster.crash(0)
        await trio.sleep(T_EVICT_S / 2)
        assert evicting.away() == []
        await trio.sleep(T_EVICT_S)
        assert evicting.away() == [node(0)]
        async with trio.open_nursery() as nursery:
            nursery.start_soon(evicting.run)
            with trio.fail_after(60):
                while one.log.registry.voters != (node(1), node(2)):
                    await one.log.changed_after(one.log.registry.position)
            nursery.cancel_scope.cancel()
        assert one.log.registry.stands(node(0)) and evicting.away() == []

    simulate(scenario)
