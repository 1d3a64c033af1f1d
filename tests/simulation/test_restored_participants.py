"""If this fails, a participant of a scene votes with a disk that has forgotten its votes, or one that has forgotten nothing stays silent."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.reasons import RejectReason
from scenefold.peer.timing import T_LEASE_S
from scenefold.simulation.disks import incarnation_of
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import unpack_votes, votes_key
from scenefold.wire import AcceptSceneProposal, RejectSceneProposal
from scenefold.world.sim import Point
from simulation.assembly import Assembly, assembled

VOTER, A, B, C = range(4)
"""The cluster's voter takes no part in the scene."""
AWHILE_S = 12.0


def wake(them: Assembly, *slots: int) -> None:
    """Let them run, whether they can join or not."""
    for slot in slots:
        them.cluster.start(slot)


async def up(them: Assembly, *slots: int) -> None:
    await them.until(lambda: all(them.node(slot).context is not None for slot in slots))


def voted(them: Assembly, slot: int) -> bool:
    """Whether it has voted at the open position, by its disk."""
    row = them.node(slot).disk.peek(LOGS).get(votes_key(them.genesis))
    return row is not None and unpack_votes(them.genesis, memoryview(row)).slot.accepted is not None


@pytest.mark.parametrize("hears_the_voter", [True, False])
def test_a_restored_backup_decides_nothing_that_it_has_forgotten(hears_the_voter: bool) -> None:
    """It has voted for what was acknowledged; the other one that did is down, and the third never heard of it."""

    async def main(them: Assembly) -> None:
        net, watch, address = them.cluster.net, them.cluster.watch, lambda slot: them.node(slot).address
        await them.create(A, B, C)
        position = await them.commits(A)
        await them.everybody_at(position, A, B, C)
        backup, incarnation = them.node(B).disk.snapshot(), incarnation_of(them.node(B).disk)
        them.crash(B)
        await them.start(B)

        crack = net.partition([address(C)], [address(slot) for slot in (VOTER, A, B)])
        acknowledged = them.following(await them.read(A), them.grant())
        reply = await them.offer(A, acknowledged)
        while not isinstance(reply, AcceptSceneProposal):
            reply = await them.offer(A, acknowledged)
        assert reply.position == position + 1
        await them.everybody_at(position + 1, A, B)
        for slot in (VOTER, A, B):
            # What is on its way to it would come once the cut is over.
            net.reset(address(slot), address(C))
        them.crash(A, B)
        await them.node(B).gone.wait()
        before = watch.records(B)
        them.node(B).disk.restore(backup)
        watch.disk_replaced(B, before, incarnation, "is put back to a backup")
        net.unite(crack)
        if not hears_the_voter:
            net.cut(address(VOTER), address(B))

        other = them.following(await them.read(C), them.grant())
        them.nursery.start_soon(them.offer_in_vain, C, other)
        wake(them, B)
        await up(them, B)
        for _ in range(5):
            reply = await them.offer(C, other)
            assert isinstance(reply, RejectSceneProposal), "decided beside what was acknowledged"
        assert them.position(C) == position
        assert hears_the_voter or not them.takes_part(B)

        await them.node(A).gone.wait()
        await them.start(A)
        await them.everybody_at(position + 1, A, B, C)
        net.mend(address(VOTER), address(B))
        await them.until(lambda: incarnation_of(them.node(B).disk) not in (None, incarnation))
        assert await them.commits(C) == position + 2, "by those whose disks are true"
        for slot in (A, C):
            await them.everybody_at(position + 2, slot)
            requests = (await them.read(slot)).log.state.requests
            assert requests[acknowledged.header.request] == position + 1 and other.header.request not in requests

    assembled(4, main)


def test_without_the_clusters_voter_those_go_on_that_run_and_who_starts_anew_waits_for_it() -> None:
    async def main(them: Assembly) -> None:
        await them.create(A, B, C)
        position = await them.commits(A)
        await them.everybody_at(position, A, B, C)
        them.crash(VOTER, C)
        await them.node(C).gone.wait()
        await trio.sleep(2 * T_LEASE_S)
        assert not any(them.of(slot).lease.holds() for slot in (A, B))
        position = await them.commits(A)
        wake(them, C)
        await up(them, C)
        await them.everybody_at(position, A, B, C)
        await trio.sleep(AWHILE_S)
        assert not them.takes_part(C), "its disk may be an older one"
        position = await them.commits(C)
        await them.everybody_at(position, A, B, C)

        them.crash(A, B)
        await them.until(lambda: all(not them.of(C).roster.is_believed_alive(them.node(slot).node_id) for slot in (A, B)))
        alone = await them.change(C)
        assert isinstance(alone, RejectSceneProposal) and alone.reason is RejectReason.NOT_READY, "it may be asked again"
        for slot in (A, B):
            await them.node(slot).gone.wait()
        wake(them, A, B)
        await up(them, A, B)
        await trio.sleep(AWHILE_S)
        assert not any(them.takes_part(slot) for slot in (A, B, C))
        await them.start(VOTER)
        assert await them.commits(B) == position + 1
        await them.everybody_at(position + 1, A, B, C)

    assembled(4, main)


def test_what_all_have_voted_for_when_the_power_fails_is_brought_to_its_end() -> None:
    """By the participants themselves, once they may speak, though nobody asks for it."""

    async def main(them: Assembly) -> None:
        await them.create(A, B, C)
        position = await them.commits(A)
        await them.everybody_at(position, A, B, C)
        offered = them.following(await them.read(A), them.grant())

        def fails() -> None:
            if voted(them, A):
                them.crash(VOTER, A, B, C)
            else:
                trap()

        def trap() -> None:
            them.cluster.net.trap(them.node(A).address, Point.AFTER_COMMIT, 1, fails)

        trap()
        them.nursery.start_soon(them.offer_in_vain, A, offered)
        await them.until(lambda: them.node(A).context is None)
        await them.start(VOTER, A, B, C)
        await them.everybody_at(position + 1, A, B, C)
        assert (await them.read(C)).log.state.requests[offered.header.request] == position + 1

    assembled(4, main)
