"""If this fails, a node acts on half of a story, a piece is no end of its arc, or a newcomer goes where it helps least."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location
from scenefold.peer.balance.emptying import DRAIN_FILL_MAX, PORTION_BYTES_MAX, PORTION_BYTES_MIN, next_portion, room_of
from scenefold.peer.balance.news import News
from scenefold.peer.balance.pieces import PIECE_BYTES_MAX, half_of, piece_of, up_to
from scenefold.peer.balance.places import Host, most_loaded, owner_of
from scenefold.peer.line.ends import Side, is_end_of
from unit.peer.balance.street import KIB, Street

ME, A, B = NodeId(1), NodeId(2), NodeId(3)
NODES = (ME, A, B)


def place(number: int) -> Location:
    return Location.from_number(number)


LONG_AGO = 0.0


def heard_at_one() -> News:
    news = News(ME, 0.0)
    for node in NODES:
        news.measure(50, 100, 1.0) if node == ME else news.hear(node, 1, 50, 100, 1.0)
    return news


def test_a_change_is_whole_once_all_have_been_heard_since() -> None:
    news = heard_at_one()
    news.hear(A, 2, 90, 100, 2.0)
    assert news.changes(NODES, LONG_AGO) == [0, 40, 0]
    news.hear(B, 2, 10, 100, 3.0)
    assert news.changes(NODES, LONG_AGO) == [0, 40, -40], "they cancel"
    news.measure(50, 100, 4.0)
    news.hear(A, 3, 90, 100, 4.0)
    assert news.changes(NODES, LONG_AGO) == [0, 0, 0], "everybody was heard at 3 or later"


def test_a_change_is_whole_once_others_would_have_told_of_theirs() -> None:
    news = heard_at_one()
    news.hear(A, 2, 90, 100, 2.0)
    assert news.changes(NODES, 1.9) == [0, 40, 0]
    assert news.changes(NODES, 2.0) == [0, 0, 0]


def test_older_statuses_and_strangers_do_not_count() -> None:
    news = heard_at_one()
    news.hear(A, 5, 60, 100, 2.0)
    news.hear(A, 4, 99, 100, 3.0)
    assert news.fill(A, takes=True).used == 60
    assert not news.fill(NodeId(9), takes=True).open
    news.keep_only([ME, B])
    assert not news.fill(A, takes=True).open
    assert news.changes(NODES, LONG_AGO)[1] == 0


def test_a_new_incarnation_counts_from_its_first_status_on() -> None:
    news = heard_at_one()
    news.hear(A, 3 << 32, 90, 100, 2.0)
    news.hear(A, 1 << 32, 10, 100, 3.0, incarnation=b"another")
    assert news.fill(A, takes=True).used == 10
    assert news.changes(NODES, LONG_AGO) == [0, 0, 0]


def test_what_passed_between_us_raises_no_doubt() -> None:
    news = heard_at_one()
    news.hear(A, 2, 52, 100, 2.0)
    news.measure(50, 100, 3.0)
    news.book(ME, A, 20)
    news.measure(30, 100, 4.0)
    assert news.fill(A, takes=True).used == 72
    assert news.changes(NODES, LONG_AGO) == [0, 2, 0]
    news.measure(40, 100, 5.0)
    news.book(B, ME, 10)
    news.measure(40, 100, 6.0)
    assert news.changes(NODES, LONG_AGO) == [0, 2, 0], "it was measured before it was booked"


@given(st.sets(st.integers(0, 1000), min_size=1, max_size=30), st.integers(0, 40), st.sampled_from(Side))
def test_a_piece_is_an_end_of_the_arc_with_what_was_asked_for(numbers: set[int], wanted: int, side: Side) -> None:
    import trio

    async def check() -> None:
        house = Street([1 << 30]).houses[0]
        arc = Arc(FIRST, place(1000))
        house.arc, house.sizes = arc, dict.fromkeys(map(place, numbers), KIB)
        piece = await piece_of(house, arc, side, wanted * KIB)  # type: ignore[arg-type]
        if piece is not None:
            assert is_end_of(piece.arc, arc, side)
            assert piece.arc != arc
            assert piece.records == min(max(1, wanted), len(numbers)) or wanted == 0
            assert piece.records == sum(number in piece.arc for number in house.sizes)
        half = await half_of(house, arc, side)  # type: ignore[arg-type]
        assert half is not None
        assert is_end_of(half, arc, side)
        assert half != arc
        if len(numbers) > 1:
            inside = sum(found in half for found in house.sizes)
            assert abs(inside - len(numbers) / 2) <= 1

    trio.run(check)


async def test_half_of_much_is_no_more_than_a_piece() -> None:
    house = Street([1 << 40]).houses[0]
    arc, record_bytes = Arc(FIRST, place(1000)), 1 << 20
    house.arc, house.sizes = arc, dict.fromkeys(map(place, range(1000)), record_bytes)
    for side in Side:
        half = await half_of(house, arc, side)  # type: ignore[arg-type]
        assert half is not None
        assert sum(size for found, size in house.sizes.items() if found in half) == PIECE_BYTES_MAX


async def test_one_location_cannot_be_parted() -> None:
    house = Street([1 << 30]).houses[0]
    assert await half_of(house, Arc(FIRST, FIRST), Side.LEFT) is None  # type: ignore[arg-type]
    for side in Side:
        half = await half_of(house, Arc(FIRST, place(1)), side)  # type: ignore[arg-type]
        assert half == (Arc(FIRST, FIRST) if side is Side.LEFT else Arc(place(1), place(1)))


def test_up_to_a_place() -> None:
    assert up_to(WHOLE_LINE, Side.LEFT, place(9)) == Arc(FIRST, place(9))
    assert up_to(WHOLE_LINE, Side.RIGHT, place(9)) == Arc(place(9), LAST)
    assert up_to(WHOLE_LINE, Side.LEFT, LAST) is None
    assert up_to(Arc(place(5), place(9)), Side.LEFT, place(4)) is None


def test_where_a_newcomer_goes() -> None:
    low, high = Arc(FIRST, place(9)), Arc(place(10), LAST)
    assert most_loaded([]) is None
    assert most_loaded([Host(A, low, 5, 10), Host(B, high, 60, 100)]) == B
    assert most_loaded([Host(A, low, 5, 10), Host(B, high, 5, 10)]) == B, "the longer arc"
    assert most_loaded([Host(B, low, 5, 10), Host(A, low, 5, 10)]) == A, "the lower id"
    assert most_loaded([Host(A, low, 1, 10), Host(B, high, 9, 10, alive=False)]) == A
    assert most_loaded([Host(A, low, 1, 10), Host(B, None, 9, 10)]) == A
    assert owner_of([Host(A, low, 0, 0), Host(B, high, 0, 0)], place(10)) == B
    assert owner_of([Host(A, low, 0, 0), Host(B, None, 0, 0)], place(10)) is None


@given(st.dictionaries(st.sampled_from(Side), st.integers(-(1 << 30), 1 << 40)), st.integers(0, 1 << 40))
def test_a_leaving_node_gives_what_fits(rooms: dict[Side, int], left: int) -> None:
    portion = next_portion(rooms, left)
    if portion is None:
        assert all(room < min(left, PORTION_BYTES_MIN) for room in rooms.values())
        return
    assert rooms[portion.side] == max(rooms.values())
    assert portion.bytes <= min(rooms[portion.side], PORTION_BYTES_MAX)
    assert portion.is_all == (portion.bytes == left)


def test_room() -> None:
    assert room_of(0, 1000) == 1000 * DRAIN_FILL_MAX
    assert room_of(1000, 1000) < 0
