"""If this fails, loss or a cut removes the living, or the dead stay members for ever."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import trio

from scenefold.base.ids import NodeId, address_of
from scenefold.peer.membership import probing
from scenefold.peer.membership.probing import HELPERS, Verdict
from scenefold.peer.membership.suspicion import State
from scenefold.wire import Member, ProbeFor, RemoveNode
from unit.peer.village import Village, incarnation_of, node_at, until, village

REMOVE_AFTER_S = 120.0
LONG_S = 8 * REMOVE_AFTER_S
"""News of a node that come round about begin its silence anew, now and then."""


async def start_all(them: Village, count: int, *, probing_at: Callable[[int], bool] = lambda _index: True) -> None:
    for index in range(count):
        await them.start(index, probing=probing_at(index))
    with trio.fail_after(10.0):
        for node in them.nodes.values():
            await node.gossip.everybody_heard()


def removals(them: Village) -> list[NodeId]:
    return [removal.member.node for removal in them.registry.removed.values()]


def cut(*pairs: tuple[int, int]) -> Callable[[str, str], bool]:
    """Datagrams from the first to the second of each pair are lost."""
    lost = {(address_of(node_at(source)), address_of(node_at(target))) for source, target in pairs}
    return lambda source, target: (source, target) in lost


# ---------------------------------------------------------------------------------------------------- direct probes


async def test_a_living_node_answers_a_probe(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        await trio.sleep(1.0)
        with trio.fail_after(0.1):
            assert await them.of(0).gossip.probe(node_at(1))


async def test_a_probe_tries_three_times_within_two_seconds(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        tries = 0

        def lost(source: str, target: str) -> bool:
            nonlocal tries
            tries += (source, target) == ("127.0.0.2", "127.0.0.3")
            return True

        them.ether.lost = lost
        began = trio.current_time()
        assert not await them.of(0).gossip.probe(node_at(1))
        assert tries >= 3 and trio.current_time() - began == pytest.approx(2.0)


async def test_one_lost_datagram_fails_no_probe(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        them.ether.lose_first(2, "127.0.0.2", "127.0.0.3")
        assert await them.of(0).gossip.probe(node_at(1))


async def test_old_news_passed_on_by_others_are_no_answer(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await start_all(them, 2)
        them.ether.lost = lambda _source, _target: True
        late = them.of(1).own.signed()
        async with trio.open_nursery() as nursery:
            nursery.start_soon(them.of(0).gossip.take_table, [late], node_at(0))
            assert not await them.of(0).gossip.probe(node_at(1))


# -------------------------------------------------------------------------------------------------- indirect probes


async def test_two_others_are_asked_and_one_that_hears_is_enough(autojump_clock: trio.testing.MockClock) -> None:
    async with village(6) as them:
        await start_all(them, 6, probing_at=lambda index: index == 0)
        them.ether.lost = cut((5, 0), (5, 1), (5, 2), (5, 3))
        them.calls.clear()
        them.of(0).roster.note_refusal(node_at(5))
        await trio.sleep(10.0)
        asked = [target for source, target, packet in them.calls if isinstance(packet, ProbeFor) and source == node_at(0)]
        assert len(asked) >= HELPERS and len(set(asked[:HELPERS])) == HELPERS
        assert not {node_at(0), node_at(5)} & set(asked)


async def test_in_a_small_cluster_everybody_is_asked_in_the_end(autojump_clock: trio.testing.MockClock) -> None:
    async with village(8) as them:
        await start_all(them, 8, probing_at=lambda index: index == 0)
        # Only one hears it, and it is heard by the prober.
        them.ether.lost = cut(*((7, index) for index in range(6)))
        them.of(0).log.lapsed_nodes = [node_at(7)]
        await trio.sleep(3 * REMOVE_AFTER_S)
        assert removals(them) == []


# ------------------------------------------------------------------------------------------------------- who is removed


async def test_a_dead_node_is_removed_with_its_reason(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        them.crash(4)
        died_at = trio.current_time()
        them.of(0).log.lapsed_nodes = [node_at(4)]
        with trio.fail_after(REMOVE_AFTER_S + 30):
            await until(lambda: bool(removals(them)))
        assert removals(them) == [node_at(4)]
        assert trio.current_time() - died_at >= REMOVE_AFTER_S - 30, "it was last heard shortly before"
        reason = them.registry.removal(incarnation_of(4)).reason  # type: ignore[union-attr]
        assert "its owner lease lapsed" in reason or "1/20" in reason
        assert [proposer for proposer, _entry in them.proposals] == [node_at(0)], "the voter comes first, and that is enough"
        await trio.sleep(1.0)
        assert all(node.probing.suspicion.state(node_at(4)) is None for node in them.nodes.values())


async def test_without_the_voters_ear_the_others_find_out_as_well(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5, probing_at=lambda index: index != 0)
        them.crash(4)
        with trio.fail_after(2 * REMOVE_AFTER_S):
            await until(lambda: bool(removals(them)))
        assert removals(them) == [node_at(4)]


@pytest.mark.parametrize("both_ways", [False, True])
async def test_a_cut_between_two_removes_nobody(both_ways: bool, autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        them.ether.lost = cut((4, 0), *([(0, 4)] if both_ways else []))
        them.of(0).log.lapsed_nodes = [node_at(4)]
        await trio.sleep(LONG_S)
        assert removals(them) == [] and them.proposals == []


async def test_without_the_indirect_probe_a_cut_would_remove_the_living(
    autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def deaf(*_args: object) -> Verdict:
        return Verdict.NOT_HEARD

    monkeypatch.setattr(probing, "heard_by_others", deaf)
    async with village(5) as them:
        await start_all(them, 5)
        them.ether.lost = cut((4, 0), (0, 4))
        them.of(0).log.lapsed_nodes = [node_at(4)]
        with trio.fail_after(LONG_S):
            # So the test above does test the indirect probe.
            await until(lambda: removals(them) == [node_at(4)])


async def test_loss_alone_removes_nobody(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        dice = iter(range(10**9))
        them.ether.lost = lambda _source, _target: next(dice) % 7 == 0
        await trio.sleep(600.0)
        assert removals(them) == [] and them.proposals == []


async def test_a_slow_node_that_fails_requests_stays(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await start_all(them, 3)
        for _ in range(300):
            them.of(0).roster.note_refusal(node_at(2))
            await trio.sleep(1.0)
        assert removals(them) == [] and them.proposals == []


async def test_a_voter_that_is_cut_off_removes_nobody(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        alone = address_of(node_at(0))
        them.ether.lost = lambda source, target: alone in (source, target)
        them.reaches_voter = lambda node: node == node_at(0)
        them.of(0).log.lapsed_nodes = [node_at(index) for index in range(1, 5)]
        await trio.sleep(3 * REMOVE_AFTER_S)
        assert removals(them) == [], "it is more likely itself that is away"
        them.ether.lost, them.reaches_voter = lambda _source, _target: False, lambda _node: True
        them.of(0).log.lapsed_nodes = []
        with trio.fail_after(120.0):
            await until(lambda: len(them.of(0).roster.alive()) == 5)
        assert removals(them) == []


async def test_a_minority_without_the_voter_removes_nobody(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        minority = {address_of(node_at(index)) for index in (3, 4)}
        them.ether.lost = lambda source, target: (source in minority) != (target in minority)
        them.reaches_voter = lambda node: address_of(node) not in minority
        await trio.sleep(60.0)
        them.ether.lost = lambda _source, _target: False
        await trio.sleep(60.0)
        assert removals(them) == []


async def test_a_cut_off_minority_is_removed_by_the_others_only(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await start_all(them, 5)
        minority = {address_of(node_at(index)) for index in (3, 4)}
        them.ether.lost = lambda source, target: (source in minority) != (target in minority)
        them.reaches_voter = lambda node: address_of(node) not in minority
        them.of(0).log.lapsed_nodes = [node_at(3), node_at(4)]
        with trio.fail_after(2 * REMOVE_AFTER_S):
            await until(lambda: len(removals(them)) == 2)
        assert sorted(removals(them)) == [node_at(3), node_at(4)]


async def test_who_comes_back_in_time_stays(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4) as them:
        await start_all(them, 4)
        them.crash(3)
        them.of(0).log.lapsed_nodes = [node_at(3)]
        await trio.sleep(REMOVE_AFTER_S - 40)
        assert them.of(0).probing.suspicion.state(node_at(3)) in (State.SILENT, State.PROBING)
        them.of(0).log.lapsed_nodes = []
        await them.start(3, probing=True)
        await trio.sleep(REMOVE_AFTER_S)
        assert removals(them) == [] and them.proposals == []
        assert them.of(0).probing.suspicion.state(node_at(3)) is not State.SILENT


# -------------------------------------------------------------------------------------------------------------- the veto


async def test_the_voter_asks_for_itself_before_it_agrees(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await start_all(them, 3)
        member = Member(node_at(2), incarnation_of(2))
        objection = await them.of(0).probing.veto(member)
        assert objection is not None and "lived" in objection
        them.ether.lost = cut((2, 0))
        with trio.move_on_after(REMOVE_AFTER_S + 1):
            await trio.sleep_forever()
        them.ether.lost = lambda _source, _target: False
        objection = await them.of(0).probing.veto(member)
        assert objection is not None
        them.crash(2)
        await trio.sleep(REMOVE_AFTER_S + 1)
        assert await them.of(0).probing.veto(member) is None or removals(them) == [node_at(2)]


async def test_a_voter_is_never_removed(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await start_all(them, 3)
        objection = await them.of(0).probing.veto(Member(node_at(0), incarnation_of(0)))
        assert objection is not None and "voter" in objection
        them.crash(0)
        await trio.sleep(2 * REMOVE_AFTER_S)
        assert them.proposals == [] and all(node.probing.suspicion.state(node_at(0)) is None for node in them.nodes.values())


async def test_a_founder_that_never_came_keeps_its_seat_for_long(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3, registered=2) as them:
        for index in range(2):
            await them.start(index, probing=True)
        await trio.sleep(4 * REMOVE_AFTER_S)
        assert them.proposals == []
        with trio.fail_after(3 * REMOVE_AFTER_S):
            await until(lambda: not them.of(0).roster.is_peer(node_at(2)))
        assert next(entry.member for _node, entry in them.proposals if isinstance(entry, RemoveNode)) == Member(node_at(2), bytes(16))


async def test_a_founder_that_speaks_but_has_not_registered_keeps_its_seat(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3, registered=2) as them:
        for index in range(3):
            await them.start(index, probing=True)
        await trio.sleep(6 * REMOVE_AFTER_S)
        assert them.proposals == []
