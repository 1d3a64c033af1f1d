"""If one fails, a gap is adopted while somebody may still speak for a part of it, or nodes that come and go keep it open for ever."""

from __future__ import annotations

from random import Random

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.peer.line.ends import Side
from scenefold.peer.line.sightings import Sightings
from scenefold.peer.timing import T_WAIT_S
from scenefold.world.sim import run_simulated
from unit.peer.line.bent import bend
from unit.peer.line.line_model import Model
from unit.peer.line.line_nodes import CELLS, Node, arc_of_cells, cells_of
from unit.peer.line.street import Street
from unit.peer.line.test_line_model import NEWCOMERS, OPERATIONS, WEIGHTS, step
from unit.peer.logs_made import add, remove

# ------------------------------------------------------------------------------------------------------------------ pure

LEFT_END, RIGHT_BEGIN = 7, 12
gaps = st.one_of(
    st.integers(0, LEFT_END).map(lambda first: arc_of_cells(first, LEFT_END)),
    st.just(arc_of_cells(RIGHT_BEGIN, CELLS - 1)),
)


@given(st.lists(st.tuples(gaps, st.integers(0, 1), st.integers(0, 20)), max_size=60))
def test_what_is_old_was_seen_by_every_look_since(steps: list[tuple[Arc, int, int]]) -> None:
    """Each look may be at another gap, after another pause, and with a holding that has changed."""
    sightings, now, revision = Sightings(), 0.0, 0
    looks: list[tuple[set[int], float]] = []
    for gap, change, pause in steps:
        revision, now = revision + change, now + pause
        looks = [] if change else looks
        cells = set(cells_of(gap))
        looks.append((cells, now))
        seen = sightings.see(gap, revision, now)
        common = set(cells_of(seen.gap))
        assert common and common <= cells and seen.revision == revision
        same_side = [(found, at) for found, at in looks if found & cells]
        assert (seen.moment, common) == (same_side[0][1], set.intersection(*(found for found, _ in same_side)))
        assert len(sightings._known) <= 2


# --------------------------------------------------------------------------------------------------------------- stories


def leased_once(model: Model) -> None:
    owners: dict[int, Node] = {}
    for node in (node for node in model.nodes.values() if node.leased):
        for cell in cells_of(node.holding.arc):
            assert cell not in owners, f"two nodes may speak for cell {cell}"
            owners[cell] = node


def look(model: Model, node: Node, which: int) -> None:
    """A whole look of a node, with all its questions."""
    node.search = None
    for _ in range(2 * len(model.head.order) + 2):
        for other in model.registered():
            model.learn(other, node.position)
            model.grant(other)
        model.seek(node, which)
        while model.messages and model.messages[-1].kind in ("bound", "bound?", "behind"):
            model.deliver(-1, keep=False)
        if node.search is None:
            return


def all_look(model: Model) -> None:
    for node in model.registered():
        model.learn(node, model.head.position)
        model.grant(node)
    for node in model.registered():
        for which in range(len(Side)):
            look(model, node, which)
    leased_once(model)


def three() -> tuple[Model, Node, Node, Node]:
    model = Model(3)
    for node in model.registered():
        model.grant(node)
    first, second, third = model.registered()
    return model, first, second, third


def a_gap_that_grew_by_what_another_one_owned() -> Model:
    """The gap of one dead node was seen long ago; then its left neighbour is removed, too, and may not know it yet."""
    model, first, second, _ = three()
    model.join(NodeId(5), 0)
    model._remove(second.member)
    all_look(model)
    model.end_leases()
    model._remove(first.member)
    assert first.leased
    all_look(model)
    return model


def a_gap_that_was_adopted_and_given_on() -> Model:
    """Its new owner is removed, and may not know it yet: the same gap again, with other leases to wait for."""
    model, _, second, third = three()
    model._remove(second.member)
    all_look(model)
    model.end_leases()
    all_look(model)
    gap = cells_of(second.holding.arc)
    assert third.holding.arc is not None and cells_of(third.holding.arc)[0] == gap[0]
    model.join(NodeId(25), 1)
    newcomer = model.registered()[1]
    model.learn(third, model.head.position)
    model.grant(third)
    assert model.pass_on(third, Side.LEFT, len(gap) - 1)
    for _ in range(4):
        model.prod(third, Side.LEFT)
        while model.messages:
            model.deliver(0, keep=False)
        model.delete(third, Side.LEFT)
    assert cells_of(newcomer.holding.arc) == gap and not third.holding.handovers
    model._remove(newcomer.member)
    assert newcomer.leased
    all_look(model)
    return model


def test_only_what_was_seen_is_adopted_when_the_gap_has_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    assert a_gap_that_grew_by_what_another_one_owned().counts["adopted as seen"] == 1
    bend(monkeypatch, Sightings, "see", "Sighting(common, revision, known.moment)", "Sighting(gap, revision, known.moment)")
    with pytest.raises(AssertionError, match="two nodes may speak"):
        a_gap_that_grew_by_what_another_one_owned()


def test_what_was_seen_under_another_holding_counts_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "adopted as seen" not in a_gap_that_was_adopted_and_given_on().counts
    bend(monkeypatch, Sightings, "see", "if known.revision == revision", "if known.revision <= revision")
    with pytest.raises(AssertionError, match="two nodes may speak"):
        a_gap_that_was_adopted_and_given_on()


def test_random_lives_with_nodes_that_come_and_go_leave_one_voice_for_each_place() -> None:
    adopted = 0
    for seed in range(60):
        random = Random(seed)
        model = Model(random.randrange(3, 5))
        for _ in range(6):
            for _ in range(random.randrange(20)):
                step(model, random, WEIGHTS)
                leased_once(model)
            model.remove(random.randrange(256))
            all_look(model)
            model.end_leases()
            for _ in range(random.randrange(8)):
                step(model, random, WEIGHTS)
                leased_once(model)
            if model.join(random.choice(NEWCOMERS), random.randrange(8)):
                model.grant(model.nodes[model.head.members[model.head.order[-1]]])
            model.remove(random.randrange(256))
            all_look(model)
            model.check()
        adopted += model.counts.get("adopted as seen", 0)
    assert len(OPERATIONS) == len(WEIGHTS) and adopted >= 10


# ------------------------------------------------------------------------------------------------------------- the shell


@pytest.mark.expect_log("had no owner any more|the connection was cut")
def test_a_node_that_comes_and_goes_without_end_does_not_keep_a_gap_open() -> None:
    async def main() -> float:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            await trio.sleep(30.0)
            street.houses[1].stays_down = True
            street.houses[1].crash()
            street.remove(1)
            removed_at, life = street.net.now, 0
            while street.houses[2].durable().arc.length + street.houses[0].durable().arc.length < WHOLE_LINE.length:
                assert street.net.now - removed_at < 4 * T_WAIT_S, "the gap is still there"
                street.log.say(add(9, left_of=0, life=life))
                await trio.sleep(1.0)
                street.log.say(remove(9, life))
                await trio.sleep(4.0)
                life += 1
            nursery.cancel_scope.cancel()
            return street.net.now - removed_at

    assert run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0) > T_WAIT_S
