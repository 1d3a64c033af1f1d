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
    Turns,
)


def begin_all(turns: Turns, peer: str, now: float, count: int) -> list[int]:
    """Begin as many of `count` requests as may."""
    found = []
    while len(found) < count and not turns.wait_s(peer, now):
        found.append(turns.begin(peer, now))
    return found


def visit(turns: Turns, peer: str, now: float) -> None:
    turns.end(peer, turns.begin(peer, now), 0, now)


def test_who_is_alone_begins_all() -> None:
    assert len(begin_all(Turns(), "me", 0.0, 1_000)) == 1_000


def test_beside_others_a_few_and_the_next_when_one_ends() -> None:
    turns = Turns()
    visit(turns, "other", 0.0)
    mine = begin_all(turns, "me", 0.0, 100)
    assert len(mine) == TURNS_MAX
    turns.end("me", mine[0], 0, 0.0)
    assert len(begin_all(turns, "me", 0.0, 100)) == 1
    assert len(begin_all(turns, "another", 0.0, 100)) == TURNS_MAX, "each has its own"


def test_what_was_begun_alone_counts_when_another_one_comes() -> None:
    turns = Turns()
    begin_all(turns, "me", 0.0, 100)
    turns.begin("other", 0.001)
    assert 0 < turns.wait_s("me", 0.002) <= TURN_S


def test_what_takes_long_counts_no_more() -> None:
    turns = Turns()
    visit(turns, "other", 0.0)
    begin_all(turns, "me", 0.0, 100)
    wait_s = turns.wait_s("me", 0.01)
    assert 0 < wait_s <= TURN_S
    assert len(begin_all(turns, "me", 0.01 + wait_s, 100)) == TURNS_MAX


def test_others_that_have_gone_are_beside_nobody() -> None:
    turns = Turns()
    visit(turns, "other", 0.0)
    assert len(begin_all(turns, "me", 0.5 * BESIDE_S, 100)) == TURNS_MAX
    assert len(begin_all(turns, "me", 2 * BESIDE_S, 100)) == 100


def requests_in(turns: Turns, seconds: float, answer_bytes: int, *, beside: bool) -> int:
    """How many one makes that asks again and again, and is answered at once."""
    now, count = 0.0, 0
    while now < seconds:
        if beside:
            visit(turns, "other", now)
        wait_s = turns.wait_s("pushy", now)
        assert not wait_s or beside
        now += wait_s + 1e-9 if wait_s else 1e-4
        if not wait_s:
            turns.end("pushy", turns.begin("pushy", now), answer_bytes, now)
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
        turns.end("me", turns.begin("me", 0.0), 1_000_000, 0.0)
    visit(turns, "other", 0.0)
    assert 0 < turns.wait_s("me", 0.0) <= WORK_S_OWED_MAX / WORK_SHARE


def test_who_was_quiet_for_long_is_forgotten() -> None:
    turns = Turns()
    for number in range(1_000):
        visit(turns, f"user:{number}", number * 0.1)
    assert len(turns._guests) <= FORGET_S / 0.1 + 2


@given(st.lists(st.tuples(st.floats(0, 0.05), st.sampled_from("abc"), st.booleans(), st.integers(0, 1 << 23)), max_size=300))
def test_any_coming_and_going(steps: list[tuple[float, str, bool, int]]) -> None:
    turns, now = Turns(), 0.0
    begun: dict[str, dict[int, float]] = {"a": {}, "b": {}, "c": {}}
    last: dict[str, float] = {}
    for pause, peer, ends, answer_bytes in steps:
        now += pause
        mine = begun[peer]
        if ends and mine:
            number = next(iter(mine))
            del mine[number]
            turns.end(peer, number, answer_bytes, now)
            continue
        young = [at for at in mine.values() if at > now - TURN_S + 1e-9]
        beside = any(at > now - BESIDE_S + 1e-9 for other, at in last.items() if other != peer)
        wait_s = turns.wait_s(peer, now)
        assert 0 <= wait_s <= max(TURN_S, WORK_S_OWED_MAX / WORK_SHARE) + 1e-9
        if not wait_s:
            assert not beside or len(young) < TURNS_MAX
            mine[turns.begin(peer, now)] = last[peer] = now
    for peer, mine in begun.items():
        for number in mine:
            turns.end(peer, number, 0, now)
    assert not any(guest.begun for guest in turns._guests.values())
