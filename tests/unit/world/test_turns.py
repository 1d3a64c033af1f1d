"""If this fails, one peer's many requests leave no time for those of others, or a peer that is alone is held up."""

from __future__ import annotations

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


def requests_in(turns: Turns, seconds: float, answer_bytes: int, *, beside: bool, guest: Guest = PUSHY) -> int:
    """How many one makes that asks again and again, and is answered at once."""
    now, count = 0.0, 0
    while now < seconds:
        if beside:
            visit(turns, OTHER, now)
        wait_s = turns.wait_s(guest, now)
        assert not wait_s or beside
        now += wait_s + 1e-9 if wait_s else 1e-4
        if not wait_s:
            turns.end(guest, turns.begin(guest, now), answer_bytes, now)
            count += 1
    return count


@pytest.mark.parametrize("answer_bytes", [0, 77_000, 4_000_000])
def test_beside_others_a_peer_gets_its_share_of_the_time_and_alone_all(answer_bytes: int) -> None:
    cost_s = REQUEST_S + answer_bytes * ANSWER_BYTE_S
    found = requests_in(Turns(), 10.0, answer_bytes, beside=True)
    assert found * cost_s == pytest.approx(WORK_S_MAX + 10.0 * WORK_SHARE, abs=cost_s + WORK_S_OWED_MAX)
    assert requests_in(Turns(), 1.0, answer_bytes, beside=False) >= 9_000


def test_who_took_all_alone_owes_little_when_others_come() -> None:
    turns = Turns()
    for _ in range(10_000):
        turns.end(ME, turns.begin(ME, 0.0), 1_000_000, 0.0)
    visit(turns, OTHER, 0.0)
    assert 0 < turns.wait_s(ME, 0.0) <= WORK_S_OWED_MAX / WORK_SHARE


def test_members_take_all_the_time_but_begin_no_more_at_a_time_than_others() -> None:
    turns = Turns(is_free=lambda peer: peer == ME[0])
    assert requests_in(turns, 1.0, 77_000, beside=True, guest=ME) >= 9_000
    assert len(begin_all(turns, ME, 1.0, 100)) == TURNS_MAX


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
