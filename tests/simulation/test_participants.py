"""If this fails, nodes that decide a scene's log together lose what is decided, decide twice, or say something else of it than is true."""

from __future__ import annotations

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.scene.log import opened_value
from scenefold.store.layout import HEADERS, LOGS, scene_key
from scenefold.store.log_rows import decided_key, unpack_decided
from scenefold.wire import AcceptSceneProposal, Batch, RejectSceneProposal
from scenefold.world.sim import Point
from simulation.assembly import Assembly, assembled
from simulation.quiet import overwrite


async def alike(them: Assembly, *slots: int) -> int:
    """All of these show the same log; gives its position."""
    position = max(them.position(slot) for slot in slots)
    await them.everybody_at(position, *slots)
    reads = [await them.read(slot) for slot in slots]
    assert len({(read.public.signable(), read.private) for read in reads}) == 1
    return position


@pytest.mark.parametrize("count", [1, 3, 5])
def test_participants_decide_whoever_is_asked(count: int) -> None:
    async def main(them: Assembly) -> None:
        slots = range(count)
        await them.create(*slots)
        for at, slot in enumerate(slots):
            reply = await them.change(slot)
            assert isinstance(reply, AcceptSceneProposal) and reply.position == at + 2, reply
            await them.everybody_at(reply.position, *slots)
        assert await alike(them, *slots) == count + 1

    assembled(count, main)


def test_one_is_away_and_comes_back_and_all_start_anew() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(1)
        them.crash(2)
        for slot in (0, 1, 0):
            await them.commits(slot)
        await them.start(2)
        assert await alike(them, 0, 1, 2) == 5
        assert await them.commits(2) == 6
        them.crash(0, 1, 2)
        await them.start(0, 1, 2)
        assert await alike(them, 0, 1, 2) == 6
        assert await them.commits(0) == 7
        assert await alike(them, 0, 1, 2) == 7

    assembled(3, main)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_who_proposes_dies_at_a_write_and_the_others_go_on(count: int) -> None:
    """Behind its promise, its vote, or the decision: either nothing is left of it, or it is decided everywhere."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        offered = them.following(await them.read(1), them.grant())
        them.cluster.net.trap(them.node(1).address, Point.AFTER_COMMIT, count, lambda: them.crash(1))
        them.nursery.start_soon(them.offer_in_vain, 1, offered)
        await them.until(lambda: them.node(1).context is None)
        position = await them.commits(2)
        assert position <= 4
        await them.start(1)
        assert await alike(them, 0, 1, 2) == position
        requests = (await them.read(1)).log.state.requests
        assert (offered.header.request in requests) == (position == 4)

    assembled(3, main)


def test_the_side_without_a_majority_decides_nothing_and_reads_on() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2, 3, 4)
        await them.commits(0)
        addresses = [them.node(slot).address for slot in range(5)]
        crack = them.cluster.net.partition(addresses[:2], addresses[2:])
        few = await them.change(0)
        assert isinstance(few, RejectSceneProposal) and few.reason in (RejectReason.NO_MAJORITY, RejectReason.NOT_READY), few
        assert (await them.read(0)).public.position == 2
        assert await them.commits(3) == 3
        them.cluster.net.unite(crack)
        assert await alike(them, *range(5)) >= 3
        await them.commits(0)
        await alike(them, *range(5))

    assembled(5, main)


def test_participants_come_and_go() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        assert await them.commits(1, them.added(3)) == 3
        await them.until(lambda: them.takes_part(3))
        await them.everybody_at(3, *range(5))
        them.crash(2)
        assert await them.commits(3) == 4, "three of four"
        await them.start(2)
        assert await them.commits(0, them.removed(1)) == 5
        await them.until(lambda: not them.takes_part(1))
        assert await them.commits(0) == 6
        assert await alike(them, 0, 1, 2, 3) == 6, "who was removed learns on, and tells"
        assert await them.commits(1) == 7, "it hands on what it is asked for"
        them.crash(1)
        await them.start(1)
        assert await alike(them, 0, 1, 2, 3) == 7
        assert not them.takes_part(1)

    assembled(5, main)


def test_a_node_that_lost_its_disk_votes_no_more_until_it_is_added_again() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        lost = them.removed(2)
        them.crash(2)
        await them.node(2).gone.wait()
        them.cluster.wipe(them.node(2), "test")
        await them.start(2)
        await them.everybody_at(2, 0, 1, 2)
        assert not them.takes_part(2)
        them.crash(1)
        alone = await them.change(0)
        assert isinstance(alone, RejectSceneProposal) and alone.reason is RejectReason.NO_MAJORITY, alone
        await them.start(1)
        await them.commits(0, lost)
        await them.commits(0, them.added(2))
        await them.until(lambda: them.takes_part(2))
        them.crash(1)
        assert await them.commits(2) == 5
        await alike(them, 0, 2)

    assembled(3, main)


def test_what_nobody_keeps_any_more_is_passed_over() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        them.crash(2)
        for _ in range(4):
            await them.commits(0)
        for slot in (0, 1):
            for position in (3, 4):
                overwrite(them.node(slot).disk, LOGS, decided_key(them.genesis, position), None)
        await them.start(2)
        assert await alike(them, 0, 1, 2) == 6
        assert them.takes_part(2)
        them.crash(1)
        assert await them.commits(2) == 7
        them.crash(0, 2)
        await them.start(0, 1, 2)
        assert await alike(them, 0, 1, 2) == 7

    assembled(3, main)


def test_a_header_that_rotted_is_had_from_the_others() -> None:
    """The rows of the log say what this node has voted for, so it may begin by a header that it is shown, be that an old one."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await them.commits(0)
        await them.everybody_at(2, 0, 1, 2)
        them.crash(2)
        overwrite(them.node(2).disk, HEADERS, scene_key(them.scene), b"rotten")
        await them.start(2)
        await them.until(lambda: them.takes_part(2))
        them.crash(1)
        assert await them.commits(0) == 3, "with its vote"
        await them.start(1)
        assert await alike(them, 0, 1, 2) == 3

    assembled(3, main)


def test_the_origin_decides_alone_until_it_names_others() -> None:
    async def main(them: Assembly) -> None:
        await them.create()
        assert await them.commits(0) == 2
        assert await them.commits(0, Batch((them.added(1), them.added(2), them.added(3)))) == 3
        # Whoever is asked at once may be about to learn that it decides.
        assert await them.commits(0) == 4
        await them.everybody_at(4, *range(4))
        them.crash(0)
        assert await them.commits(2) == 5
        await them.start(0)
        await them.everybody_at(5, *range(4))

    assembled(4, main)


def test_of_older_positions_the_sealed_logs_go_also_over_a_start() -> None:
    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        for _ in range(2):
            await them.commits(0)
        them.crash(0, 1, 2)
        await them.start(0, 1, 2)
        await them.commits(1)
        await them.everybody_at(4, 0, 1, 2)
        for slot in range(3):
            rows = them.node(slot).disk.peek(LOGS)
            keys = [decided_key(them.genesis, position) for position in (2, 3, 4)]
            bodies = [opened_value(unpack_decided(key, memoryview(rows[key])).value) for key in keys]
            assert [bool(body.private) for body in bodies] == [False, False, True]

    assembled(3, main)
