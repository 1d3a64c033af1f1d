"""If one fails, what a dead node owned goes to one neighbour though others wait for an arc beside it, or balance pours after what it cannot see."""

from __future__ import annotations

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.peer.line.gaps import GAP_S_MAX, Gaps, beside, share_of, unclaimed
from scenefold.world.sim import Point, run_simulated
from unit.peer.line.street import Street
from unit.peer.line.test_crashes import DISTINCT, adopting, crash_everywhere


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


class News:
    def __init__(self) -> None:
        self.said: dict[NodeId, Arc | None] = {}
        self.former: list[Arc] = []
        self.at = 0.0

    def arcs(self) -> dict[NodeId, Arc | None]:
        return self.said

    def former_arcs(self, _now: float) -> list[Arc]:
        return self.former

    def now(self) -> float:
        return self.at

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


def test_what_was_somebodys_and_is_nobodys_is_a_gap_until_it_is_claimed() -> None:
    news = News()
    gaps = Gaps(news, news)  # type: ignore[arg-type]
    assert gaps.unowned(arc(0, 9)) == ()
    news.former = [arc(10, 29)]
    assert gaps.unowned(arc(0, 9)) == (arc(10, 29),)
    news.former, news.said = [], {NodeId(1): arc(20, 39), NodeId(2): None}
    assert gaps.unowned(arc(0, 9)) == (arc(10, 19),), "longer than the roster speaks of it"
    assert gaps.unowned(arc(0, 19)) == ()
    news.said = {}
    assert gaps.unowned(arc(0, 9)) == (arc(10, 29),)
    news.at = GAP_S_MAX
    assert gaps.unowned(arc(0, 9)) == (), "nobody adopts it: balance goes on"


def test_what_is_claimed_is_none_whoever_claims_it() -> None:
    assert unclaimed([arc(0, 9), arc(20, 29)], [None, arc(5, 24)]) == (arc(0, 4), arc(25, 29))
    assert unclaimed([arc(0, 9)], [arc(0, 4), arc(5, 9)]) == ()


@pytest.mark.parametrize(
    ("gap", "expected"),
    [
        (arc(10, 19), {0, 1, 2}),
        (arc(12, 12), {0, 1, 2}),
        (Arc(Location.from_number(40), LAST), {3, 4}),
        (arc(0, 9), set()),
        (arc(22, 25), set()),
    ],
)
def test_beside_a_gap_stand_the_owners_around_it_and_who_waits_between_them(gap: Arc, expected: set[int]) -> None:
    arcs = {NodeId(0): arc(0, 9), NodeId(1): None, NodeId(2): arc(20, 29), NodeId(3): arc(30, 39)}
    assert beside([gap], [NodeId(number) for number in range(5)], arcs) == frozenset(map(NodeId, expected))


def test_before_the_first_owner_there_may_be_one() -> None:
    assert beside([Arc(FIRST, FIRST)], [NodeId(0), NodeId(1)], {NodeId(1): arc(5, 9)}) == {NodeId(0), NodeId(1)}


@given(st.integers(0, 99), st.integers(0, 99), st.integers(0, 5), st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99))))
def test_a_share_ends_beside_the_adopter_and_leaves_something_for_who_waits(
    one: int, other: int, waiting: int, former: list[tuple[int, int]]
) -> None:
    gap = arc(min(one, other), max(one, other))
    share = share_of(gap, waiting, [arc(min(pair), max(pair)) for pair in former])
    assert share.last == gap.last
    assert share.first >= gap.first
    if waiting and gap.length > waiting:
        assert share.first > gap.first
    else:
        assert share == gap


def test_a_share_is_what_a_former_owner_had_or_as_much_of_the_length_as_the_others_get() -> None:
    assert share_of(arc(10, 39), 2, []) == arc(30, 39)
    assert share_of(arc(10, 39), 1, [arc(10, 31), arc(32, 39)]) == arc(32, 39)
    assert share_of(arc(10, 39), 1, [arc(0, 31)]) == arc(32, 39), "the last one's is not known: it had what the one before had not"
    assert share_of(arc(10, 39), 1, [arc(0, 50)]) == arc(25, 39)


def beside_a_dead_one(newcomers: int, *, refusing: bool = False) -> list[Arc | None]:
    """What those own at last who stand in the place of the middle one of three, and the one right of it."""

    async def main() -> list[Arc | None]:
        street = Street(3, newcomers=newcomers, join_before=2)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            for house in street.houses[3:]:
                assert house.line is not None
                house.line.refuses = "a test" if refusing else ""
            await adopting(street)
            await street.until_whole()
            street.check()
            found = [street.houses[3 + number].line.arc for number in reversed(range(newcomers))]
            found.append(street.houses[2].line.arc)
            adopter = street.houses[2].own
            assert adopter is not None
            assert adopter.recovers, "its load has not been looked at since"
            nursery.cancel_scope.cancel()
        return found

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.usefixtures("only_errors")
@pytest.mark.parametrize("newcomers", [1, 2])
def test_who_waits_beside_a_gap_adopts_its_share_of_it(newcomers: int) -> None:
    found = beside_a_dead_one(newcomers)
    assert all(one is not None for one in found)
    own = (LAST.number + 1) // 3
    lengths = [one.length for one in found if one is not None]
    expected = [own // (newcomers + 1)] * newcomers + [own + own // (newcomers + 1)]
    assert all(abs(length - wanted) <= 8 for length, wanted in zip(lengths, expected, strict=True)), (lengths, expected)


@pytest.mark.usefixtures("only_errors")
def test_who_takes_nothing_leaves_it_all_to_the_neighbour() -> None:
    waiting, adopter = beside_a_dead_one(1, refusing=True)
    assert waiting is None
    assert adopter is not None
    assert abs(adopter.length - 2 * ((LAST.number + 1) // 3)) <= 8


@pytest.mark.usefixtures("only_errors")
@pytest.mark.parametrize("point", DISTINCT)
@pytest.mark.parametrize("number", [2, 3])
def test_a_crash_at_every_step_of_a_shared_adoption(number: int, point: Point) -> None:
    assert crash_everywhere(adopting, number, point, founders=3, newcomers=1, join_before=2) >= 2
