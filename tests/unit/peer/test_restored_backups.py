"""If this fails, a restored backup speaks for the node, or a node is taken for a backup of itself.

Whole lives of nodes in virtual time, as in test_cluster_log; the rule alone is in test_lives.
"""

from __future__ import annotations

import logging
from functools import partial

import pytest
import trio

from scenefold.peer.cluster_log.lives import note_of
from scenefold.peer.cluster_log.own_life import NOTE
from scenefold.peer.timing import LIFE_S, RENEW_S, T_LEASE_S
from scenefold.store import Store
from scenefold.store.changes import storage_full
from scenefold.store.layout import NOTES
from scenefold.world.sim import Point
from unit.peer.log_cluster import LogCluster
from unit.peer.logs_made import node
from unit.peer.test_cluster_log import cluster_address, simulate


@pytest.fixture(autouse=True)
def _in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """What nodes say of each other's crashes is not the subject here."""
    caplog.set_level(logging.CRITICAL + 1, "scenefold")


@pytest.mark.parametrize("starts", [1, 3])
@pytest.mark.parametrize("deaths", [0, 1, 4])
def test_a_restored_backup_is_noticed(starts: int, deaths: int) -> None:
    """However often the node was started before, and the backup is after: what it dies of first is not a start."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.crash(1)
        disk = cluster.net.machine(cluster_address(cluster, 1)).disk
        backup = disk.snapshot()
        for _ in range(starts):
            await cluster.start(1)
            await cluster.members(1)
            before = cluster.nodes[1].own.incarnation
            await cluster.crash(1)
        disk.restore(backup)
        cluster.net.cut(cluster.nodes[0].address, cluster_address(cluster, 1))
        for _ in range(deaths):
            await cluster.start(1)
            await trio.sleep(0.5)
            await cluster.crash(1)
        cluster.net.mend(cluster.nodes[0].address, cluster_address(cluster, 1))
        await cluster.start(1)
        await trio.sleep(2)
        await cluster.members(1)
        assert cluster.nodes[1].renewed == 1 and cluster.nodes[1].own.incarnation != before
        assert cluster.nodes[0].log.registry.removal(before) is not None

    simulate(scenario, founders=2)


def test_a_process_knows_that_its_life_was_granted_though_it_loses_its_lease() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        assert cluster.nodes[1].lease.begun.is_set()
        await cluster.crash(1)
        cluster.net.cut(cluster.nodes[0].address, cluster_address(cluster, 1))
        await cluster.start(1)
        await trio.sleep(2 * T_LEASE_S)
        assert not cluster.nodes[1].lease.begun.is_set(), "the life on its disk may be an older one"
        cluster.net.mend(cluster.nodes[0].address, cluster_address(cluster, 1))
        await cluster.members(1)
        cluster.net.cut(cluster.nodes[0].address, cluster_address(cluster, 1))
        await trio.sleep(2 * T_LEASE_S)
        assert not cluster.nodes[1].lease.holds() and cluster.nodes[1].lease.begun.is_set()

    simulate(scenario, founders=2)


def test_a_backup_of_the_present_run_is_noticed_once_it_is_older_than_a_minute() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        disk, before = cluster.net.machine(cluster_address(cluster, 1)).disk, cluster.nodes[1].own.incarnation
        backup = disk.snapshot()
        await trio.sleep(LIFE_S + T_LEASE_S)
        await cluster.crash(1)
        disk.restore(backup)
        await cluster.start(1)
        await trio.sleep(2)
        await cluster.members(1)
        assert cluster.nodes[1].renewed == 1 and cluster.nodes[0].log.registry.removal(before) is not None

    simulate(scenario, founders=2)


def test_what_the_voter_wrote_counts_though_who_asked_is_gone() -> None:
    """The voter's disk is slow: the new life is in it, and before the write has returned, the asker is dead."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        voters, disk = (cluster.net.machine(cluster_address(cluster, index)).disk for index in range(2))
        before = cluster.nodes[1].own.incarnation
        await cluster.crash(1)
        backup, name = disk.snapshot(), note_of(node(1)).encode()
        granted = voters.peek(NOTES).get(name)
        voters.slow(0.5)
        await cluster.start(1)
        with trio.fail_after(20):
            while voters.peek(NOTES).get(name) == granted:  # noqa: ASYNC110 - nothing tells of a write that has not returned
                await trio.sleep(0.01)
        await cluster.crash(1)
        voters.slow(0.0)
        disk.restore(backup)
        await cluster.start(1)
        await trio.sleep(2)
        await cluster.members(1)
        assert cluster.nodes[1].renewed == 1 and cluster.nodes[0].log.registry.removal(before) is not None

    simulate(scenario, founders=2)


def test_of_a_node_and_the_copy_of_its_disk_only_one_is_the_node() -> None:
    """What a very young copy is granted, its original is not."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        disk = cluster.net.machine(cluster_address(cluster, 1)).disk
        original = disk.snapshot()
        await cluster.crash(1)
        for expected in (0, 1):
            disk.restore(original)
            await cluster.start(1)
            await trio.sleep(2)
            await cluster.members(1)
            assert cluster.nodes[1].renewed == expected
            await cluster.crash(1)

    simulate(scenario, founders=2)


def strike(cluster: LogCluster, address: str, struck: trio.Event) -> None:
    cluster.net.crash(address)
    struck.set()


@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT, Point.BEFORE_SEND, Point.AFTER_SEND])
@pytest.mark.parametrize("who", [0, 1], ids=["the voter", "the asker"])
def test_who_crashes_while_a_life_is_drawn_asked_with_or_granted_stays_a_member(point: Point, who: int) -> None:
    """At each of the first steps after a minute, one after the other; a crash of the one while the other's answers are lost."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        for step in range(1, 5):
            await trio.sleep(LIFE_S - RENEW_S)
            struck, address = trio.Event(), cluster_address(cluster, who)
            cluster.net.trap(address, point, step, partial(strike, cluster, address, struck))
            await struck.wait()
            await cluster.crash(who)
            if step % 2:
                other = 1 - who
                await cluster.crash(other)
                await cluster.start(other)
            await cluster.start(who)
            await cluster.members(0, 1)
        assert cluster.nodes[0].log.registry.position == 3, "nobody was taken for a backup"

    simulate(scenario, founders=2)


def test_an_hour_without_the_voter_makes_nobody_a_newcomer() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        cluster.net.cut(cluster.nodes[0].address, cluster.nodes[1].address, one_way=True)  # asked, granted, and never heard of
        await trio.sleep(600)
        for _ in range(20):
            await cluster.crash(1)
            await cluster.start(1)
            await trio.sleep(120)
        cluster.net.mend(cluster.nodes[0].address, cluster_address(cluster, 1), one_way=True)
        await cluster.members(1, within_s=10)
        assert cluster.nodes[1].renewed == 0 and cluster.nodes[0].log.registry.position == 4

    simulate(scenario)


def test_a_full_disk_lets_the_old_life_serve_on_but_begins_none(monkeypatch: pytest.MonkeyPatch) -> None:
    full = False
    put_note = Store.put_note

    async def refusing(store: Store, name: str, value: bytes) -> None:
        if full and name == NOTE and store.identity.node == node(1):
            raise storage_full()
        await put_note(store, name, value)

    monkeypatch.setattr(Store, "put_note", refusing)

    async def scenario(cluster: LogCluster) -> None:
        nonlocal full
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        lives = cluster.nodes[1].lease._life.lives
        full = True
        await trio.sleep(3 * LIFE_S)
        assert cluster.nodes[1].lease.holds() and cluster.nodes[1].lease._life.lives == lives
        full = False
        await trio.sleep(2 * RENEW_S)
        assert cluster.nodes[1].lease.holds() and cluster.nodes[1].lease._life.lives.before == lives.now
        await cluster.crash(1)
        full = True
        await cluster.start(1)
        await trio.sleep(LIFE_S)
        assert not cluster.nodes[1].lease.holds()
        full = False
        await cluster.members(1, within_s=2)
        assert cluster.nodes[1].renewed == 0

    simulate(scenario, founders=2)


def test_damaged_lives_make_a_newcomer() -> None:
    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1)
        await cluster.members(0, 1)
        await cluster.nodes[1].lease._life._store.put_note(NOTE, b"?")
        await cluster.crash(1)
        await cluster.start(1)
        await trio.sleep(2)
        await cluster.members(1)
        assert cluster.nodes[1].renewed == 1

    simulate(scenario, founders=2)


def test_a_life_that_the_log_does_not_know_says_nothing_for_the_one_before() -> None:
    """What others hear of its end must not be that it lives, and owns nothing: they would give away what it owned."""

    async def scenario(cluster: LogCluster) -> None:
        await cluster.start(0, 1, 2)
        await cluster.members(0, 1, 2)
        assert cluster.nodes[1].own.is_registered
        await cluster.crash(1)
        await trio.sleep(1)
        cluster.net.machine(cluster_address(cluster, 1)).disk.wipe()
        roster = cluster.nodes[2].roster
        signs, former = roster.signs(node(1)), roster.incarnation(node(1))
        cluster.net.cut(cluster.nodes[0].address, cluster_address(cluster, 1))
        await cluster.start(1)
        own, log = cluster.nodes[1].own, cluster.nodes[1].log
        for _ in range(3):
            await log.pull_from(node(2))
        assert log.registry.position == cluster.nodes[2].log.registry.position
        assert not own.is_registered and own.mini().lamport == 0
        assert (roster.signs(node(1)), roster.incarnation(node(1))) == (signs, former)
        cluster.net.mend(cluster.nodes[0].address, cluster_address(cluster, 1))
        await cluster.members(1)
        assert own.is_registered and roster.incarnation(node(1)) == own.incarnation
        await log.pull_from(node(2))
        assert roster.signs(node(1)) > 0

    simulate(scenario, founders=3)
