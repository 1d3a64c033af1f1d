"""If this fails, the report of a render says other rounds, or another tail, than there were."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.ids import NodeId
from scenefold.render.pool.course import ROUNDS_MAX, TAIL_PASSES_MIN, Course
from scenefold.render.reports import efficiency_of

A, B = NodeId(1), NodeId(2)


def test_a_round_is_what_was_done_between_two_moves() -> None:
    course = Course(passes=4)
    course.cells_moved({A: {"casts": 100}, B: {"casts": 50}})
    course.round_ended({A: {"casts": 160}, B: {"casts": 110}})
    assert course.document(is_done=True)["rounds"] == [[150, 100, 2], [120, 60, 2]]
    assert course.document(is_done=False) == {"moved": 1, "rounds": [], "tail": []}
    assert efficiency_of([(150, 100, 2), (120, 60, 2)]) == 270 / 320


def test_a_node_that_is_back_counts_from_nothing() -> None:
    course = Course(passes=4)
    course.round_ended({A: {"casts": 100}, B: {}})
    course.round_ended({A: {"casts": 30}, B: {"casts": 7}})
    course.round_ended({A: {"casts": 50}, B: {"casts": "many"}})
    assert course.document(is_done=True)["rounds"] == [[100, 100, 2], [37, 30, 2], [20, 20, 2]]


def test_a_node_that_is_lost_is_no_idle_one_of_later_rounds_and_all_that_it_does_once_it_is_back_counts() -> None:
    course = Course(passes=4)
    course.round_ended({A: {"casts": 100}, B: {"casts": 100}})
    course.round_ended({A: {"casts": 150}})
    course.round_ended({A: {"casts": 300}, B: {"casts": 140}})
    assert course.document(is_done=True)["rounds"] == [[200, 100, 2], [50, 50, 1], [290, 150, 2]]


def test_a_round_in_which_nothing_happened_is_none_and_few_are_told() -> None:
    course = Course(passes=4)
    course.round_ended({})
    course.round_ended({A: {"casts": 0}})
    assert course.document(is_done=True)["rounds"] == []
    for number in range(ROUNDS_MAX + 9):
        course.cells_moved({A: {"casts": number + 1}})
    assert len(course.document(is_done=True)["rounds"]) == ROUNDS_MAX  # type: ignore[arg-type]
    assert course.moves == ROUNDS_MAX + 9


def test_the_tail_is_of_the_passes_that_were_traced() -> None:
    course = Course(passes=100)
    course.closed(0, 10.0)
    for number in range(1, 96):
        course.closed(number, 10.0 + number)
    course.closed(100, 150.0)
    assert course.tail == [95.0, 140.0]


def test_a_render_that_ends_early_has_a_tail_of_its_own() -> None:
    course = Course(passes=200)
    course.closed(0, 0.0)
    course.closed(20, 5.0)
    course.closed(40, 9.0)
    assert course.tail == [9.0, 9.0]
    assert Course(passes=7).tail == []


def test_an_adaptive_render_that_needs_few_of_its_passes_has_the_tail_of_these() -> None:
    course = Course(passes=10_000)
    for number in range(161):
        course.closed(number, float(number))
    assert course.tail == [152.0, 160.0]


def test_the_tail_of_many_passes_is_off_by_less_than_a_hundredth_of_the_time() -> None:
    course = Course(passes=100_000)
    for number in range(0, 100_001, 7):
        course.closed(number, number / 100)
    course.closed(100_000, 1_001.0)
    early, late = course.tail
    assert late == 1_001.0 and 950.0 <= early <= 960.0


def test_so_few_passes_have_no_tail() -> None:
    course = Course(passes=TAIL_PASSES_MIN - 1)
    for number in range(TAIL_PASSES_MIN):
        course.closed(number, float(number))
    assert course.tail == []


def test_the_tail_of_a_resumed_render_is_of_what_it_traced_itself() -> None:
    course = Course(passes=300, before=200)
    course.closed(200, 10.0)
    for number in range(201, 296):
        course.closed(number, 10.0 + number - 200)
    course.closed(300, 150.0)
    assert course.tail == [95.0, 140.0]


def test_a_render_that_was_traced_before_has_no_tail() -> None:
    course = Course(passes=200, before=200)
    course.closed(200, 10.0)
    assert course.tail == []


@given(some.integers(1, 500), some.lists(some.tuples(some.integers(0, 500), some.floats(0.0, 100.0)), max_size=20))
def test_the_last_pass_is_never_before_the_others(passes: int, looks: list[tuple[int, float]]) -> None:
    course, now = Course(passes), 0.0
    for closed, later in looks:
        now += later
        course.closed(min(closed, passes), now)
    tail = course.tail
    assert not tail or 0.0 <= tail[0] <= tail[1] <= now
    assert bool(tail) is (max((min(closed, passes) for closed, _ in looks), default=0) >= TAIL_PASSES_MIN)
