"""If this fails, a node may be removed that could have been heard, or a right removal is called false."""

from __future__ import annotations

from scenefold.simulation.reach import Reach

NODES = range(4)
WINDOW = (50.0, 60.0)


def test_a_node_that_is_up_is_reachable() -> None:
    assert Reach().was_reachable(3, 0, NODES, WINDOW)


def test_a_node_that_was_down_for_a_moment_was_not() -> None:
    reach = Reach()
    reach.goes_down(3, 52.0)
    reach.comes_up(3, 53.0)
    assert not reach.was_reachable(3, 0, NODES, WINDOW)
    assert reach.was_reachable(3, 0, NODES, (53.0, 60.0))


def test_being_down_before_the_window_does_not_count() -> None:
    reach = Reach()
    reach.goes_down(3, 10.0)
    reach.comes_up(3, 49.0)
    assert reach.was_reachable(3, 0, NODES, WINDOW)


def test_it_may_be_reached_through_another() -> None:
    reach = Reach()
    reach.cut(3, 0, 40.0)
    assert reach.was_reachable(3, 0, NODES, WINDOW)
    reach.cut(1, 3, 40.0)
    reach.cut(2, 0, 40.0)
    assert not reach.was_reachable(3, 0, NODES, WINDOW)


def test_the_one_between_must_be_up() -> None:
    reach = Reach()
    reach.cut(0, 3, 40.0)
    reach.goes_down(1, 40.0)
    reach.goes_down(2, 40.0)
    assert not reach.was_reachable(3, 0, NODES, WINDOW)


def test_two_cuts_of_one_link_end_with_the_second() -> None:
    reach = Reach()
    reach.cut(0, 3, 40.0)
    reach.cut(3, 0, 41.0)
    reach.mended(0, 3, 45.0)
    assert not reach.was_reachable(3, 0, [0, 3], WINDOW)
    reach.mended(0, 3, 50.0)
    assert reach.was_reachable(3, 0, [0, 3], WINDOW)


def test_two_were_clear_of_each_other_only_if_both_were_up_and_well_and_nothing_lay_between() -> None:
    reach = Reach()
    assert reach.was_clear(1, 2, WINDOW)
    reach.hampered(1, 1.0)
    reach.hampered(1, 2.0)
    reach.relieved(1, 3.0)
    assert not reach.was_clear(1, 2, WINDOW) and reach.was_clear(2, 3, WINDOW), "it still bears one of two burdens"
    reach.relieved(1, 4.0)
    assert reach.was_clear(1, 2, (4.0, 9.0)) and not reach.was_clear(1, 2, (3.5, 9.0))
    reach.cut(2, 1, 10.0)
    assert not reach.was_clear(1, 2, (5.0, 12.0))
    reach.mended(2, 1, 13.0)
    reach.goes_down(2, 14.0)
    assert not reach.was_clear(1, 2, (13.0, 15.0))
