"""If this fails, a claim by a log that is not known here yet counts too early, or for ever, or an older one counts instead of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.base.location import LAST, WHOLE_LINE, Location
from scenefold.wire import Member, PingBroadcast, RemoveNode
from unit.peer.test_gossip import signed
from unit.peer.village import incarnation_of, node_at, village
from unit.peer.voices import say


async def test_who_knows_more_of_the_log_is_believed_once_we_know_as_much(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3, registered=2) as them:
        await them.start(0)
        await them.start(1)
        await them.of(0).gossip.somebody_heard()
        await trio.sleep(1)
        them.of(0).own.arc = None
        them.of(1).own.arc, them.of(1).own.log_position = WHOLE_LINE, them.registry.position + 1
        await trio.sleep(5)
        assert them.of(0).roster.arcs()[node_at(1)] != WHOLE_LINE
        them.ether.lost = lambda _source, _target: True
        them.register(2)
        await trio.testing.wait_all_tasks_blocked()
        assert them.of(0).roster.arcs()[node_at(1)] == WHOLE_LINE, "what was told before the log came counts without being told again"


async def test_a_claim_that_came_too_early_does_not_outlive_a_later_word_of_the_same_node(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3, registered=2) as them:
        await them.start(0)
        await them.start(1)
        await trio.sleep(5)
        robbed, other = them.of(1), them.of(0)
        true, other.own.arc = robbed.own.arc, None
        position = them.registry.position + 1
        early = signed(replace(robbed.own.signed(), left_fence=None, lamport=(1 << 32) + 5_000_000, log_position=position))
        await say(robbed, PingBroadcast((early,)), other.own.me)
        await trio.sleep(60)
        them.register(2)
        await trio.testing.wait_all_tasks_blocked()
        assert other.roster.arcs()[robbed.own.me] == true


@pytest.mark.parametrize("numbers", [(10, 20), (20, 10)])
async def test_of_claims_that_came_too_early_the_newest_counts_in_whatever_order_they_came(
    numbers: tuple[int, int], autojump_clock: trio.testing.MockClock
) -> None:
    async with village(4, registered=3) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(5)
        hearer, author = them.of(0), them.of(1)
        hearer.own.arc = None
        now, position = author.own.signed(), them.registry.position + 1
        them.ether.lost = lambda _source, _target: True
        for number in numbers:
            bound = Location.from_number(number)
            early = signed(replace(now, lamport=now.lamport + number, left_fence=None, right_bound=bound, log_position=position))
            hearer.gossip._hearing.hear(PingBroadcast((early,), request_id=1), them.of(2).own.me)
        them.register(3)
        await trio.testing.wait_all_tasks_blocked()
        assert hearer.roster.arcs()[author.own.me].last == Location.from_number(20)


@pytest.mark.parametrize("early", [0, 50])
async def test_who_is_removed_while_a_table_is_verified_is_nobody_in_it(
    early: int, autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with village(4) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(5)
        hearer, position = them.of(0), them.registry.position
        status = signed(replace(them.of(3).own.signed(), log_position=position + early))
        workers = hearer.gossip._hearing._world.workers
        verify = workers.run

        async def slowly(*args: Any) -> Any:
            them.commit(RemoveNode(Member(node_at(3), incarnation_of(3)), "a test"))
            await trio.testing.wait_all_tasks_blocked()
            return await verify(*args)

        monkeypatch.setattr(workers, "run", slowly)
        assert await hearer.gossip.take_table([status], node_at(1)) == 0
        assert node_at(3) not in hearer.roster.arcs()


@pytest.mark.parametrize(("late_s", "believed"), [(0.0, 20), (11.0, 10)])
async def test_an_older_word_that_was_on_its_way_does_not_end_a_newer_claim(
    late_s: float, believed: int, autojump_clock: trio.testing.MockClock
) -> None:
    async with village(4, registered=3) as them:
        for index in range(3):
            await them.start(index)
        await trio.sleep(5)
        hearer, author = them.of(0), them.of(1)
        hearer.own.arc = None
        them.ether.lost = lambda _source, _target: True
        await trio.testing.wait_all_tasks_blocked()
        now, position = author.own.signed(), them.registry.position
        newer = replace(now, lamport=now.lamport + 20, left_fence=None, right_bound=Location.from_number(20), log_position=position + 1)
        older = replace(now, lamport=now.lamport + 10, left_fence=None, right_bound=Location.from_number(10))
        hearer.gossip._hearing.hear(PingBroadcast((signed(newer),), request_id=1), them.of(2).own.me)
        await trio.sleep(late_s)
        hearer.gossip._hearing.hear(PingBroadcast((signed(older),), request_id=1), author.own.me)
        them.register(3)
        await trio.testing.wait_all_tasks_blocked()
        assert hearer.roster.arcs()[author.own.me].last == Location.from_number(believed)


LOGGED = pytest.mark.expect_log(r"claims places that are ours($|, by position \d+ of the cluster's log, and nobody has shown us that)")


@pytest.mark.parametrize(
    ("early", "breaks_s", "signs"), [pytest.param(0, 5.0, 1, marks=LOGGED), pytest.param(1, 5.0, 0, marks=LOGGED), (0, 20.0, 0)]
)
async def test_a_sign_is_what_is_claimed_by_the_same_log_again_and_again(
    early: int, breaks_s: float, signs: int, autojump_clock: trio.testing.MockClock
) -> None:
    """What the log may explain that is not known here yet, or what stopped and came again, may be honest news."""
    async with village(3, registered=2) as them:
        await them.start(0)
        await them.start(1)
        await trio.sleep(5)
        hearer, author = them.of(0), them.of(1)
        them.ether.lost = lambda _source, _target: True
        now = author.own.signed()
        for number in range(1, 5):
            claim = replace(now, lamport=now.lamport + number, left_fence=None, right_bound=LAST, log_position=now.log_position + early)
            hearer.gossip._hearing.hear(PingBroadcast((signed(claim),)), author.own.me)
            await trio.sleep(breaks_s)
        assert hearer.gossip.dropped >= 4
        assert len(hearer.gossip.signs.documents(trio.current_time())) == signs
        if early:
            # The log is here, and says nothing for it: it takes its time from now on.
            them.register(2)
            await trio.testing.wait_all_tasks_blocked()
            claim = replace(claim, lamport=claim.lamport + 1)
            hearer.gossip._hearing.hear(PingBroadcast((signed(claim),)), author.own.me)
            assert not hearer.gossip.signs.documents(trio.current_time())
