"""If this fails, one peer's many requests leave no time for those of others, or a peer that is alone is held up."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.world.turns import (
    ANSWER_BYTE_S,
    BESIDE_S,
    FORGET_S,
    REQUEST_S,
    TURN_S,
    TURNS_MAX,
    WORK_S_MAX,
    WORK_S_OWED_MAX,
    WORK_SHARE,
    Guest,
    Turns,
)

ME, OTHER, ANOTHER, PUSHY = (("user:me", 0), ("user:other", 0), ("user:another", 0), ("user:pushy", 0))


def begin_all(turns: Turns, guest: Guest, now: float, count: int) -> list[int]:
    """Begin as many of `count` requests as may."""
    found = []
    while len(found) < count and not turns.wait_s(guest, now):
        found.append(turns.begin(guest, now))
    return found


def visit(turns: Turns, guest: Guest, now: float) -> None:
    turns.end(guest, turns.begin(guest, now), 0, now)


def test_who_is_alone_begins_all() -> None:
    assert len(begin_all(Turns(), ME, 0.0, 1_000)) == 1_000


def test_beside_others_a_few_and_the_next_when_one_ends() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    mine = begin_all(turns, ME, 0.0, 100)
    assert len(mine) == TURNS_MAX
    turns.end(ME, mine[0], 0, 0.0)
    assert len(begin_all(turns, ME, 0.0, 100)) == 1
    assert len(begin_all(turns, ANOTHER, 0.0, 100)) == TURNS_MAX, "each has its own"


def test_what_was_begun_alone_counts_when_another_one_comes() -> None:
    turns = Turns()
    begin_all(turns, ME, 0.0, 100)
    turns.begin(OTHER, 0.001)
    assert 0 < turns.wait_s(ME, 0.002) <= TURN_S


def test_what_takes_long_counts_no_more() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    begin_all(turns, ME, 0.0, 100)
    wait_s = turns.wait_s(ME, 0.01)
    assert 0 < wait_s <= TURN_S
    assert len(begin_all(turns, ME, 0.01 + wait_s, 100)) == TURNS_MAX


def test_others_that_have_gone_are_beside_nobody() -> None:
    turns = Turns()
    visit(turns, OTHER, 0.0)
    assert len(begin_all(turns, ME, 0.5 * BESIDE_S, 100)) == TURNS_MAX
    assert len(begin_all(turns, ME, 2 * BESIDE_S, 100)) == 100


def test_who_is_busy_at_one_port_is_beside_others_at_both_and_by_itself_at_none() -> None:
    turns = Turns()
    assert len(begin_all(turns, ("user:me", 1), 0.0, 100)) == len(begin_all(turns, ME, 0.0, 100)) == 100
    visit(turns, OTHER, 0.0)
    assert len(begin_all(turns, ("user:pushy", 1), 0.0, 100)) == len(begin_all(turns, PUSHY, 0.0, 100)) == TURNS_MAX


BUSY_PER_S = 300.0
"""So often somebody asks that much of the time is to be left to it."""


def requests_in(turns: Turns, seconds: float, answer_bytes: int, *, beside_per_s: float = 0.0, guest: Guest = PUSHY) -> int:
    """How many one makes that asks again and again, and is answered at once. Another has asked so often a second for some time."""
    pause_s = 1 / beside_per_s if beside_per_s else math.inf
    next_at, count = 0.0, 0
    while beside_per_s and next_at < 5.0:
        visit(turns, OTHER, next_at)
        next_at += pause_s
    now = begin = next_at
    while now < begin + seconds:
        if beside_per_s and now >= next_at:
            visit(turns, OTHER, now)
            next_at = now + pause_s
        wait_s = turns.wait_s(guest, now)
        assert not wait_s or beside_per_s
        now += min(wait_s + 1e-9, pause_s) if wait_s else 1e-4
        if not wait_s:
            turns.end(guest, turns.begin(guest, now), answer_bytes, now)
            count += 1
    return count


@pytest.mark.parametrize("answer_bytes", [0, 77_000, 4_000_000])
def test_beside_others_a_peer_gets_its_share_of_the_time_and_alone_all(answer_bytes: int) -> None:
    cost_s = REQUEST_S + answer_bytes * ANSWER_BYTE_S
    found = requests_in(Turns(), 10.0, answer_bytes, beside_per_s=BUSY_PER_S)
    assert found * cost_s == pytest.approx(WORK_S_MAX + 10.0 * WORK_SHARE, abs=cost_s + WORK_S_OWED_MAX)
    assert requests_in(Turns(), 1.0, answer_bytes) >= 9_000


@pytest.mark.parametrize("answer_bytes", [0, 77_000])
def test_who_asks_once_a_second_takes_next_to_nothing_away(answer_bytes: int) -> None:
    cost_s = REQUEST_S + answer_bytes * ANSWER_BYTE_S
    assert requests_in(Turns(), 10.0, answer_bytes, beside_per_s=1.0) * cost_s >= 0.95 * 10.0


def test_the_less_others_take_the_more_there_is() -> None:
    found = [requests_in(Turns(), 5.0, 0, beside_per_s=often) for often in (5.0, 50.0, 150.0, BUSY_PER_S)]
    assert found == sorted(found, reverse=True) and found[0] >= 3 * found[-1]


def test_who_took_all_alone_owes_little_when_others_come() -> None:
    turns = Turns()
    for _ in range(10_000):
        turns.end(ME, turns.begin(ME, 0.0), 1_000_000, 0.0)
    visit(turns, OTHER, 0.0)
    assert 0 < turns.wait_s(ME, 0.0) <= WORK_S_OWED_MAX / WORK_SHARE


def test_members_take_all_the_time_but_begin_no_more_at_a_time_than_others() -> None:
    turns = Turns(is_free=lambda peer: peer == ME[0])
    assert requests_in(turns, 1.0, 77_000, beside_per_s=BUSY_PER_S, guest=ME) >= 9_000
    assert len(begin_all(turns, ME, 6.0, 100)) == TURNS_MAX


def test_who_was_quiet_for_long_is_forgotten() -> None:
    turns = Turns()
    for number in range(1_000):
        visit(turns, (f"user:{number}", 0), number * 0.1)
    assert len(turns._guests) <= FORGET_S / 0.1 + 2


@given(
    st.lists(
        st.tuples(st.floats(0, 0.05), st.sampled_from([("a", 0), ("a", 1), ("b", 0)]), st.booleans(), st.integers(0, 1 << 23)), max_size=300
    )
)
def test_any_coming_and_going(steps: list[tuple[float, Guest, bool, int]]) -> None:
    turns, now = Turns(), 0.0
    begun: dict[Guest, dict[int, float]] = {("a", 0): {}, ("a", 1): {}, ("b", 0): {}}
    last: dict[Guest, float] = {}
    for pause, guest, ends, answer_bytes in steps:
        now += pause
        mine = begun[guest]
        if ends and mine:
            number = next(iter(mine))
            del mine[number]
            turns.end(guest, number, answer_bytes, now)
            continue
        young = [at for at in mine.values() if at > now - TURN_S + 1e-9]
        beside = any(at > now - BESIDE_S + 1e-9 for other, at in last.items() if other[0] != guest[0])
        wait_s = turns.wait_s(guest, now)
        assert 0 <= wait_s <= max(TURN_S, WORK_S_OWED_MAX / WORK_SHARE) + 1e-9
        if not wait_s:
            assert not beside or len(young) < TURNS_MAX
            mine[turns.begin(guest, now)] = last[guest] = now
    for guest, mine in begun.items():
        for number in mine:
            turns.end(guest, number, 0, now)
    assert not any(account.begun for account in turns._guests.values())
