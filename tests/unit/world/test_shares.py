"""If this fails, a peer takes more of a node's time than its share, starves, or lives on what it has not used for long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.world.shares import (
    BUSY,
    BUSY_SHARE,
    LOOK_S,
    MEMBERS_SHARE,
    OWED_ALONE_S_MAX,
    SAVED_S_MAX,
    URGENT_SAVED_S_MAX,
    Kind,
    Shares,
)

STEP_S = 0.002
SAVED_ALL_S = SAVED_S_MAX + URGENT_SAVED_S_MAX


@dataclass
class Asker:
    """Asks for something that costs so much as often as it may, but for no more than this part of the time."""

    name: str
    cost_s: float
    wants: float = 1.0
    is_urgent: bool = False
    took_s: float = 0.0
    longest_wait_s: float = 0.0

    def step(self, shares: Shares, now: float, elapsed_s: float) -> None:
        while self.took_s + self.cost_s <= self.wants * elapsed_s:
            wait_s = shares.wait_s(self.name, self.is_urgent, now)
            self.longest_wait_s = max(self.longest_wait_s, wait_s)
            if wait_s:
                return
            shares.pay(self.name, self.cost_s, self.is_urgent, False, now)
            self.took_s += self.cost_s


def run(askers: Sequence[Asker], seconds: float, shares: Shares | None = None, begin: float = 100.0) -> None:
    """All ask beside each other. A thread has only so much time; here nobody is slowed by that, only by shares."""
    shares = Shares() if shares is None else shares
    for number in range(round(seconds / STEP_S)):
        for asker in askers:
            asker.step(shares, begin + number * STEP_S, number * STEP_S)


@settings(max_examples=20)
@given(st.lists(st.floats(0.0001, 0.05), min_size=2, max_size=5))
def test_whoever_wants_all_gets_the_same_whatever_one_request_costs(costs: list[float]) -> None:
    askers = [Asker(f"user:{number}", cost_s) for number, cost_s in enumerate(costs)]
    run(askers, 5.0)
    fair_s = 5.0 * BUSY_SHARE / len(askers)
    for asker in askers:
        assert 0.9 * fair_s - asker.cost_s <= asker.took_s <= 1.25 * fair_s + SAVED_ALL_S + asker.cost_s


@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(0.0001, 0.02), st.floats(0.001, 1.0)), min_size=1, max_size=6))
def test_nobody_starves_beside_whatever_others_want(others: list[tuple[float, float]]) -> None:
    me = Asker("user:me", 0.001)
    run([*(Asker(f"user:{number}", *one) for number, one in enumerate(others)), me], 3.0)
    assert me.took_s >= 0.95 * 3.0 * BUSY_SHARE / (1 + len(others)) - me.cost_s
    assert me.longest_wait_s <= me.cost_s * (1 + len(others)) / BUSY_SHARE + STEP_S


@pytest.mark.parametrize(("wants", "least"), [(0.001, 0.95), (0.01, 0.7), (0.018, 0.45), (0.03, 0.3), (0.1, 0.24)])
def test_the_less_others_take_the_more_there_is(wants: float, least: float) -> None:
    me, other = Asker("user:me", 0.005), Asker("user:other", 0.0005, wants)
    run([other, me], 10.0)
    assert me.took_s >= least * 10.0
    assert other.took_s >= 0.95 * wants * 10.0 - other.cost_s, "who wants little gets it"


def test_many_names_that_take_little_push_nobody_further_than_one_that_takes_it_all() -> None:
    me, crowd = Asker("user:me", 0.001), [Asker(f"user:{number}", 0.0001, BUSY / 50) for number in range(50)]
    run([*crowd, me], 5.0)
    alone = Asker("user:me", 0.001)
    run([Asker("user:other", 0.001, BUSY), alone], 5.0)
    assert me.took_s == pytest.approx(alone.took_s, rel=0.1)


def kind_of(peer: str, _now: float) -> Kind:
    return Kind.MEMBER if peer.startswith("node:") else Kind.ACCUSED if peer.startswith("liar:") else Kind.CLIENT


@pytest.mark.parametrize(("clients", "members"), [(1, 1), (1, 8), (12, 1), (6, 3)])
def test_neither_clients_nor_members_push_the_other_kind_out_of_its_part(clients: int, members: int) -> None:
    users = [Asker(f"user:{number}", 0.02) for number in range(clients)]
    nodes = [Asker(f"node:{number}", 0.02) for number in range(members)]
    run([*users, *nodes], 5.0, Shares(kind_of))
    for askers, part in ((users, BUSY_SHARE), (nodes, MEMBERS_SHARE)):
        fair_s = 5.0 * part / len(askers)
        for asker in askers:
            assert 0.9 * fair_s - asker.cost_s <= asker.took_s <= 1.25 * fair_s + SAVED_ALL_S + asker.cost_s


@pytest.mark.parametrize(("name", "most"), [("node:me", 1.0), ("liar:me", MEMBERS_SHARE / 2)])
def test_only_clients_are_others_to_a_member_unless_it_lied(name: str, most: float) -> None:
    shares = Shares(kind_of)
    shares.pay("node:other", 0.5, False, False, 0.0)
    assert shares.share(name, LOOK_S) == most
    shares.pay("user:other", 0.5, False, False, LOOK_S)
    assert shares.share(name, 2 * LOOK_S) == MEMBERS_SHARE / 2


@pytest.mark.parametrize("quiet_s", [0.0, 1.0, 1_000.0])
def test_who_was_quiet_has_saved_little(quiet_s: float) -> None:
    shares, me = Shares(), Asker("user:me", 0.001)
    me.step(shares, 0.0, 0.001)
    shares.pay("user:other", 0.5, False, False, 1.0 + quiet_s)
    me.took_s = 0.0
    me.step(shares, 1.0 + quiet_s, 1_000.0)
    assert me.took_s <= SAVED_ALL_S + 2 * me.cost_s


def test_one_large_request_is_paid_for_in_full() -> None:
    shares = Shares()
    shares.pay("user:other", 0.5, False, False, 0.0)
    shares.pay("user:me", 5.0, False, False, 0.0)
    assert shares.wait_s("user:me", False, 0.0) >= 4.0
    assert not shares.wait_s("user:third", False, 0.0)


def test_who_took_all_alone_owes_little_when_others_come() -> None:
    shares = Shares()
    for _ in range(1_000):
        shares.pay("user:me", 0.1, False, True, 0.0)
    shares.pay("user:other", 0.5, False, False, 0.0)
    assert 0 < shares.wait_s("user:me", False, 0.0) <= (OWED_ALONE_S_MAX + URGENT_SAVED_S_MAX) * 2 / BUSY_SHARE


def test_what_is_urgent_does_not_wait_for_the_same_peers_bulk_and_both_together_are_one_share() -> None:
    other, bulk, urgent = Asker("user:other", 0.001), Asker("user:me", 0.05), Asker("user:me", 0.001, 0.02, is_urgent=True)
    run([other, bulk, urgent], 5.0)
    assert urgent.took_s >= 0.95 * 5.0 * 0.02 - urgent.cost_s and not urgent.longest_wait_s
    other, bulk, urgent = Asker("user:other", 0.001), Asker("user:me", 0.05), Asker("user:me", 0.001, is_urgent=True)
    run([other, bulk, urgent], 5.0)
    assert bulk.took_s + urgent.took_s <= 1.25 * 5.0 * BUSY_SHARE / 2 + SAVED_ALL_S + bulk.cost_s


def test_who_has_paid_is_forgotten_and_who_owes_is_not() -> None:
    shares = Shares()
    for number in range(1_000):
        shares.pay(f"user:{number}", 0.01, False, False, number * 0.1)
    assert len(shares) <= 20
    shares.pay("user:debtor", 8.0, False, False, 100.0)
    shares.pay("user:other", 0.01, False, False, 104.0)
    assert shares.wait_s("user:debtor", False, 104.0) > 0
    for second in range(105, 150):
        shares.pay("user:other", 0.01, False, False, second)
    assert not shares.wait_s("user:debtor", False, 150.0)
