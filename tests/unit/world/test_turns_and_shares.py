"""If this fails, a peer's share of a node's time says nothing about when its requests begin, or what is urgent waits for bulk."""

from __future__ import annotations

import pytest

from scenefold.world.shares import LOOK_S, OWED_ALONE_S_MAX, SAVED_S_MAX, URGENT_SAVED_S_MAX, USED_UP_S, Kind, Shares
from scenefold.world.turns import BESIDE_S, TURN_S, Guest, Turns

ME, URGENT, OTHER = ("user:me", 0), ("user:me", 1), ("user:other", 0)
"""The second: the same peer at the other port."""


def beside(turns: Turns, now: float) -> None:
    """Another peer begins a request."""
    turns.end(OTHER, turns.begin(OTHER, now))


def begun(turns: Turns, now: float) -> int:
    """How many of my requests begin at once."""
    count = 0
    while count < 100 and not turns.wait_s(ME, now):
        turns.begin(ME, now)
        count += 1
    return count


@pytest.mark.parametrize(
    ("members", "spent_s", "count"), [((), 0.0, 4), ((), 0.9, 1), ((), 0.7, 4), ((ME,), 0.9, 1), ((ME, OTHER), 5.0, 4)]
)
def test_who_has_saved_next_to_nothing_begins_one_request_at_a_time(members: tuple[Guest, ...], spent_s: float, count: int) -> None:
    """`spent_s`: of what one may have saved; members have no share beside each other."""
    turns = Turns(lambda peer: peer in {name for name, _ in members})
    beside(turns, 0.0)
    turns.pay(ME, spent_s * SAVED_S_MAX, 0.0)
    assert begun(turns, 0.0) == count


def test_a_request_that_was_the_only_one_makes_way_after_its_turn() -> None:
    turns = Turns()
    beside(turns, 0.0)
    turns.pay(ME, SAVED_S_MAX, 0.0)
    assert begun(turns, 0.0) == 1
    assert turns.wait_s(ME, 0.01) == pytest.approx(TURN_S - 0.01)
    assert begun(turns, TURN_S) == 1


def test_what_is_urgent_begins_while_bulk_has_to_wait_and_the_other_way_round() -> None:
    for spends, waits, begins in ((ME, ME, URGENT), (URGENT, URGENT, ME)):
        turns = Turns()
        beside(turns, 0.0)
        turns.pay(spends, 1.0, 0.0)
        beside(turns, 0.0)
        assert turns.wait_s(waits, 0.0) > 0
        assert not turns.wait_s(begins, 0.0)


def test_what_was_taken_alone_is_hardly_owed_and_what_was_taken_beside_others_is() -> None:
    owed = []
    for others in (False, True):
        turns = Turns()
        if others:
            beside(turns, 0.0)
        turns.pay(ME, 5.0, 0.0)
        beside(turns, 0.0)
        owed.append(turns.wait_s(ME, 0.0))
    assert 0 < owed[0] <= 4 * (OWED_ALONE_S_MAX + URGENT_SAVED_S_MAX) < owed[1]


def test_a_peer_is_beside_others_for_a_quarter_of_a_second() -> None:
    for later, count in ((0.25, 4), (0.26, 100)):
        turns = Turns()
        beside(turns, 0.0)
        assert begun(turns, later) == count


def test_a_request_that_does_not_end_is_not_forgotten() -> None:
    turns = Turns()
    number = turns.begin(ME, 0.0)
    beside(turns, 10 * BESIDE_S)
    turns.end(ME, number)
    beside(turns, 20 * BESIDE_S)
    assert ME not in turns._guests


def test_what_the_specification_says_of_saving_and_owing() -> None:
    shares = Shares()
    shares.pay("user:me", 0.151, False, False, 0.0)
    assert shares.is_used_up("user:me") and not shares.wait_s("user:me", False, 0.0)
    assert not shares.is_used_up("user:other") and USED_UP_S == 0.05
    shares.pay("user:me", 0.05, False, False, 0.0)
    assert shares.wait_s("user:me", False, 0.0) > 0, "0.2 s at once"
    shares.pay("user:me", 0.049, True, False, 0.0)
    assert not shares.wait_s("user:me", True, 0.0)
    shares.pay("user:me", 0.002, True, False, 0.0)
    assert shares.wait_s("user:me", True, 0.0) > 0, "and 0.05 s where it is urgent"


@pytest.mark.parametrize("is_urgent", [False, True])
def test_nobody_owes_more_than_ten_seconds(is_urgent: bool) -> None:
    waits = []
    for cost_s in (9.0, 100.0, 1_000.0):
        shares = Shares()
        shares.pay("user:other", 0.5, False, False, 0.0)
        shares.pay("user:me", cost_s, is_urgent, False, 0.0)
        waits.append(shares.wait_s("user:me", is_urgent, 0.0) * shares.share("user:me", 0.0))
    assert waits[0] < waits[1] == waits[2] <= 10.0 + 1e-9


def test_the_shares_are_those_of_the_specification() -> None:
    kinds = {"node:me": Kind.MEMBER, "node:other": Kind.MEMBER}
    for me, other, shares_of in (
        ("user:me", "user:other", ((0.0, 1.0), (0.01, 0.75), (0.025, 0.375), (0.05, 0.25), (0.5, 0.25))),
        ("user:me", "node:other", ((0.0, 1.0), (0.01, 0.75), (0.05, 0.5), (0.5, 0.5))),
        ("node:me", "user:other", ((0.0, 1.0), (0.01, 0.75), (0.05, 0.25), (0.5, 0.25))),
        ("node:me", "node:other", ((0.0, 1.0), (0.01, 1.0), (0.05, 1.0), (0.5, 1.0))),
    ):
        for takes_s, share in shares_of:
            shares = Shares(lambda peer, _now: kinds.get(peer, Kind.CLIENT))
            shares.pay(other, takes_s, False, False, 0.0)
            assert shares.share(me, LOOK_S) == pytest.approx(share, rel=0.05), "who is busy was counted just now"
