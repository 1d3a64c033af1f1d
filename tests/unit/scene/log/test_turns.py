"""If this fails, a space comes to a layout by which somebody holds copies already, and is said to be empty; or nobody knows what it had before."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.scene.log import Layouts, SceneLog, free_offsets, missing_shadows, with_shadows
from scenefold.scene.log.turning import may_turn
from scenefold.scene.log.turns import shift_of
from scenefold.wire import Batch, ScaleSpace, SetCopies
from unit.scene.log.test_book import HALL, ORIGIN, space, with_entries

HERE, THERE = SceneId(0x1234_5678), SceneId(2**32 - 1)
ATTIC = SpaceId(30)
copies = st.integers(1, COPIES_MAX)


def set_to(log: SceneLog, number: int, which: SpaceId = HALL) -> SceneLog:
    entry = Batch((SetCopies(which, number, 1), *missing_shadows(log.space(which), number, log)))
    return log.apply(log.next_record(entry, log.position.to_bytes(16, "big"), ORIGIN))


def layout_of(log: SceneLog, which: SpaceId = HALL, scene: SceneId = HERE) -> tuple[Location, ...]:
    return Layouts.of(log.public_spaces(), scene).offsets[which]


@given(st.lists(copies, min_size=1, max_size=6), copies)
def test_a_space_never_has_a_layout_twice_and_all_that_it_had_are_known(steps: list[int], first: int) -> None:
    log = with_entries(Batch(with_shadows(space(copies=first), with_entries())))
    had = [layout_of(log)]
    for number in steps:
        was = log.space(HALL).copies
        log = set_to(log, number)
        if number == was:
            assert layout_of(log) == had[-1] and log.space(HALL).turned < log.position
            continue
        assert layout_of(log) not in [layout for layout in had if layout], "as if it had not been away"
        assert len(layout_of(log)) == number - 1
        had.append(layout_of(log))
        turn = Layouts.of(log.public_spaces(), HERE).turns[HALL]
        assert turn.position == log.position == log.space(HALL).turned
        assert all(turn.may_have_had(layout) for layout in had[:-1] if layout)
        assert not turn.may_have_had(had[-1]) and not turn.may_have_had(())


@given(copies.filter(lambda number: number > 1), copies.filter(lambda number: number > 1))
def test_layouts_of_spaces_that_turned_are_nobody_elses(first: int, then: int) -> None:
    attic = replace(space(copies=first), space=ATTIC, name="attic")
    log = with_entries(Batch(with_shadows(space(copies=first), with_entries())))
    log = log.apply(log.next_record(Batch(with_shadows(attic, log)), b"a" * 16, ORIGIN))
    assert layout_of(log) == layout_of(log, ATTIC) == tuple(free_offsets((), first - 1)), "spaces that never turned share theirs"
    if first == then:
        return
    after = set_to(set_to(log, then), then, ATTIC)
    found = [layout_of(after, which, scene) for which in (HALL, ATTIC) for scene in (HERE, THERE)]
    assert len(set(found)) == 4
    turns = Layouts.of(after.public_spaces(), HERE).turns
    assert not any(turns[which].may_have_had(layout) for which in (HALL, ATTIC) for layout in found)
    again = Layouts.of(set_to(set_to(after, 1), 1, ATTIC).public_spaces(), HERE).turns
    for which, own in ((HALL, found[0]), (ATTIC, found[2])):
        assert [layout for layout in found if again[which].may_have_had(layout)] == [own]


@pytest.mark.parametrize("scene", [SceneId(1), THERE])
def test_a_shift_moves_nobodys_copies(scene: SceneId) -> None:
    log = set_to(with_entries(space()), 3)
    thirds = [LINE_LENGTH * third // 3 for third in (1, 2)]
    moved = [offset.number - third for offset, third in zip(layout_of(log, scene=scene), thirds, strict=True)]
    assert moved == [shift_of(scene, HALL, log.position)] * 2
    assert 0 < moved[0] < LINE_LENGTH >> 40
    assert shift_of(scene, HALL, 2**64 - 1) < 2**109


def test_only_what_sets_copies_or_makes_shadows_turns() -> None:
    log = with_entries(space())
    assert not may_turn(space()) and not may_turn(ScaleSpace(HALL, 2.0)) and not may_turn(Batch((ScaleSpace(HALL, 2.0),)))
    assert (
        may_turn(SetCopies(HALL, 1, 1))
        and may_turn(missing_shadows(log.space(HALL), 2, log)[0])
        and may_turn(Batch((SetCopies(HALL, 1, 1),)))
    )
    least = set_to(with_entries(Batch(with_shadows(space(copies=3, copies_min=2), with_entries()))), 3)
    assert least.space(HALL).copies_min == 1 and least.space(HALL).turned == 0, "how many must be there changes no layout"
