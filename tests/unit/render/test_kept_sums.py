"""If this fails, two threads add to one table at once, sums are lost, or a node with many threads holds a table for each of them."""

from __future__ import annotations

from contextlib import ExitStack

from hypothesis import given
from hypothesis import strategies as st

from scenefold.render.passes import PassPlan
from scenefold.render.pool.kept_sums import KeptSums
from scenefold.render.sum_columns import PLAIN

PLAN = PassPlan(5, 3 * 65_536)


def light_of(kept: KeptSums, number: int) -> int:
    return int(kept.total(number).radiance[0, 0])


def test_one_thread_after_the_other_works_with_the_same_table() -> None:
    kept = KeptSums(PLAN, PLAIN)
    tables = set()
    for _ in range(5):
        with kept.lent([0, 2]) as (one, other):
            one.radiance[0, 0] += 1
            other.radiance[0, 0] += 10
            tables |= {id(one), id(other)}
    assert len(tables) == 2 and (light_of(kept, 0), light_of(kept, 2)) == (5, 50) and len(kept) == 2


def test_what_fails_gives_its_table_back() -> None:
    kept = KeptSums(PLAN, PLAIN)
    lent = kept.lent([1])
    (one,) = lent.__enter__()
    assert not lent.__exit__(ZeroDivisionError, ZeroDivisionError(), None)
    with kept.lent([1]) as (again,):
        assert again is one


def test_a_closed_pass_begins_anew() -> None:
    kept = KeptSums(PLAN, PLAIN)
    with kept.lent([1]) as (one,):
        one.radiance[0, 0] = 7
        kept.forget(1)
    assert len(kept) == 0 and light_of(kept, 1) == 0
    with kept.lent([1]) as (other,):
        assert other is not one and not other.radiance.any()


@given(st.lists(st.lists(st.integers(0, 2), min_size=1, max_size=3, unique=True), max_size=6))
def test_nothing_is_lost_and_nobody_shares(at_once: list[list[int]]) -> None:
    kept, done = KeptSums(PLAN, PLAIN), [0, 0, 0]
    for _ in range(2):
        with ExitStack() as stack:
            lent = [table for numbers in at_once for table in stack.enter_context(kept.lent(numbers))]
            assert len({id(table) for table in lent}) == len(lent)
            for number, table in zip([number for numbers in at_once for number in numbers], lent, strict=True):
                table.radiance[0, 0] += 1
                done[number] += 1
    assert [light_of(kept, number) for number in range(3)] == done
    assert sum(map(len, kept._kept.values())) == sum(map(len, at_once))
