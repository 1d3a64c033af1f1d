"""If this fails, render pools are too small to hold their scene, or larger than they need be."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.render.pool import forming
from scenefold.render.pool.forming import Holds, even

GIB = 1 << 30
Needs = Callable[[int], int]


def shared(whole: int, beside: int = 0) -> Needs:
    """A scene of so many bytes, of which each node of a pool holds its part, and something beside."""
    return lambda size: beside + -(-whole // size)


def holding(free: Sequence[int], needs: Needs) -> Holds:
    """Pools of nodes that have so many bytes each."""
    return lambda first, end: min(free[first:end]) >= needs(end - first)


def formed(free: Sequence[int], needs: Needs) -> list[int]:
    return forming.formed(len(free), holding(free, needs))


def are_enough(free: Sequence[int], sizes: Sequence[int], needs: Needs) -> bool:
    return forming.are_enough(sizes, holding(free, needs))


@pytest.mark.parametrize(
    ("nodes", "pools", "sizes"), [(7, 3, [3, 2, 2]), (6, 3, [2, 2, 2]), (5, 1, [5]), (2, 9, [1, 1]), (127, 2, [64, 63]), (1, 1, [1])]
)
def test_even_pools(nodes: int, pools: int, sizes: list[int]) -> None:
    assert even(nodes, pools) == sizes


def test_who_has_room_for_all_of_it_is_a_pool_of_its_own() -> None:
    assert formed([GIB] * 5, shared(GIB)) == [1] * 5
    assert formed([GIB] * 5, shared(GIB, beside=1)) == [3, 2]


def test_a_scene_that_only_all_together_hold_has_one_pool_and_so_has_one_that_they_do_not() -> None:
    assert formed([GIB] * 5, shared(5 * GIB)) == [5]
    assert formed([GIB] * 5, shared(99 * GIB)) == [5]


def test_where_some_have_less_pools_are_as_large_as_they_must_be() -> None:
    # Three on the left hold half of it each, and those behind only a quarter.
    assert formed([2, 2, 2, 1, 1, 1, 1], shared(4)) == [2, 5]
    # Even pools, where these do.
    assert formed([2, 2, 1, 1, 1, 1, 2, 2], shared(4)) == [2, 4, 2]
    assert formed([2, 2, 2, 2, 2, 2, 1, 1], shared(4)) == [2, 2, 4]
    assert formed([4, 4, 4, 3, 3, 3], shared(6)) == [2, 2, 2]


def test_one_that_has_nothing_is_in_a_pool_that_knows_it() -> None:
    assert formed([4, 4, 0, 4, 4], shared(4, beside=1)) == [5]


@given(free=st.lists(st.integers(1, 100), min_size=1, max_size=30), whole=st.integers(1, 600), beside=st.integers(0, 5))
def test_pools_hold_the_scene_if_one_of_all_does(free: list[int], whole: int, beside: int) -> None:
    needs = shared(whole, beside)
    sizes = formed(free, needs)
    assert sum(sizes) == len(free) and min(sizes) > 0
    assert len(sizes) == 1 or are_enough(free, sizes, needs)
    if are_enough(free, [1] * len(free), needs):
        assert sizes == [1] * len(free)
    if all(one == free[0] for one in free) and len(sizes) > 1:
        # Of equal nodes there is no even division into more pools.
        assert not any(are_enough(free, even(len(free), more), needs) for more in range(len(sizes) + 1, len(free) + 1))
