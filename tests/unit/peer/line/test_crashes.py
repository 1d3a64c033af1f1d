"""If one fails, a crash at some commit or packet of a handover or adoption gives places two owners, none, or loses records."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.location import Arc, Location
from scenefold.peer.line import Side, copying, giving
from scenefold.world.sim import Point, run_simulated
from unit.peer.line.street import RECORD_BYTES, House, Street

RECORDS = 24
PART = 2
DISTINCT = (Point.BEFORE_COMMIT, Point.AFTER_COMMIT, Point.AFTER_SEND)
"""Where nothing else is durable or known between two of them: what crashes before a send has crashed after a commit or another send."""
"""Records of a batch, where there are to be many: half of the records are given."""

pytestmark = pytest.mark.usefixtures("only_errors")


Story = Callable[[Street], Awaitable[None]]


def end_of(arc: Arc, side: Side, share: float) -> Arc:
    middle = arc.first.number + arc.length * round(share * 100) // 100
    return Arc(Location.from_number(middle), arc.last) if side is Side.RIGHT else Arc(arc.first, Location.from_number(middle))


async def give(house: House, side: Side, share: float = 0.5) -> None:
    """Give that share of the arc once it has settled; whatever comes of it."""
    await trio.sleep(11.0)
    while house.line is None or house.line.arc is None:  # noqa: ASYNC110 - it is a matter of a restart, or of a founding
        await trio.sleep(0.1)
    arc = house.line.arc
    piece = arc if share == 1 else end_of(arc, side, share)
    try:
        await house.line.give(side, piece, why="a test")
    except (Refused, Unreachable, PeerFault):
        return


def play(
    story: Story,
    *,
    founders: int = 2,
    newcomers: int = 0,
    join_before: int = 0,
    number: int = -1,
    point: Point = Point.AFTER_SEND,
    count: int = 0,
) -> bool:
    """Play a story with one crash of a node at its n-th passing of a point. False if it did not come so far."""

    async def main() -> bool:
        street = Street(founders, newcomers=newcomers, join_before=join_before)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            sprung = False

            def spring() -> None:
                nonlocal sprung
                sprung = True
                street.houses[number].crash()

            if count:
                street.net.trap(street.houses[number].address, point, count, spring)
            await story(street)
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()
        return sprung

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def crash_everywhere(story: Story, number: int, point: Point, **street: int) -> int:
    """Play the story with a crash at the first, second, ... passing of the point, until it ends before that."""
    count = 0
    while play(story, number=number, point=point, count=count + 1, **street):
        count += 1
    return count


async def handing_right(street: Street) -> None:
    await street.fill(0, RECORDS)
    await give_within(street, 0, Side.RIGHT)


async def handing_all_left(street: Street) -> None:
    await street.fill(1, RECORDS)
    await give_within(street, 1, Side.LEFT, 1.0)


async def give_within(street: Street, number: int, side: Side, share: float = 0.5) -> None:
    with trio.move_on_after(60.0):
        await give(street.houses[number], side, share)


@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("story", [handing_right, handing_all_left])
def test_a_crash_at_every_step_of_a_handover(story: Story, number: int, point: Point) -> None:
    assert crash_everywhere(story, number, point) >= 4


# Six batches are listed, copied, written and deleted, besides what a handover of one batch sends and writes.
IN_PARTS = [(Point.BEFORE_SEND, 20), (Point.AFTER_SEND, 20), (Point.BEFORE_COMMIT, 9), (Point.AFTER_COMMIT, 9)]


@pytest.mark.parametrize(("point", "least"), IN_PARTS)
@pytest.mark.parametrize("number", [0, pytest.param(1, marks=pytest.mark.long)])
def test_a_crash_at_every_step_of_a_handover_in_many_parts(monkeypatch: pytest.MonkeyPatch, number: int, point: Point, least: int) -> None:
    """A real piece is listed, copied and deleted in many batches, and a node may die between any two of them."""
    monkeypatch.setattr(copying, "LIST_RECORDS_MAX", PART)
    monkeypatch.setattr(copying, "COPY_BYTES_MAX", PART * (RECORD_BYTES + 300))
    monkeypatch.setattr(giving, "DELETE_BATCH", PART)
    assert crash_everywhere(handing_right, number, point) >= least


async def adopting(street: Street) -> None:
    await street.fill(0, RECORDS)
    await street.fill(2, RECORDS)
    street.houses[1].stays_down = True
    street.houses[1].crash()
    await trio.sleep(1.0)
    street.remove(1)


@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize("number", [0, 2])
def test_a_crash_at_every_step_of_an_adoption(number: int, point: Point) -> None:
    assert crash_everywhere(adopting, number, point, founders=3) >= 1


def losing_the_receiver_of(number: int, side: Side, share: float = 0.5, point: Point = Point.BEFORE_COMMIT) -> Story:
    """The middle one of three is given a piece and dies for good as it claims it: before that is durable, or directly after."""

    async def story(street: Street) -> None:
        await street.fill(number, RECORDS)
        house = street.houses[1]

        def fall() -> None:
            house.stays_down = True
            house.crash()

        # The third commit is the claim: noted, copied, taken.
        street.net.trap(house.address, point, 3, fall)
        await give_within(street, number, side, share)
        await trio.sleep(1.0)
        street.remove(1)

    return story


losing_the_receiver = losing_the_receiver_of(0, Side.RIGHT)
LOSSES = [
    pytest.param(losing_the_receiver, 0, id="right"),
    pytest.param(losing_the_receiver_of(0, Side.RIGHT, point=Point.AFTER_COMMIT), 0, id="right, claimed"),
    pytest.param(losing_the_receiver_of(0, Side.RIGHT, 1.0), 0, id="all to the right"),
    pytest.param(losing_the_receiver_of(2, Side.LEFT), 2, id="left"),
    pytest.param(losing_the_receiver_of(2, Side.LEFT, 1.0, Point.AFTER_COMMIT), 2, id="all to the left, claimed"),
]


@pytest.mark.parametrize("point", DISTINCT)
@pytest.mark.parametrize(("story", "giver"), LOSSES)
def test_a_receiver_that_dies_as_it_claims_and_a_crash_at_every_step_of_the_giver(story: Story, giver: int, point: Point) -> None:
    assert crash_everywhere(story, giver, point, founders=3) >= 5


@pytest.mark.parametrize("point", DISTINCT)
@pytest.mark.parametrize(("story", "giver"), LOSSES)
def test_a_receiver_that_dies_as_it_claims_and_a_crash_at_every_step_of_the_third_node(story: Story, giver: int, point: Point) -> None:
    crash_everywhere(story, 2 - giver, point, founders=3)


async def both_give_to_one(street: Street) -> None:
    await street.fill(0, RECORDS)
    await street.fill(1, RECORDS)
    with trio.move_on_after(60.0):
        async with trio.open_nursery() as nursery:
            nursery.start_soon(give, street.houses[0], Side.RIGHT)
            nursery.start_soon(give, street.houses[1], Side.LEFT)


@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, Point.AFTER_SEND])
@pytest.mark.parametrize("number", [0, 2])
def test_two_neighbours_that_give_to_one_empty_node(number: int, point: Point) -> None:
    assert crash_everywhere(both_give_to_one, number, point, newcomers=1, join_before=1) >= 4
