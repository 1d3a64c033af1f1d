"""If one fails, a crash at some commit or packet of a join, a drain or a transfer leaves the line torn, or loses what was acknowledged."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from scenefold.simulation import laws
from scenefold.simulation.mutants import mutated
from scenefold.world.sim import Point
from simulation.steps import Crash, Disturbed, Story, crashes, handing, joining, leaving, play

VOTER, GIVER, JOINER = 0, 1, 2


class Least(NamedTuple):
    """What there must be to crash at, or a story has lost what it was to test: commits, and packets sent."""

    commits: int
    packets: int


ROLES = [
    pytest.param(joining, 2, JOINER, Least(8, 18), id="the joiner"),
    pytest.param(joining, 2, GIVER, Least(7, 14), id="who gives to the joiner"),
    pytest.param(joining, 2, VOTER, Least(2, 12), id="who registers the joiner"),
    pytest.param(leaving, 3, GIVER, Least(9, 12), id="who leaves"),
    pytest.param(leaving, 3, 2, Least(5, 10), id="who takes from the leaving"),
    pytest.param(leaving, 3, VOTER, Least(1, 6), id="who registers that it left"),
    pytest.param(handing, 2, GIVER, Least(6, 8), id="who gives"),
    pytest.param(handing, 2, VOTER, Least(3, 8), id="who receives"),
]


# Nodes complain of neighbours that crash, as they should; the observer says what is wrong.
pytestmark = pytest.mark.usefixtures("silent")


@pytest.mark.parametrize(("story", "founders"), [(joining, 2), (leaving, 3), (handing, 2)])
def test_the_stories_themselves(story: Story, founders: int) -> None:
    assert not play(story, founders=founders)


@pytest.mark.slow
@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT, Point.AFTER_SEND])  # Before a send it is after one of these.
@pytest.mark.parametrize(("story", "founders", "slot", "least"), ROLES)
def test_a_crash_at_every_step(story: Story, founders: int, slot: int, least: Least, point: Point) -> None:
    # After the first packet is before the second, so of these two kinds every other moment is enough.
    is_packet = point is Point.AFTER_SEND
    found = crashes(story, slot, point, founders=founders, stride=2 if is_packet else 1)
    assert found >= (least.packets if is_packet else least.commits)


@pytest.mark.slow
@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT])
@pytest.mark.parametrize(("story", "founders", "slot", "least"), [role for role in ROLES if role.values[2] != VOTER])
def test_who_does_not_return_is_replaced_and_brings_home_what_it_held(
    story: Story, founders: int, slot: int, least: Least, point: Point
) -> None:
    assert crashes(story, slot, point, founders=founders, returns=False, stride=2) >= least.commits


@pytest.mark.parametrize(("story", "founders", "slot", "count"), [(joining, 2, GIVER, 3), (leaving, 3, GIVER, 2), (handing, 2, GIVER, 3)])
def test_that_nothing_is_brought_home_is_noticed(story: Story, founders: int, slot: int, count: int) -> None:
    noticed = pytest.RaisesExc(Disturbed, match=laws.BROUGHT_HOME)
    with mutated("strays brought home"), pytest.RaisesGroup(noticed, flatten_subgroups=True):
        play(story, Crash(slot, Point.AFTER_COMMIT, count, returns=False), founders=founders)


def test_a_joiner_that_dies_half_way_for_good() -> None:
    assert play(joining, Crash(JOINER, Point.BEFORE_COMMIT, 7, returns=False))
