"""If this fails, one peer's many requests leave no time for those of others, or a peer that is alone is held up."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.world.turns import BESIDE_S, TURN_S, TURNS_MAX, Turns


def begin_all(turns: Turns, peer: str, now: float, count: int) -> list[int]:
    """Begin as many of `count` requests as may."""
    found = []
    while len(found) < count and not turns.wait_s(peer, now):
        found.append(turns.begin(peer, now))
    return found


def test_who_is_alone_begins_all() -> None:
    assert len(begin_all(Turns(), "me", 0.0, 1_000)) == 1_000


def test_beside_others_a_few_and_the_next_when_one_ends() -> None:
    turns = Turns()
    turns.begin("other", 0.0)
    mine = begin_all(turns, "me", 0.0, 100)
    assert len(mine) == TURNS_MAX
    turns.end("me", mine[0])
    assert len(begin_all(turns, "me", 0.0, 100)) == 1
    assert len(begin_all(turns, "another", 0.0, 100)) == TURNS_MAX, "each has its own"


def test_what_was_begun_alone_counts_when_another_one_comes() -> None:
    turns = Turns()
    begin_all(turns, "me", 0.0, 100)
    turns.begin("other", 0.001)
    assert 0 < turns.wait_s("me", 0.002) <= TURN_S


def test_what_takes_long_counts_no_more() -> None:
    turns = Turns()
    turns.begin("other", 0.0)
    begin_all(turns, "me", 0.0, 100)
    wait_s = turns.wait_s("me", 0.01)
    assert 0 < wait_s <= TURN_S
    assert len(begin_all(turns, "me", 0.01 + wait_s, 100)) == TURNS_MAX


def test_others_that_have_gone_are_beside_nobody() -> None:
    turns = Turns()
    turns.end("other", turns.begin("other", 0.0))
    assert len(begin_all(turns, "me", 0.5 * BESIDE_S, 100)) == TURNS_MAX
    assert len(begin_all(turns, "me", 2 * BESIDE_S, 100)) == 100


@given(st.lists(st.tuples(st.floats(0, 0.05), st.sampled_from("abc"), st.booleans()), max_size=300))
def test_any_coming_and_going(steps: list[tuple[float, str, bool]]) -> None:
    turns, now = Turns(), 0.0
    begun: dict[str, dict[int, float]] = {"a": {}, "b": {}, "c": {}}
    last: dict[str, float] = {}
    for pause, peer, ends in steps:
        now += pause
        mine = begun[peer]
        if ends and mine:
            number = next(iter(mine))
            del mine[number]
            turns.end(peer, number)
            continue
        young = [at for at in mine.values() if at > now - TURN_S + 1e-9]
        beside = any(at > now - BESIDE_S + 1e-9 for other, at in last.items() if other != peer)
        wait_s = turns.wait_s(peer, now)
        assert 0 <= wait_s <= TURN_S + 1e-9
        if wait_s:
            assert len(young) >= TURNS_MAX - 1 and len(mine) >= TURNS_MAX
        else:
            assert not beside or len(young) < TURNS_MAX
            mine[turns.begin(peer, now)] = last[peer] = now
    for peer, mine in begun.items():
        for number in mine:
            turns.end(peer, number)
    assert not turns._begun and len(turns._last_at) <= 3
