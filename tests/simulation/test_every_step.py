"""If one fails, a crash at some commit or packet of a join, a drain or a transfer leaves the line torn, or loses what was acknowledged."""

from __future__ import annotations

import pytest

from scenefold.simulation import laws
from scenefold.simulation.mutants import mutated
from scenefold.world.sim import Point
from simulation.steps import Crash, Disturbed, Story, crashes, handing, joining, leaving, play

VOTER, GIVER, JOINER = 0, 1, 2
ROLES = [
    pytest.param(joining, 2, JOINER, id="the joiner"),
    pytest.param(joining, 2, GIVER, id="who gives to the joiner"),
    pytest.param(joining, 2, VOTER, id="who registers the joiner"),
    pytest.param(leaving, 3, GIVER, id="who leaves"),
    pytest.param(leaving, 3, 2, id="who takes from the leaving"),
    pytest.param(leaving, 3, VOTER, id="who registers that it left"),
    pytest.param(handing, 2, GIVER, id="who gives"),
    pytest.param(handing, 2, VOTER, id="who receives"),
]


# Nodes complain of neighbours that crash, as they should; the observer says what is wrong.
pytestmark = pytest.mark.usefixtures("silent")


@pytest.mark.parametrize(("story", "founders"), [(joining, 2), (leaving, 3), (handing, 2)])
def test_the_stories_themselves(story: Story, founders: int) -> None:
    assert not play(story, founders=founders)


@pytest.mark.slow
@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize(("story", "founders", "slot"), ROLES)
def test_a_crash_at_every_step(story: Story, founders: int, slot: int, point: Point) -> None:
    # After the first packet is before the second, so of these two kinds every other moment is enough.
    stride = 2 if point in (Point.BEFORE_SEND, Point.AFTER_SEND) else 1
    # Everything goes to the right, so all that the voter has to write there is one record of the log.
    least = 1 if story is leaving and slot == VOTER else 2
    assert crashes(story, slot, point, founders=founders, stride=stride) >= least


@pytest.mark.slow
@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_COMMIT])
@pytest.mark.parametrize(("story", "founders", "slot"), [role for role in ROLES if role.values[2] != VOTER])
def test_who_does_not_return_is_replaced_and_brings_home_what_it_held(story: Story, founders: int, slot: int, point: Point) -> None:
    assert crashes(story, slot, point, founders=founders, returns=False, stride=2) >= 2


@pytest.mark.parametrize(("story", "founders", "slot", "count"), [(joining, 2, GIVER, 3), (leaving, 3, GIVER, 2), (handing, 2, GIVER, 3)])
def test_that_nothing_is_brought_home_is_noticed(story: Story, founders: int, slot: int, count: int) -> None:
    noticed = pytest.RaisesExc(Disturbed, match=laws.BROUGHT_HOME)
    with mutated("strays brought home"), pytest.RaisesGroup(noticed, flatten_subgroups=True):
        play(story, Crash(slot, Point.AFTER_COMMIT, count, returns=False), founders=founders)


def test_a_joiner_that_dies_half_way_for_good() -> None:
    assert play(joining, Crash(JOINER, Point.BEFORE_COMMIT, 7, returns=False))
