"""If this fails, nodes disagree on who is a member, or two of them may speak for the same arc.

Whole lives of nodes in virtual time, with nothing in them but the cluster's log, leases and enrolment.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial

import pytest
import trio

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.log_pull import LogPuller
from scenefold.peer.cluster_log.log_voter import first_trust_of
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.timing import RENEW_S, SYNC_S, T_LEASE_S, T_WAIT_S
from scenefold.wire import Member, RemoveNode
from scenefold.wire.enrol_entries import Trust
from scenefold.world.sim import Delay, Point, Weather, run_simulated
from scenefold.world.sim.time import current_time_of_simulation
from unit.peer.log_cluster import LogCluster, log_cluster
from unit.peer.logs_made import node


@pytest.fixture(autouse=True)
def _in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """What nodes say of each other's crashes is not the subject here."""
    caplog.set_level(logging.CRITICAL + 1, "scenefold")


def simulate(scenario: Callable[[LogCluster], Awaitable[None]], seed: int = 1, founders: int = 3, spares: int = 0, **net: object) -> None:
    async def main() -> None:
        async with log_cluster(seed, founders, spares, **net) as cluster:
            await scenario(cluster)

    run_simulated(seed, main, virtual_s_max=3_600, wall_s_max=60)


def removal_of(cluster: LogCluster, number: int, why: str = "gone") -> RemoveNode:
    known = cluster.nodes[0].log.registry.current(node(number))
    return RemoveNode(Member(node(number), NO_INCARNATION if known is None else known.incarnation), why)


@pytest.mark.parametrize("seed", range(3))
def test_founders_become_members_whoever_starts_first(seed: int) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(2, 1)
        await trio.sleep(5)
        assert cluster.nodes[1].log.registry.position == 0 and not cluster.nodes[1].lease.holds()
        await cluster.start(0)
        await cluster.members(0, 1, 2)
        await cluster.equal()
        registry = cluster.nodes[2].log.registry
        assert registry.members == (node(0), node(1), node(2)) and registry.position == 4
        assert [registry.founding_arc(member) is not None for member in registry.members] == [True] * 3

    simulate(scenario, seed)


@pytest.mark.parametrize("seed", range(3))
def test_whom_the_cluster_trusts_from_its_start_is_trusted_before_anybody_is_a_member(seed: int) -> None:
    async def scenario(cluster: LogCluster) -> None:
        cluster.facts = replace(cluster.facts, trusted=(node(1), node(3)))
        await cluster.start(1, 2, 0)
        await cluster.members(0, 1, 2)
        await cluster.equal()
        registry = cluster.nodes[2].log.registry
        assert registry.roll.trusted == {node(0), node(1), node(3)}
        assert all(known.position > 3 for member in registry.members if (known := registry.current(member)))

    simulate(scenario, seed, spares=1)


def test_a_first_trust_that_was_withdrawn_does_not_come_back_with_a_restart_and_one_that_was_interrupted_does() -> None:
    async def scenario(cluster: LogCluster) -> None:
        whole = cluster.facts
        cluster.facts = replace(whole, trusted=(node(1),))
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        voter = cluster.nodes[0].log
        await voter.propose(Trust(node(1), False))
        assert voter.registry.roll.trusted == {node(0)}
        await cluster.crash(0)
        # As if the disk had been full, or the power gone, when it came to node 2.
        cluster.facts = replace(whole, trusted=(node(1), node(2)))
        await cluster.start(0)
        await cluster.nodes[1].log.changed_after(voter.registry.position)
        assert cluster.nodes[1].log.registry.roll.trusted == {node(0), node(2)}

    simulate(scenario)


def test_a_member_that_takes_the_request_id_of_a_first_trust_does_not_keep_that_out_of_the_log() -> None:
    async def scenario(cluster: LogCluster) -> None:
        whole = cluster.facts

        async def started_anew(*trusted: int) -> None:
            position = cluster.nodes[0].log.registry.position
            await cluster.crash(0)
            cluster.facts = replace(whole, trusted=tuple(map(node, trusted)))
            await cluster.start(0)
            await cluster.nodes[1].log.changed_after(position)

        await cluster.start(0, 1)
        await cluster.members(0, 1)
        for attempt, number in enumerate((2, 3)):
            gone = RemoveNode(Member(node(number), NO_INCARNATION), "never came")
            await cluster.nodes[1].log.propose(gone, first_trust_of(node(1), attempt))
        await started_anew(1)
        assert cluster.nodes[1].log.registry.roll.trusted == {node(0), node(1)}
        await cluster.nodes[0].log.propose(Trust(node(1), False))
        await started_anew(1, 4)
        assert cluster.nodes[1].log.registry.roll.trusted == {node(0), node(4)}, "withdrawn for ever"

    simulate(scenario, founders=5)


def test_a_spare_joins_and_everybody_knows_at_once() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        await cluster.start(3)
        await cluster.members(3, within_s=5)
        await cluster.equal(within_s=1)
        assert cluster.nodes[1].log.registry.order == (node(3), node(0), node(1), node(2))

    simulate(scenario, spares=1)


def test_many_that_start_at_once_cost_few_pushes() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(*range(20))
        await cluster.members(*range(20))
        await cluster.equal()
        assert len(cluster.nodes[7].log.registry.members) == 20

    simulate(scenario, founders=20)


def test_a_lost_push_is_mended_by_asking() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        await cluster.equal()
        cluster.net.cut(cluster.nodes[0].address, cluster.nodes[2].address)
        await cluster.start(3)
        await cluster.members(3)
        await cluster.nodes[2].log.changed_after(4)  # the voter is out of reach, but another one tells

    simulate(scenario, spares=1)


def test_a_lease_ends_without_the_voter_and_comes_back_with_it() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        cluster.net.cut(cluster.nodes[0].address, cluster.nodes[1].address)
        await trio.sleep(T_LEASE_S - RENEW_S - 0.5)
        assert cluster.nodes[1].lease.holds(), "one or two lost renewals cost nothing"
        await trio.sleep(RENEW_S + 1)
        assert not cluster.nodes[1].lease.holds() and cluster.nodes[2].lease.holds()
        with pytest.raises(Unreachable):
            await cluster.nodes[1].log.propose(removal_of(cluster, 2))
        cluster.net.mend(cluster.nodes[0].address, cluster.nodes[1].address)
        await cluster.members(1, within_s=10)

    simulate(scenario)


def test_a_lease_does_not_survive_a_restart() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        cluster.net.cut(cluster.nodes[0].address, cluster.nodes[1].address)
        await cluster.crash(1)
        await cluster.start(1)
        await trio.sleep(1)
        assert cluster.nodes[1].log.registry.position == 3 and not cluster.nodes[1].lease.holds()

    simulate(scenario, founders=2)


def test_who_is_removed_while_away_begins_anew_as_a_newcomer() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        before = cluster.nodes[2].own.incarnation
        await cluster.crash(2)
        await cluster.nodes[1].log.propose(removal_of(cluster, 2, "silent"))
        assert cluster.nodes[0].log.registry.order == (node(0), node(1))
        await cluster.start(2)
        await trio.sleep(3)
        await cluster.members(2)
        back = cluster.nodes[2]
        assert back.renewed == 1 and back.own.incarnation != before
        assert back.log.registry.removal(before) is not None and back.log.registry.founding_arc(node(2)) is None

    simulate(scenario)


def test_who_is_removed_while_running_loses_its_lease_as_soon_as_it_learns() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        lease, log = cluster.nodes[2].lease, cluster.nodes[2].log
        await cluster.nodes[1].log.propose(removal_of(cluster, 2))
        await log.changed_after(4)
        assert not lease.holds()
        await trio.sleep(1)
        await cluster.members(2)
        assert cluster.nodes[2].renewed == 1

    simulate(scenario)


def test_a_wiped_node_waits_until_its_earlier_lease_is_over() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        before = cluster.nodes[2].own.incarnation
        granted_at = cluster.nodes[0].log.leased_at(node(2))
        assert granted_at is not None
        await cluster.crash(2)
        cluster.net.machine(cluster_address(cluster, 2)).disk.wipe()
        await cluster.start(2)
        crashed_at = trio.current_time()
        await trio.sleep(T_LEASE_S - RENEW_S - 1)
        assert cluster.nodes[0].log.registry.is_current(Member(node(2), before)), "its lease may still be alive"
        await cluster.members(2)
        assert trio.current_time() - crashed_at > T_WAIT_S - RENEW_S - 1
        removal = cluster.nodes[2].log.registry.removal(before)
        assert removal is not None and "an empty or an older data folder" in removal.reason
        assert cluster.nodes[2].renewed == 0

    simulate(scenario)


def cluster_address(cluster: LogCluster, number: int) -> str:
    return cluster.facts.credentials[number].address


def test_a_node_whose_disk_is_as_it_was_is_welcome() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        for _ in range(3):
            await cluster.crash(2)
            await cluster.start(2)
            await cluster.members(2, within_s=5)
        assert cluster.nodes[2].renewed == 0 and cluster.nodes[2].log.registry.position == 4

    simulate(scenario)


def test_a_restarted_voter_goes_on_where_it_was() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        await cluster.crash(0)
        await trio.sleep(T_WAIT_S)
        assert not cluster.nodes[1].lease.holds()
        await cluster.start(0)
        await cluster.members(0, 1, 2, within_s=10)
        assert cluster.nodes[0].log.lapsed() == []
        await cluster.crash(2)
        await trio.sleep(T_WAIT_S + 1)
        assert cluster.nodes[0].log.lapsed() == [node(2)]

    simulate(scenario)


@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT])
@pytest.mark.parametrize("count", range(1, 5))
def test_a_voter_that_dies_in_the_middle_of_a_commit_forgets_nothing_that_it_told(point: Point, count: int) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        address, voter = cluster.nodes[0].address, cluster.nodes[0]

        def die() -> None:
            cluster.net.crash(address)
            voter.scope.cancel()

        cluster.net.trap(address, point, count, die)
        await cluster.start(3)
        with trio.move_on_after(15):
            await voter.ended.wait()
        known = cluster.nodes[1].log.registry
        if voter.ended.is_set():
            await cluster.start(0)
        await cluster.members(0, 1, 2, 3)
        await cluster.equal()
        registry = cluster.nodes[0].log.registry
        assert registry.position == 5 and known.position in (4, 5)
        assert known.position == 4 or registry.head == known.head

    simulate(scenario, spares=1)


def test_a_wiped_voter_does_not_begin_a_second_log() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.crash(0)
        cluster.net.machine(cluster_address(cluster, 0)).disk.wipe()
        await cluster.start(0)
        with trio.fail_after(10):
            await cluster.nodes[0].ended.wait()
        assert isinstance(cluster.nodes[0].failure, LocalFault)
        assert cluster.nodes[1].log.registry.position == 3

    simulate(scenario, founders=2)


def test_a_request_is_committed_once_however_often_it_is_made() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        entry, request = removal_of(cluster, 2), b"q" * 16
        positions = {await cluster.nodes[number].log.propose(entry, request) for number in (1, 1, 0)}
        assert positions == {4} and cluster.nodes[0].log.registry.position == 4

    simulate(scenario)


def test_what_stands_in_the_log_under_the_id_of_a_request_answers_for_no_other() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        voter, request = cluster.nodes[0].log, b"q" * 16
        assert await cluster.nodes[1].log.propose(removal_of(cluster, 2), request) == 4
        for number in (0, 1):
            with pytest.raises(Refused) as caught:
                await cluster.nodes[number].log.propose(removal_of(cluster, 1), request)
            assert caught.value.reason is RejectReason.ILL_FORMED
        assert voter.registry.position == 4 and voter.registry.current(node(1)) is not None

    simulate(scenario)


def test_proposals_that_are_refused_fill_no_log(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.nodes[1].log.propose(removal_of(cluster, 2), b"q" * 16)
        for _ in range(5):
            with pytest.raises(Refused):
                await cluster.nodes[1].log.propose(removal_of(cluster, 1), b"q" * 16)

    caplog.set_level(logging.INFO, "scenefold.peer.cluster_log.cluster_log")
    simulate(scenario)
    assert len([line for line in caplog.messages if "a proposal is refused" in line]) == 1


def test_removals_of_others_may_be_vetoed_and_leaving_may_not() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        asked: list[Member] = []

        async def veto(member: Member) -> str | None:
            asked.append(member)
            return "it answers"

        cluster.nodes[0].log.veto = veto
        with pytest.raises(Refused) as caught:
            await cluster.nodes[1].log.propose(removal_of(cluster, 2))
        assert caught.value.reason == RejectReason.BUSY and [one.node for one in asked] == [node(2)]
        await cluster.nodes[2].log.propose(removal_of(cluster, 2))
        assert len(asked) == 1 and not cluster.nodes[0].log.registry.stands(node(2))

    simulate(scenario)


def test_a_full_disk_at_the_voter_commits_nothing_until_there_is_room() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        disk = cluster.net.machine(cluster_address(cluster, 0)).disk
        disk.fill(0)
        with pytest.raises(Refused) as caught:
            await cluster.nodes[1].log.propose(removal_of(cluster, 2))
        assert caught.value.reason == RejectReason.STORAGE_FULL
        disk.fill(None)
        assert await cluster.nodes[1].log.propose(removal_of(cluster, 2)) == 4

    simulate(scenario)


def test_a_disk_that_fills_up_while_the_log_is_kept_leaves_one_that_can_be_read() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.equal()
        address = cluster_address(cluster, 1)
        disk = cluster.net.machine(address).disk
        cluster.net.trap(address, Point.AFTER_COMMIT, 1, partial(disk.fill, 0))
        await cluster.nodes[0].log.propose(removal_of(cluster, 2))
        await trio.sleep(SYNC_S)
        disk.fill(None)
        await cluster.equal()
        await cluster.crash(1)
        await cluster.start(1)
        await cluster.members(1)
        assert cluster.nodes[1].log.registry.position == cluster.nodes[0].log.registry.position == 4

    simulate(scenario)


def test_who_is_removed_while_its_disk_is_full_begins_anew_once_there_is_room() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        one = cluster.nodes[1]
        disk = cluster.net.machine(one.address).disk
        disk.fill(0)
        await cluster.nodes[0].log.propose(removal_of(cluster, 1))
        await trio.sleep(2 * T_WAIT_S)
        assert not one.ended.is_set() and not one.lease.holds()
        assert one.renewed == 0
        disk.fill(None)
        await trio.sleep(T_WAIT_S)
        assert one.renewed == 1
        await cluster.members(1)

    simulate(scenario)


@pytest.mark.parametrize("seed", range(8))
def test_in_bad_weather_all_come_to_the_same_log(seed: int) -> None:
    """Loss is for datagrams; streams are slow and break. Nodes crash and come back; entries are made meanwhile."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2, 3)
        for round_number in range(6):
            victim = 1 + (seed + round_number) % 3
            await trio.sleep(2 + (seed * 7 + round_number * 3) % 5)
            await cluster.crash(victim)
            cluster.net.reset(cluster_address(cluster, 0), cluster_address(cluster, 1))
            if round_number == 3:
                await cluster.crash(0)
                await trio.sleep(1)
                await cluster.start(0)
            await trio.sleep(1)
            await cluster.start(victim)
        await cluster.members(0, 1, 2, 3)
        await trio.sleep(SYNC_S)
        await cluster.equal()
        assert len(cluster.nodes[0].log.registry.members) == 4
        assert cluster.nodes[0].log.registry.position == 5, "nobody registered twice"

    simulate(scenario, seed, founders=4, weather=Weather(delay=Delay(0.001, 0.02, 0.5)))


def test_who_renews_a_lease_need_not_ask_for_the_log_besides() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        await cluster.equal()
        await trio.sleep(SYNC_S)
        before = cluster.net.trace.counts["tcp-send"]
        await trio.sleep(6 * SYNC_S)
        # Two nodes ask for leases, and are answered; the voter asks itself.
        assert cluster.net.trace.counts["tcp-send"] - before <= 2 * 2 * (6 * SYNC_S / RENEW_S + 1)

    simulate(scenario)


def test_a_voter_that_heard_a_false_claim_comes_to_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    pulls: list[float] = []
    pull = LogPuller.pull

    async def counting(self: LogPuller, at_least: int = 0) -> None:
        pulls.append(trio.current_time())
        await pull(self, at_least)

    monkeypatch.setattr(LogPuller, "pull", counting)

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        await trio.sleep(SYNC_S)
        pulls.clear()
        cluster.nodes[0].log.heard_of(node(1), 1_000)
        steps = current_time_of_simulation().steps
        await trio.sleep(6 * SYNC_S)
        assert len(pulls) == 1, "it asks at once, and once"
        assert pulls[0] < trio.current_time() - 5 * SYNC_S
        assert current_time_of_simulation().steps - steps < 2_000

    simulate(scenario)
