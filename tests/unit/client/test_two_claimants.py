"""If this fails, records that a living node owns cannot be reached, because somebody dead, hung or wrong claims their place, too."""

from __future__ import annotations

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.location import LAST, WHOLE_LINE, Arc
from scenefold.wire import GetMany, PutMany, QueryRange
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene

FIRST_NODE, MIDDLE, LAST_NODE = FakeNodes().addresses


async def fits(nodes: FakeNodes, claimant: str) -> None:
    """Everything can be written, read and listed although one node claims the whole line."""
    nodes.claims[claimant] = WHOLE_LINE
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    assert await space.get_many(PLACES) == [payload for _, payload in ITEMS]
    assert [location async for location in space.query()] == PLACES


@pytest.mark.parametrize("claimant", [FIRST_NODE, MIDDLE, LAST_NODE])
async def test_who_claims_everything_costs_a_round_trip(claimant: str, autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    with trio.fail_after(5):
        await fits(nodes, claimant)


@pytest.mark.parametrize(("giver", "receiver"), [(MIDDLE, LAST_NODE), (MIDDLE, FIRST_NODE)])
async def test_what_a_dead_giver_still_claims_is_read_and_written_at_its_receiver(
    giver: str, receiver: str, autojump_clock: MockClock
) -> None:
    nodes = FakeNodes()
    before = next(arc for owner, arc in nodes.table.arcs() if owner.address == giver)
    nodes.give_all(giver, receiver)
    nodes.claims[giver] = before
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.away.add(giver)
    mine = [place for place in PLACES if place in before]
    assert mine, "some records were moved"
    with trio.fail_after(5):
        assert all(payload is not None for payload in await space.get_many(mine))
        assert [location async for location in space.query(before.first, before.last)] == mine
        await space.put(mine[0], b"newer")
        assert await space.get(mine[0]) == b"newer"
    nodes.asked.clear()
    await space.get_many(mine)
    assert giver not in [address for address, packet in nodes.asked if isinstance(packet, GetMany)], "who did not answer is asked last"


async def test_who_hangs_is_not_waited_for_as_long_as_the_only_one(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    nodes.claims[FIRST_NODE] = WHOLE_LINE
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.hung.add(FIRST_NODE)
    theirs = [place for place in PLACES if nodes.table.owner_of(place).address == LAST_NODE]
    with trio.fail_after(8):
        assert all(payload is not None for payload in await space.get_many(theirs))
    nodes.hung.clear()


async def test_places_that_all_candidates_deny_are_asked_for_again_with_a_new_table(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.move_bounds()
    nodes.asked.clear()
    assert [location async for location in space.query(PLACES[0], LAST)] == PLACES
    questions = [packet for _, packet in nodes.asked if isinstance(packet, QueryRange | PutMany)]
    assert len(questions) <= 3 * len(nodes.addresses)


def test_the_fake_nodes_own_disjoint_arcs() -> None:
    arcs = [arc for _, arc in FakeNodes().table.arcs()]
    assert arcs[0].first == WHOLE_LINE.first and arcs[-1] == Arc(arcs[-1].first, LAST)
