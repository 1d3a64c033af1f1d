"""If this fails, nodes overfill each other, pass records to and fro, or stay unequally full."""

from __future__ import annotations

import random
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.peer.balance.policy import BYTES_MIN, FILL_MAX, FLOW_TOLERANCE, Give, NodeFill, fair_shares, flow, gives, imbalance
from scenefold.peer.line.ends import Side
from unit.peer.balance.crowd import Crowd, needed

MIB = 1 << 20
CAPACITIES = st.integers(1, 1 << 44)
FILLS = st.builds(
    lambda capacity, part, is_open: NodeFill(int(capacity * part), capacity, is_open), CAPACITIES, st.floats(0, 1), st.booleans()
)
LINES = st.lists(FILLS, min_size=1, max_size=12)


def even(*used: int, capacity: int = 1000 * MIB) -> list[NodeFill]:
    return [NodeFill(size * MIB, capacity) for size in used]


def test_two_nodes_meet_in_the_middle_as_algorithm_5_says() -> None:
    assert gives(even(40, 0), 0) == [Give(Side.RIGHT, 20 * MIB)]
    assert gives(even(40, 0), 1) == []
    assert gives([NodeFill(40 * MIB, 300 * MIB), NodeFill(0, 100 * MIB)], 0) == [Give(Side.RIGHT, 10 * MIB)]


def test_a_chain_loaded_at_one_end_passes_on_what_the_far_ones_lack() -> None:
    line = even(40, 0, 0, 0)
    assert [flow(line, bound) / MIB for bound in range(3)] == [30, 20, 10]
    assert gives(line, 0) == [Give(Side.RIGHT, 30 * MIB)]
    assert gives(even(10, 30, 0, 0), 1) == [Give(Side.RIGHT, 20 * MIB)]


def test_what_goes_to_both_sides_is_not_given_twice() -> None:
    assert gives(even(0, 90, 0), 1) == [Give(Side.LEFT, 30 * MIB), Give(Side.RIGHT, 30 * MIB)] or gives(even(0, 90, 0), 1) == [
        Give(Side.RIGHT, 30 * MIB),
        Give(Side.LEFT, 30 * MIB),
    ]


def test_a_neighbour_that_takes_nothing_cuts_the_line() -> None:
    line = [*even(40, 0), NodeFill(0, 1000 * MIB, open=False), *even(0)]
    assert gives(line, 0) == [Give(Side.RIGHT, 20 * MIB)]
    assert gives(line, 3) == []
    assert gives([NodeFill(40 * MIB, 1000 * MIB), NodeFill(0, 0, open=False)], 0) == []


@pytest.mark.parametrize("used", [1, 40])
def test_a_node_whose_disk_others_have_filled_gives_and_is_given_nothing(used: int) -> None:
    """It can take no more than it has, so what it has is its capacity."""
    full = NodeFill(used * MIB, used * MIB)
    line = [*even(40), full, *even(40)]
    assert sum(give.bytes for give in gives(line, 1)) > 0.9 * (full.used - BYTES_MIN)
    assert gives(line, 0) == gives(line, 2) == []


def test_nobody_is_filled_to_the_brim() -> None:
    line = [NodeFill(99 * MIB, 100 * MIB), NodeFill(85 * MIB, 100 * MIB), NodeFill(0, 1 << 40)]
    assert gives(line, 0) == [Give(Side.RIGHT, 5 * MIB)]


@pytest.mark.parametrize("line", [even(0), even(0, 0), even(10, 10), even(100, 101), [NodeFill(1, 1), NodeFill(1, 1)], [NodeFill(0, 0)]])
def test_equally_full_nodes_leave_their_bounds_alone(line: list[NodeFill]) -> None:
    assert all(gives(line, me) == [] for me in range(len(line)))


def test_doubt_is_taken_off() -> None:
    line = even(40, 0, 0, 0)
    assert gives(line, 0, [0, 0, 0, 0]) == [Give(Side.RIGHT, 30 * MIB)]
    assert gives(line, 0, [0, 0, 16 * MIB, -16 * MIB]) == [Give(Side.RIGHT, 30 * MIB)], "what belongs together cancels"
    assert gives(line, 0, [0, 0, 16 * MIB, 0]) == [Give(Side.RIGHT, 26 * MIB)], "by the left side's part of all shares"
    assert gives(line, 0, [0, 0, 200 * MIB, 0]) == []


@given(LINES, st.data())
def test_whatever_is_believed_a_give_is_possible(line: list[NodeFill], data: st.DataObject) -> None:
    me = data.draw(st.integers(0, len(line) - 1))
    found = gives(line, me)
    assert len({give.side for give in found}) == len(found)
    assert sum(give.bytes for give in found) <= line[me].used - BYTES_MIN or not found
    for give in found:
        target = line[me + (1 if give.side is Side.RIGHT else -1)]
        assert give.bytes >= BYTES_MIN and target.open
        assert target.used + give.bytes <= target.capacity * FILL_MAX


@given(LINES.map(lambda line: [NodeFill(fill.used, fill.capacity) for fill in line]))
def test_no_two_neighbours_give_to_each_other_and_no_flow_is_exceeded(line: list[NodeFill]) -> None:
    shares = fair_shares(line)
    flows = list(accumulate(fill.used - share for fill, share in zip(line, shares, strict=True)))
    for me in range(len(line)):
        for give in gives(line, me):
            bound = me if give.side is Side.RIGHT else me - 1
            assert give.bytes <= abs(flows[bound]) + 1
            assert (flows[bound] > 0) == (give.side is Side.RIGHT)


@given(LINES.map(lambda line: [NodeFill(fill.used, fill.capacity) for fill in line]))
def test_where_nobody_gives_though_there_is_room_all_is_balanced(line: list[NodeFill]) -> None:
    shares = fair_shares(line)
    roomy = all(fill.used + BYTES_MIN < fill.capacity * FILL_MAX and fill.used > 2 * BYTES_MIN for fill in line)
    if roomy and not any(gives(line, me) for me in range(len(line))):
        for fill, share in zip(line, shares, strict=True):
            assert abs(fill.used - share) <= 2 * max(BYTES_MIN, FLOW_TOLERANCE * share) + 2


def loaded(nodes: int, seed: int, *, where: int | None = None) -> tuple[list[int], list[int]]:
    dice = random.Random(seed)
    capacity = [dice.randrange(1, 8) * 1000 * MIB for _ in range(nodes)]
    place = (0 if seed % 2 else nodes - 1) if where is None else where
    used = [0] * nodes
    used[place] = int(min(capacity[place] * 0.9, sum(capacity) * 0.5))
    return used, capacity


def settle(crowd: Crowd, seconds: int) -> None:
    while crowd.imbalance() >= 0.05:
        assert crowd.now < seconds, f"{crowd.imbalance():.3f} after {crowd.now} s"
        crowd.step()


@pytest.mark.parametrize(("nodes", "seed"), [(2, 0), (2, 1), (3, 2), (5, 3), (8, 4), (13, 5), (20, 6), (34, 7)])
def test_with_fresh_news_every_byte_crosses_a_bound_once_and_each_bound_is_moved_a_few_times(nodes: int, seed: int) -> None:
    used, capacity = loaded(nodes, seed)
    crowd = Crowd(used, capacity, seed=seed)
    settle(crowd, 40 + 25 * nodes)
    assert crowd.moved <= 1.001 * sum(needed(used, capacity))
    assert crowd.handovers <= 4 * nodes
    quiet = crowd.handovers
    for _ in range(30):
        crowd.step()
    assert crowd.handovers - quiet <= nodes


@pytest.mark.parametrize("news", [(0.5, 0, 0.0), (0.3, 3, 0.0), (0.1, 0, 0.02), (0.1, 10, 0.1)])
@pytest.mark.parametrize(("nodes", "seed"), [(2, 0), (3, 1), (5, 2), (8, 3)])
def test_old_news_delay_but_do_not_send_records_to_and_fro(nodes: int, seed: int, news: tuple[float, int, float]) -> None:
    used, capacity = loaded(nodes, seed)
    crowd = Crowd(used, capacity, news=news[0], age=news[1], loss=news[2], seed=seed)
    settle(crowd, 200 + 80 * nodes)
    assert crowd.moved <= 1.7 * sum(needed(used, capacity))
    before = crowd.moved
    for _ in range(300):
        crowd.step()
        assert crowd.imbalance() < 0.3, "what passes through a small node shows there for a while"
    assert crowd.imbalance() < 0.05
    assert crowd.moved - before <= 0.1 * sum(used)


@pytest.mark.slow
def test_fifty_nodes_with_the_news_that_gossip_brings() -> None:
    used, capacity = loaded(50, 3)
    crowd = Crowd(used, capacity, news=1 / 50, age=10, loss=0.02, seed=3)
    settle(crowd, 800)
    assert crowd.moved <= 1.5 * sum(needed(used, capacity))


def test_balance_follows_those_who_write() -> None:
    crowd = Crowd([0] * 6, [1000 * MIB] * 6, news=0.3, age=3)
    for _ in range(600):
        crowd.write(0, MIB)
        crowd.step()
    settle(crowd, 900)
    assert crowd.moved <= 1.5 * sum(needed([600 * MIB, 0, 0, 0, 0, 0], [1000 * MIB] * 6))


def test_imbalance() -> None:
    assert imbalance(even(10, 10)) == imbalance(even(0, 0)) == 0
    assert imbalance(even(11, 9)) == pytest.approx(0.1)
