"""If this fails, nodes that hold the whole scene get more paths than they can trace, wait for one another, or paths are dealt twice or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.render.ledger import Counts
from scenefold.render.passes import PassPlan
from scenefold.render.pool.dealing import PART_RAYS_MIN, PROBE_RAYS, Dealer
from scenefold.render.pool.own_passes import pass_owner
from scenefold.render.pool.pace import Pace
from scenefold.render.pool.still_open import StillOpen

PASS = 65_536
PLAN = PassPlan(5, 64 * PASS)


def done(rays: int) -> Counts:
    """Of a node that was dealt so many: each made two more."""
    return Counts(created=2 * rays, retired=3 * rays, received=rays)


def own(rays: int, dealt: int) -> Counts:
    """Of the owner of a pass that has done its part."""
    return Counts(created=rays, retired=rays - dealt, sent=dealt)


def alone(nodes: int) -> list[range]:
    """Pools of one node each."""
    return [range(node, node + 1) for node in range(nodes)]


def dealer(nodes: int, me: int = 0) -> Dealer:
    """Of nodes that are pools of their own, and have no passes of their own, but for this one."""
    return Dealer(PLAN, alone(nodes), me, range(PLAN.count), 0.0)


def report(dealer: Dealer, number: int, shares: list[int], node: int, now: float) -> None:
    """A node, 0 being the owner, has done its part."""
    dealer.reported(number, node, done(shares[node]) if node else own(sum(shares), sum(shares[1:])), now)


def owned(nodes: int) -> list[list[int]]:
    """The plan's passes, by owner."""
    return [[number for number in range(PLAN.count) if pass_owner(PLAN, number, nodes) == node] for node in range(nodes)]


def test_who_has_passes_of_its_own_gets_no_part_of_others() -> None:
    dealer = Dealer(PLAN, alone(3), 0, (), 0.0)
    dealer.release(PLAN.count, 0.0)
    assert dealer.deal(owned(3)[0][0], PASS, 0.0) == [PASS, 0, 0]
    assert dealer.helpers(owned(3)[0][0]) == frozenset()


def test_who_has_none_left_helps() -> None:
    passes, dealer = owned(3), Dealer(PLAN, alone(3), 0, (), 0.0)
    dealer.release(PLAN.count, 0.0)
    for at, number in enumerate(passes[2], 1):
        dealer.ended(2, number, float(at))
    for at, number in enumerate(passes[1][:-1], 1):
        dealer.ended(1, number, float(at))
    now = len(passes[1]) - 0.5
    # As far as is known all are as quick; node 1 will be done in 0.5 s, and a part has 0.1 s of way.
    at_first = dealer.deal(passes[0][0], PASS, now)
    assert at_first[0] > at_first[2] > 20_000 and at_first[1] < at_first[2]
    dealer.ended(1, passes[1][-1], now + 0.5)
    report(dealer, passes[0][0], at_first, 0, now + 0.55)
    dealer.closed(passes[0][0], now + 0.6)
    later = dealer.deal(passes[0][1], PASS, now + 0.6)
    assert sum(later) == PASS and later[0] > later[1] > at_first[1] and later[1] > 15_000
    assert dealer.helpers(passes[0][1]) == {1, 2}


def test_what_is_released_later_counts_later_and_what_was_done_before_never() -> None:
    passes = owned(2)
    still = StillOpen(PLAN, 2, passes[0][:2])
    still.skip(4)
    missing = [PASS * sum(1 for number in some if number >= 4 and number not in passes[0][:2]) for some in passes]
    early = [number for number in passes[1] if number >= 4][-1]
    assert still.close(early) == 0, "it was not among what may be open"
    first, second = still.release(10), still.release(PLAN.count)
    assert [a + b for a, b in zip(first, second, strict=True)] == [missing[0], missing[1] - PASS]
    assert still.release(10) == [0, 0]
    last = [number for number in passes[0] if number >= 10][-1]
    assert still.close(last) == PASS and still.close(last) == 0


def test_of_nobody_known_all_get_alike_but_for_the_way() -> None:
    shares = dealer(5).deal(0, PASS, 0.0)
    assert sum(shares) == PASS and max(shares[1:]) - min(shares[1:]) <= 1
    assert abs(shares[0] - shares[1] - 10_000) <= 1
    assert dealer(3).deal(0, 2, 0.0) == [2, 0, 0]
    assert dealer(2).deal(0, 0, 0.0) == [0, 0]


@given(
    paces=st.lists(st.floats(1.0, 1e7), min_size=1, max_size=16),
    rays=st.lists(st.integers(0, PASS), min_size=1, max_size=8),
    open_passes=st.booleans(),
)
def test_every_ray_is_dealt_once(paces: list[float], rays: list[int], open_passes: bool) -> None:
    dealer, now = Dealer(PLAN, alone(len(paces)), 0, () if open_passes else range(PLAN.count), 0.0), 0.0
    dealer.release(PLAN.count, 0.0)
    for number, count in enumerate(rays):
        shares = dealer.deal(number, count, now)
        assert sum(shares) == count and min(shares) >= 0
        assert dealer.helpers(number) == {node for node, share in enumerate(shares) if node and share}
        for node, share in enumerate(shares):
            if node != number % len(paces):
                report(dealer, number, shares, node, now + share / paces[node])
        now += 0.1


def test_ranges_follow_one_another() -> None:
    rays = np.arange(PASS * 8, dtype=np.uint32).reshape(-1, 8)
    mine, others = dealer(4).dealt(0, {0: rays}, 0.0)
    assert sorted(others) == [1, 2, 3]
    assert (np.concatenate([mine[0], *(others[node] for node in sorted(others))]) == rays).all()


def test_who_is_slow_gets_what_it_can_trace() -> None:
    cards, paces = dealer(4), [100_000.0, 100_000.0, 100_000.0, 10_000.0]
    now = 0.0
    for number in range(8):
        shares = cards.deal(number, PASS, now)
        ends = [now + share / paces[node] for node, share in enumerate(shares)]
        for node in range(4):
            report(cards, number, shares, node, ends[node])
        now = max(ends)
        cards.closed(number, now)
    # All are done at the same moment, the way there and back included.
    assert abs(shares[1] - shares[2]) <= 1 and abs(shares[0] - shares[1] - 10_000) < 1_500
    assert abs(shares[3] - (shares[1] / 10)) < 300


def test_a_slow_owner_gives_most_of_it_away() -> None:
    cards = dealer(5)
    shares = cards.deal(0, PASS, 0.0)
    for node in range(1, 5):
        report(cards, 0, shares, node, 0.1 + shares[node] / 500_000)
    report(cards, 0, shares, 0, 0.1 + shares[0] / 20_000)
    cards.closed(0, 2.0)
    shares = cards.deal(1, PASS, 2.0)
    assert shares[0] < PASS / 10 and min(shares[1:]) > PASS / 5


def test_who_has_not_answered_is_presumed_to_be_as_fast_as_the_others_for_as_long_as_it_may_be() -> None:
    cards = dealer(3)
    first = cards.deal(0, 60_000, 0.0)
    for node in (0, 1):
        report(cards, 0, first, node, 0.2)
    assert cards.deal(1, 60_000, 0.2)[2] > 10_000
    for node in (0, 1):
        cards.reported(1, node, done(60_000) if node else own(60_000, 0), 0.4)
    # Seconds later it has shown that it is not.
    late = cards.deal(2, 60_000, 3.0)
    assert late[2] == 0 and min(late[:2]) > 10_000


def test_who_was_very_slow_and_has_nothing_to_do_is_tried_again() -> None:
    cards = dealer(2)
    first = cards.deal(0, 60_000, 0.0)
    assert first[1] > 10_000
    report(cards, 0, first, 0, 0.3)
    assert cards.deal(1, 60_000, 5_000.0)[1] == 0
    # It still had its part then; now it has not.
    report(cards, 0, first, 1, 5_000.0)
    cards.closed(0, 5_000.0)
    cards.closed(1, 5_000.0)
    shares = cards.deal(2, 60_000, 5_000.0)
    assert shares == [60_000 - PROBE_RAYS, PROBE_RAYS]
    report(cards, 2, shares, 1, 5_000.0002)
    report(cards, 2, shares, 0, 5_000.3)
    assert cards.deal(3, 60_000, 5_000.3)[1] > PART_RAYS_MIN


@pytest.mark.parametrize("pace", [100_000, 300_000, 500_000])
@pytest.mark.parametrize("way_s", [0.002, 0.02, 0.06])
def test_who_was_slow_once_is_not_slow_for_ever(pace: int, way_s: float) -> None:
    """What a few rays take is the way there and back, which says nothing of a pace."""
    cards, untried, now = dealer(2), dealer(2), 0.0

    def render(some: Dealer, number: int, slower: int) -> list[int]:
        shares = some.deal(number, PASS, now)
        report(some, number, shares, 0, now + shares[0] / pace)
        if shares[1]:
            report(some, number, shares, 1, now + way_s + slower * shares[1] / pace)
        some.closed(number, now + 0.7)
        return shares

    for number in range(3):
        render(cards, number, 1_000 if number < 2 else 1)
        now += 1_000.0
    for number in range(3, 40):
        again, never = render(cards, number, 1), render(untried, number, 1)
        now += 1.0
    assert again[1] >= never[1] / 2 or never[1] < 2 * PART_RAYS_MIN


def test_few_rays_say_little_of_a_pace() -> None:
    """Where an image needs no more samples: what a part takes is the way there and back."""
    pace = Pace()
    assert pace.value is None
    pace.add(PASS, 0.65)
    before = pace.value
    for _ in range(15):
        pace.add(12, 0.06)
    assert before is not None and pace.value is not None and abs(pace.value - before) < before / 20
    # But many that take long do, and few that take none.
    pace.add(PASS, 2.0)
    slower = pace.value
    assert slower < before / 1.5
    pace.add(100, 0.0)
    assert pace.value > slower


def test_two_parts_that_are_done_together_are_no_burst() -> None:
    pace = Pace()
    for _ in range(20):
        pace.add(PASS, 1.0)
        pace.add(PASS, 0.0)
        assert pace.value is not None and PASS <= pace.value < 3.1 * PASS


def test_who_stalls_gets_less_soon() -> None:
    cards = dealer(2)
    for number in range(3):
        shares = cards.deal(number, 60_000, float(number))
        for node in (0, 1):
            report(cards, number, shares, node, number + 0.3)
        cards.closed(number, number + 0.3)
    usual = cards.deal(3, 60_000, 3.0)
    assert usual[1] > 10_000
    report(cards, 3, usual, 0, 3.3)
    fewer = cards.deal(4, 60_000, 5.0)
    assert fewer[1] == 0
    # And its usual part again once it is done with all that it had.
    report(cards, 3, usual, 1, 5.1)
    report(cards, 4, fewer, 0, 5.3)
    assert cards.deal(5, 60_000, 5.4)[1] > PART_RAYS_MIN


def test_a_part_is_done_only_once_all_of_it_is() -> None:
    cards, control = dealer(2), dealer(2)
    shares = cards.deal(0, 60_000, 0.0)
    assert shares == control.deal(0, 60_000, 0.0)
    part = shares[1]
    cards.reported(0, 1, Counts(created=5, retired=5, received=0), 0.01)
    cards.reported(0, 1, Counts(created=5, retired=part - 1, received=part), 0.01)
    cards.reported(0, 1, Counts(created=5, retired=part + 4, received=part), 0.01)
    # Half of it came, in a frame of its own, and all of that is traced.
    cards.reported(0, 1, Counts(created=part, retired=part + part // 2, received=part // 2), 0.01)
    # The owner has its own rays, and those that it sent, among what it created.
    cards.reported(0, 0, Counts(created=60_000, retired=shares[0] - 1, sent=part), 0.01)
    # Nothing of this was a measurement.
    assert cards.deal(1, 60_000, 0.02) == control.deal(1, 60_000, 0.02)
    cards.reported(0, 1, Counts(created=5, retired=part + 5, received=part), 0.1)
    assert cards.deal(2, 60_000, 0.12) != control.deal(2, 60_000, 0.12)
    before = cards.deal(3, 60_000, 0.2)
    report(cards, 0, shares, 0, 0.2)
    assert cards.deal(4, 60_000, 0.2) != before


def test_what_is_closed_is_nobodys_part() -> None:
    cards = dealer(2)
    shares = cards.deal(0, 60_000, 0.0)
    report(cards, 0, shares, 0, 0.3)
    cards.closed(0, 0.3)
    assert cards.helpers(0) == frozenset()
    assert cards.deal(1, 60_000, 60.0)[1] > 10_000


def test_who_closes_nothing_for_long_is_not_expected_soon() -> None:
    passes, cards = owned(2), Dealer(PLAN, alone(2), 0, (), 0.0)
    cards.release(PLAN.count, 0.0)
    for at, number in enumerate(passes[1][:-1], 1):
        cards.ended(1, number, float(at))
    began = len(passes[1]) - 1.0
    shares = cards.deal(passes[0][0], PASS, began + 1.0)
    assert shares[1] > 20_000, "it will be done any moment"
    report(cards, passes[0][0], shares, 0, began + 1.5)
    cards.closed(passes[0][0], began + 1.5)
    assert cards.deal(passes[0][1], PASS, began + 9.0)[1] == 0


# Pools of several nodes --------------------------------------------------------------------------------------

POOLS = [range(3), range(3, 5)]


def pooled(me: int = 1) -> Dealer:
    """Of two pools that have no passes of their own, but for this one's."""
    return Dealer(PLAN, POOLS, me, range(PLAN.count), 0.0)


def numbered(*counts: int) -> dict[int, np.ndarray]:
    """Rays by the cell that they begin in, each with a number of its own."""
    ends = np.cumsum(counts)
    return {cell: np.arange(end - count, end, dtype=np.uint32)[:, None] for cell, (end, count) in enumerate(zip(ends, counts, strict=True))}


def test_what_stays_is_divided_as_it_was_and_what_goes_goes_to_one_node_of_a_pool() -> None:
    rays = numbered(30_000, 20_000, 15_536)
    stay, away = pooled().dealt(7, rays, 0.0)
    assert list(away) == [4], "pass 7 goes to the second of two"
    for cell, some in stay.items():
        assert (some == rays[cell][: len(some)]).all()
    everything = np.concatenate([*(stay[cell] for cell in sorted(stay)), away[4]])
    assert (everything == np.concatenate([rays[cell] for cell in sorted(rays)])).all()
    assert 10_000 < len(away[4]) < PASS - 10_000


@given(counts=st.lists(st.integers(0, 30_000), min_size=1, max_size=6), me=st.integers(0, 4), number=st.integers(0, 60))
def test_every_ray_of_a_pool_is_dealt_once(counts: list[int], me: int, number: int) -> None:
    rays = numbered(*counts)
    if not sum(counts):
        return
    cards = pooled(me)
    stay, away = cards.dealt(number, rays, 0.0)
    assert set(away) <= cards.helpers(number) and cards.helpers(number).isdisjoint(POOLS[0 if me < 3 else 1])
    found = np.concatenate([*stay.values(), *away.values()])[:, 0]
    assert sorted(found.tolist()) == list(range(sum(counts)))
    for cell, some in stay.items():
        assert set(some[:, 0].tolist()) <= set(rays[cell][:, 0].tolist())


def test_all_nodes_of_a_pool_that_was_dealt_a_part_may_have_some_of_it() -> None:
    cards = pooled(0)
    cards.dealt(2, numbered(PASS), 0.0)
    assert cards.helpers(2) == {3, 4}


def test_a_part_is_done_once_the_pool_has_done_it_and_no_node_alone() -> None:
    cards, control = pooled(0), pooled(0)
    part = len(cards.dealt(0, numbered(PASS), 0.0)[1][3])
    control.dealt(0, numbered(PASS), 0.0)
    # Node 3 got all, kept half of them, and passed the others on; what it says looks as if all of it were done.
    cards.reported(0, 3, Counts(created=5, retired=part // 2 + 5, sent=part - part // 2, received=part), 0.2)
    assert cards.deal(1, PASS, 0.3) == control.deal(1, PASS, 0.3)
    # Node 4 has those, and sent one back.
    cards.reported(0, 4, Counts(created=3, retired=part - part // 2 + 2, sent=1, received=part - part // 2), 0.25)
    assert cards.deal(2, PASS, 0.3) == control.deal(2, PASS, 0.3)
    cards.reported(0, 3, Counts(created=5, retired=part // 2 + 6, sent=part - part // 2, received=part + 1), 0.3)
    assert cards.deal(3, PASS, 0.31) != control.deal(3, PASS, 0.31)


def test_a_pool_is_busy_with_the_passes_of_all_of_its_nodes() -> None:
    cards, passes = Dealer(PLAN, POOLS, 0, (), 0.0), owned(5)
    cards.release(PLAN.count, 0.0)
    for at, number in enumerate(passes[3], 1):
        cards.ended(3, number, float(at))
    assert cards.deal(passes[0][0], PASS, float(len(passes[3]))) == [PASS, 0], "node 4 has passes, which node 3 works for, too"
    for at, number in enumerate(passes[4], len(passes[3]) + 1):
        cards.ended(4, number, float(at))
    assert cards.deal(passes[0][1], PASS, float(len(passes[3] + passes[4])))[1] > 10_000
