"""If this fails, somebody does something more often than it may, or is held up by what another one did."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.world.buckets import KEYS_MAX, Buckets


@given(st.integers(1, 20), st.floats(0.1, 100), st.lists(st.tuples(st.floats(0, 1), st.booleans()), max_size=200))
def test_nobody_takes_more_than_a_bucket_and_what_comes_back(burst: int, per_s: float, steps: list[tuple[float, bool]]) -> None:
    buckets, now = Buckets(burst, per_s), 0.0
    taken: list[float] = []
    for pause, is_mine in steps:
        now += pause
        if not is_mine:
            buckets.take("another", now)
            continue
        there_is_one = buckets.has("me", now)
        assert buckets.take("me", now) == there_is_one
        if there_is_one:
            taken.append(now)
    for first, begun in enumerate(taken):
        for last in range(first, len(taken)):
            assert last - first + 1 <= burst + (taken[last] - begun) * per_s + 1e-6


@given(st.integers(1, 20), st.floats(0.1, 100), st.lists(st.floats(0, 1), max_size=100))
def test_who_gives_back_what_it_takes_always_gets_it(burst: int, per_s: float, pauses: list[float]) -> None:
    buckets, now = Buckets(burst, per_s), 0.0
    for pause in pauses:
        now += pause
        assert buckets.take("me", now)
        buckets.give_back("me", now)
    for _ in range(burst):
        assert buckets.take("me", now)
    assert not buckets.take("me", now), "nothing was gained"


def test_a_second_brings_back_what_it_should() -> None:
    buckets = Buckets(4, 2.0)
    assert [buckets.take("me", 0.0) for _ in range(5)] == [True] * 4 + [False]
    assert [buckets.take("me", 1.0) for _ in range(3)] == [True] * 2 + [False]
    assert [buckets.take("me", 100.0) for _ in range(5)] == [True] * 4 + [False]


def test_a_crowd_of_names_takes_no_room_without_end() -> None:
    buckets = Buckets(1, 0.001)
    assert buckets.take("me", 0.0)
    for number in range(KEYS_MAX - 1):
        assert buckets.take(f"{number}", 0.0)
        assert not buckets.take("me", 0.0), "who comes again is not forgotten"
    for number in range(2 * KEYS_MAX):
        buckets.take(f"other {number}", 0.0)
    assert len(buckets._left) == KEYS_MAX
