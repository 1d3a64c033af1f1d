"""If this fails, nodes that start flood each other with questions, or wait for each other in vain."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.ids import address_of
from scenefold.peer.membership.knocking import KNOCK_FEW, KNOCK_OTHERS_S, KNOCK_S_MAX
from scenefold.wire import RequestState
from unit.peer.village import node_at, village
from unit.peer.voices import opened


async def test_nobody_waits_for_a_node_that_is_alone(autojump_clock: trio.testing.MockClock) -> None:
    async with village(1, seeds=("127.0.0.2",)) as them:
        await them.start(0)
        with trio.fail_after(1.0):
            await them.of(0).gossip.somebody_heard()
            await them.of(0).gossip.a_seed_heard()
            await them.of(0).gossip.everybody_heard()


async def test_knocking_at_many_doors_is_no_flood(autojump_clock: trio.testing.MockClock) -> None:
    async with village(200) as them:
        await them.start(0)
        await trio.sleep(60)
        knocks = sum(isinstance(opened(source, target, data), RequestState) for source, target, data in them.ether.sent)
        rounds = KNOCK_OTHERS_S / KNOCK_S_MAX + 8
        assert knocks <= (1 + KNOCK_FEW) * rounds * (1 + 60 / KNOCK_OTHERS_S), "a few at a time, others every ten seconds"
        asked = {target for source, target, data in them.ether.sent if isinstance(opened(source, target, data), RequestState)}
        assert len(asked) > 2 * KNOCK_FEW, "and not always the same ones, should they be dead"


async def test_a_whole_cluster_that_starts_asks_each_other_only_so_often(autojump_clock: trio.testing.MockClock) -> None:
    async with village(60, seeds=(address_of(node_at(0)), address_of(node_at(1)))) as them:
        for index in range(60):
            await them.start(index)
        await trio.sleep(4)
        packets = [opened(source, target, data) for source, target, data in them.ether.sent]
        asked = sum(isinstance(packet, RequestState) for packet in packets)
        # Nobody had a table: each node asks seeds, voter and a few others, and may be asked back by each.
        assert asked <= 60 * 4 * (KNOCK_FEW + 3), "nobody asks everybody"
        assert all(node.roster.unheard_count == 0 for node in them.nodes.values()), "each has told all of itself once"


async def test_a_newcomer_to_many_tells_of_itself_and_is_not_asked_by_all(autojump_clock: trio.testing.MockClock) -> None:
    async with village(40, registered=39) as them:
        for index in range(40):
            await them.start(index)
        # Not in the very moment of a round: a word that overtakes the log is lost, and asked for later.
        await trio.sleep(10.3)
        them.ether.sent.clear()
        them.register(39)
        await trio.sleep(2.5)
        asked = [target for source, target, data in them.ether.sent if isinstance(opened(source, target, data), RequestState)]
        assert asked.count(address_of(node_at(39))) <= 1, "it has spoken to everybody before anybody got impatient"
        await trio.sleep(1.0)
        assert not any(them.of(index).roster.unheard() for index in range(39))


async def test_a_newcomer_whose_word_was_lost_is_asked_in_the_end(autojump_clock: trio.testing.MockClock) -> None:
    async with village(40, registered=39) as them:
        for index in range(40):
            await them.start(index)
        await trio.sleep(10)
        them.ether.lost = lambda source, _target: source == address_of(node_at(39))
        them.register(39)
        await trio.sleep(2.5)
        them.ether.lost = lambda _source, _target: False
        await trio.sleep(5)
        assert not any(them.of(index).roster.unheard() for index in range(39))


async def test_the_few_that_are_lacking_in_the_end_are_asked_at_once(autojump_clock: trio.testing.MockClock) -> None:
    async with village(60) as them:
        await them.start(0)
        await trio.sleep(1)
        statuses = [them.of(index).own.signed() for index in range(1, 55)]
        for index in range(55, 60):
            await them.start(index)
        await them.of(0).gossip.take_table(statuses, node_at(1))
        await trio.sleep(0.2)
        assert them.of(0).roster.unheard_count == 0


async def test_a_table_is_taken_whole_and_nothing_false_in_it(autojump_clock: trio.testing.MockClock) -> None:
    async with village(40, registered=39) as them:
        await them.start(0)
        statuses = [them.of(index).own.signed() for index in range(1, 40)]
        statuses[7] = replace(statuses[7], lamport=0, boot=0)
        statuses[4] = replace(statuses[4], lamport=statuses[4].lamport + 9)
        them.ether.lost = lambda _source, _target: True
        with pytest.MonkeyPatch.context() as patch:
            said: list[str] = []
            patch.setattr(them.of(0).gossip._hearing, "drop", lambda _source, _kind, text, _quiet=None: said.append(text))
            assert await them.of(0).gossip.take_table(statuses, node_at(1)) == 36
        assert len(said) == 1 and address_of(node_at(5)) in said[0]
        assert set(them.of(0).roster.unheard()) == {node_at(5), node_at(8)} and them.of(0).roster.vacant_count == 1
        assert them.of(0).roster.proofs(node_at(1)) == 1 and them.of(0).roster.proofs(node_at(2)) == 0
