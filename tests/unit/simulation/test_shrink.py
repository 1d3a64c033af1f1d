"""If this fails, a failing seed is shown with faults that have nothing to do with it, or the shortener never ends."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.simulation.shrink import shorten


@given(st.integers(1, 25).flatmap(lambda count: st.tuples(st.just(count), st.sets(st.integers(0, count - 1)))))
def test_what_is_needed_is_left_and_nothing_else(case: tuple[int, set[int]]) -> None:
    count, needed = case
    found = shorten(range(count), lambda items: needed <= set(items), tries_max=10_000)
    assert found.is_minimal
    assert set(found.items) == needed


@given(st.integers(1, 25), st.integers(0, 40))
def test_it_keeps_to_its_tries_and_what_it_gives_fails(count: int, tries_max: int) -> None:
    def fails(items: tuple[int, ...]) -> bool:
        tried.append(items)
        return sum(items) >= count

    tried: list[tuple[int, ...]] = []
    found = shorten(range(count + 2), fails, tries_max)
    assert found.tries == len(tried) <= tries_max
    assert sum(found.items) >= count
    assert len(set(tried)) == len(tried)


def test_a_bug_that_needs_no_fault_has_an_empty_schedule() -> None:
    assert shorten("abc", lambda _: True).items == ()
