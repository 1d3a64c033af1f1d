"""If this fails, one node that signs wrongly, or ever anew, has another one verify signatures and do little else."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
import trio.testing

from scenefold.peer.membership import hearing
from scenefold.peer.membership.claims import problem_of
from scenefold.peer.membership.hearing import STATUSES_BURST
from scenefold.wire import PingBroadcast
from unit.peer.village import node_at, village
from unit.peer.voices import Voice

EACH = 5


@pytest.mark.expect_log("a status of .* is dropped|statuses are dropped unread|a datagram is dropped")
async def test_a_sender_has_so_many_statuses_verified_and_others_are_heard(
    autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with village(3) as them:
        await them.start(0)
        looked_at = list[int]()
        monkeypatch.setattr(hearing, "problem_of", lambda status, key: looked_at.append(status.node) or problem_of(status, key))
        liar, honest = Voice(them, node_at(1)), Voice(them, node_at(2))
        true = them.of(2).own.signed()
        for number in range(STATUSES_BURST):
            forged = [replace(true, lamport=true.lamport + number * EACH + one + 1, signature=bytes(64)) for one in range(EACH)]
            await liar.say(PingBroadcast(tuple(forged)), node_at(0))
        assert STATUSES_BURST <= len(looked_at) <= STATUSES_BURST + 64, "and not five times as many"
        assert them.of(0).gossip.dropped >= STATUSES_BURST * EACH, "what is not looked at is counted, too"
        assert node_at(2) in them.of(0).roster.unheard()
        await honest.say(PingBroadcast((true,)), node_at(0))
        assert node_at(2) not in them.of(0).roster.unheard()


@pytest.mark.expect_log("statuses are dropped unread|somebody else has its key")
async def test_statuses_in_our_own_name_count_too(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        mine = them.of(0).own.signed()
        liar = Voice(them, node_at(1))
        for number in range(STATUSES_BURST):
            forged = [replace(mine, lamport=mine.lamport + number * EACH + one + 1, signature=bytes(64)) for one in range(EACH)]
            await liar.say(PingBroadcast(tuple(forged)), node_at(0))
        assert them.of(0).gossip.dropped >= STATUSES_BURST
